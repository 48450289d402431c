"""The pages without a server: their files, and the same data in files, for any web host and below any path.

What is written depends on the designs alone: the same catalogue gives the same bytes. Computing (scores of a tuned
design, solids, keeping) needs `farm studio`; all that the manifest tells of each design is there.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue import Catalogue, judgements
from fractal_farm.catalogue.rows import GENOME_COLUMNS
from fractal_farm.catalogue.scan import Places, Rows
from fractal_farm.errors import InputError
from fractal_farm.studio.columns import BLOCK, COLUMNS, Maps, encoded, version_of
from fractal_farm.studio.details import details
from fractal_farm.studio.gallery import marks_of
from fractal_farm.studio.groups import Groups, group_sizes
from fractal_farm.studio.page_data import catalogue_facts, title_of
from fractal_farm.studio.reading import judged_columns, read_columns, read_maps
from fractal_farm.studio.static_files import static_files

_SHOWN = (
    *("run_id", "island", "epoch", "generation", "slot", "maps", "d0", "d2", "lle", "fitness", "d0_error", "d2_error"),
    *("gap", "similarity_dimension", "grams", "width_mm", "depth_mm", "niche", "parents", "operator", "n_points"),
    "created_us",
)
_TOGETHER = 64 * BLOCK  # rows that are read at once
_SIMILAR = 12


@dataclass(frozen=True)
class Site:
    """What was written.

    Attributes:
        designs: that it shows.
        files: of them.
        bytes: their size.
        version: of its data.
    """

    designs: int
    files: int
    bytes: int
    version: str


def export_gallery(catalogue: Catalogue, out: Path, rows: Rows, places: Places) -> Site:
    """Write the pages of some designs.

    Args:
        catalogue: which holds them.
        out: a new or empty directory.
        rows: rows of the manifest.
        places: of them, those of the designs, in the order of the pages; at least one.

    Raises:
        InputError: no designs, or `out` is not empty.
        FarmError: the manifest is damaged.
    """
    if not len(places):
        raise InputError(f"{catalogue.path}: no designs to show; another --where may find some")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: is there already; name a new directory")
    marks = marks_of(rows, places)
    arrays = _columns(catalogue, rows, places, marks)
    counts, flat = read_maps(rows, places)
    maps, most = Maps(counts, flat), int(counts.max())
    version = version_of(arrays, most)
    facts = catalogue_facts(catalogue, version, len(places), most, server=False)
    site = _Writer(out)
    for name, path in static_files().items():
        site.write(name, [path.read_bytes()])
    site.write("data/catalogue.json", [_json({**facts, "epoch": 0, "judged": 0})])
    site.write(f"data/{version}/columns.bin", encoded(arrays))
    for block in range(-(-len(places) // BLOCK)):
        held = maps.rows(block * BLOCK, min((block + 1) * BLOCK, len(places)), most)
        site.write(f"data/{version}/maps/{block}.bin", [held.astype("<f4").tobytes()])
    for block, told in enumerate(_details(catalogue, rows, places, arrays, marks)):
        site.write(f"data/{version}/details/{block}.json", [_json(told)])
    return Site(len(places), site.files, site.bytes, version)


class _Writer:
    """Files below a directory, counted."""

    def __init__(self, out: Path) -> None:
        self._out, self.files, self.bytes = out, 0, 0

    def write(self, name: str, pieces: Any) -> None:
        path = self._out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            for piece in pieces:
                self.bytes += file.write(piece)
        self.files += 1


def _columns(
    catalogue: Catalogue, rows: Rows, places: Places, marks: npt.NDArray[np.float64]
) -> dict[str, npt.NDArray[Any]]:
    found: dict[str, npt.NDArray[Any]] = dict(read_columns(rows, places))
    thought = judgements(catalogue.path)
    row_of = {identity.tobytes().hex(): row for row, identity in enumerate(found["design_id"])} if thought else {}
    representatives = Groups().add(marks).astype("<u4")
    found |= judged_columns(found["design_id"], thought, row_of)
    found |= {"representative": representatives, "group_size": group_sizes(representatives)}
    return {column.name: found[column.name] for column in COLUMNS}


def _details(
    catalogue: Catalogue,
    rows: Rows,
    places: Places,
    arrays: dict[str, npt.NDArray[Any]],
    marks: npt.NDArray[np.float64],
) -> Iterator[list[dict[str, Any]]]:
    """For each block what is known of its designs."""
    ids = [identity.tobytes().hex() for identity in arrays["design_id"]]
    row_of = {identity: row for row, identity in enumerate(ids)}
    children: dict[str, list[str]] = {}
    for child, parents in zip(ids, rows.take(["parents"], places).column(0).to_pylist(), strict=True):
        for parent in dict.fromkeys(parents or ()):
            children.setdefault(parent, []).append(child)
    thought, name = judgements(catalogue.path), title_of(catalogue.path)
    near = _nearest(marks)
    for start in range(0, len(places), _TOGETHER):
        table = rows.take([*GENOME_COLUMNS, *_SHOWN], places[start : start + _TOGETHER])
        for first in range(0, table.num_rows, BLOCK):
            block = []
            for row in table.slice(first, BLOCK).to_pylist():
                identity = row["design_id"]
                own, born = row_of[identity], children.get(identity, ())
                told = details(row, row_of.get, arrays["representative"], born, thought.get(identity), (), name)
                alike = [{"design_id": ids[k], "row": k, "distance": distance} for k, distance in near(own)]
                block.append({**told, "similar": alike})
            yield block


def _nearest(marks: npt.NDArray[np.float64]) -> Any:
    """A function from a row to the (row, distance) of those whose signatures are nearest."""
    from scipy.spatial import cKDTree

    known = np.flatnonzero(np.isfinite(marks).all(axis=1))
    tree = cKDTree(marks[known]) if len(known) else None

    def near(row: int) -> Sequence[tuple[int, float]]:
        if tree is None or not np.isfinite(marks[row]).all():
            return ()
        distances, found = tree.query(marks[row], k=min(_SIMILAR + 1, len(known)))
        pairs = zip(np.atleast_1d(known[found]).tolist(), np.atleast_1d(distances).tolist(), strict=True)
        ordered = sorted((round(distance, 6), other) for other, distance in pairs if other != row)
        return [(other, distance) for distance, other in ordered[:_SIMILAR]]

    return near


def _json(value: Any) -> bytes:
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode() + b"\n"
