"""The full look: every byte of every file against its checksum.

Where the checksum stands: of clouds in their part's footer, of snapshots in the name, of solids in their list, of a
picture in each of its chunks (PNG, section 5.3). Parts and small documents were compared before.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np

from fractal_farm.catalogue.documents import SEALED_PAGE, is_sealed_page
from fractal_farm.catalogue.layout import SNAPSHOTS, crc32c
from fractal_farm.catalogue.shards import POINTS, SHARD, decoded_slot
from fractal_farm.catalogue.solids import CERTIFICATE, opened_certificate
from fractal_farm.catalogue.verify.contents import Contents, named_checksum
from fractal_farm.catalogue.verify.findings import Finding
from fractal_farm.catalogue.verify.structure import GROW, clouds_in, solid_directories, solid_files

_PNG = b"\x89PNG\r\n\x1a\n"
_REDRAW = "`farm verify --repair` makes it again"


def byte_findings(contents: Contents) -> Iterator[Finding]:
    """What the checksums tell."""
    yield from _clouds(contents)
    yield from _snapshots(contents)
    yield from _solids(contents)
    yield from _pictures(contents)


def _clouds(contents: Contents) -> Iterator[Finding]:
    for key, accepted in sorted(contents.accepted.items()):
        if contents.sizes.get(key) not in {size for size, _ in accepted}:
            continue  # told already
        content = contents.read(key)
        if isinstance(content, str):
            yield Finding(key, "cloud", content, GROW, clouds_in(contents, key))
        elif (len(content), crc32c(content)) not in accepted:
            concerned, problem = _damaged_clouds(contents, key, content)
            yield Finding(key, "cloud", f"damaged: its checksum does not match; {problem}", GROW, concerned)


def _damaged_clouds(contents: Contents, key: str, content: bytes) -> tuple[tuple[str, ...], str]:
    """The designs whose clouds are damaged in a file that is, and how many that are."""
    everyone = clouds_in(contents, key)
    if f"/{POINTS}/c." not in key:
        return everyone, f"concerns {len(everyone)} clouds"
    concerned = []
    columns = ["design_id", "cloud_row", "n_points", "cloud_crc32c"]
    for row in contents.rows(contents.part_of[key], columns, int(key.split("/c.")[1].split(".")[0])).to_pylist():
        points = decoded_slot(content, row["cloud_row"] % SHARD, row["n_points"])
        if points is None or crc32c(np.ascontiguousarray(points).tobytes()) != row["cloud_crc32c"]:
            concerned.append(row["design_id"])
    return tuple(concerned), f"{len(concerned)} of {len(everyone)} clouds are damaged"


def _snapshots(contents: Contents) -> Iterator[Finding]:
    for key in sorted(contents.sizes):
        if key.startswith(f"{SNAPSHOTS}/") and (checksum := named_checksum(key)) is not None:
            content = contents.read(key)
            if content == "missing":
                continue  # older snapshots of a live run go
            if isinstance(content, str) or crc32c(content) != checksum:
                remedy = "`farm verify --repair` moves it aside; older ones and the records tell the same"
                yield Finding(key, "snapshot", "damaged: its checksum does not match", remedy)


def _solids(contents: Contents) -> Iterator[Finding]:
    for solid in solid_directories(contents):
        for name, (size, checksum) in (solid_files(contents, solid) or {}).items():
            if contents.sizes.get(f"{solid}/{name}") != size:
                continue  # told already
            content = contents.read(f"{solid}/{name}")
            if isinstance(content, str) or crc32c(content) != checksum:
                problem = f"{name} is damaged: its checksum does not match"
                yield Finding(solid, "solid", problem, _REDRAW, (solid.split("/")[1],))
            elif name == CERTIFICATE and opened_certificate(content, solid.split("/")[1]) is None:
                problem = f"{name} is no certificate of this design"
                yield Finding(solid, "solid", problem, _REDRAW, (solid.split("/")[1],))


def _pictures(contents: Contents) -> Iterator[Finding]:
    for key in sorted(contents.sizes):
        if "/" in key and not key.startswith("pictures/"):
            continue
        content = contents.read(key) if key.endswith((".png", SEALED_PAGE)) else b""
        if (
            isinstance(content, str)
            or (key.endswith(".png") and not _is_whole_png(content))
            or (key.endswith(SEALED_PAGE) and not is_sealed_page(content))
        ):
            yield Finding(key, "picture", "damaged: its checksum does not match", _REDRAW)


def _is_whole_png(content: bytes) -> bool:
    """Whether every chunk has its checksum, and nothing lies before, between or after them."""
    if not content.startswith(_PNG):
        return False
    place = len(_PNG)
    while place < len(content):
        length = int.from_bytes(content[place : place + 4], "big")
        end = place + 12 + length
        body = content[place + 4 : end - 4]
        if end > len(content) or zlib.crc32(body) != int.from_bytes(content[end - 4 : end], "big"):
            return False
        place = end
        if body[:4] == b"IEND":
            return place == len(content)
    return False
