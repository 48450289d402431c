"""Growing the files of clouds again: a cloud is a cache of its genome, and its metadata follow from the layout.

What comes out has the bytes that the manifest part recorded, if the same compressor is at hand. Otherwise it has
the same content, and a small document beside the parts vouches for the new bytes; it is written first.
"""

from __future__ import annotations

import secrets
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue.documents import encoded_document
from fractal_farm.catalogue.layout import FORMAT, MENDINGS, crc32c
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.catalogue.shards import (
    POINTS,
    ROOT,
    SHARD,
    array_metadata,
    decoded_slot,
    encoded_shard,
    group_metadata,
    shard_files,
)
from fractal_farm.catalogue.verify.contents import Contents
from fractal_farm.errors import FarmError


def regrow(contents: Contents, key: str, before: bytes | None) -> tuple[dict[str, bytes], int]:
    """A cloud file as it was.

    Args:
        contents: the catalogue.
        key: a cloud file that a sound part refers to.
        before: what is left of the file, or None.

    Returns:
        Key -> content of what is to be put, in this order; and how many clouds could not be restored, because their
        genomes do not grow into the recorded bits here, and the stored ones are damaged.
    """
    part = contents.part_of[key]
    array, _, chunk = key.split("/", 2)[2].rpartition("/")
    lost: list[str] = []
    if chunk == ROOT:
        n_points = contents.rows(part, ["n_points"]).column(0)[0].as_py()
        content = _metadata(part.name.writer, array, n_points)
    else:
        shard = int(chunk.split(".")[1])
        mine = contents.rows(part, DESIGN_SCHEMA.names, shard).to_pylist()
        if [row["cloud_row"] % SHARD for row in mine] != list(range(len(mine))):
            raise FarmError(f"{part.key}: its rows do not fill {key} from the start; restore both from a copy")
        content, lost = _chunk(mine, array, shard, before)
    facts = (len(content), crc32c(content))
    if facts in contents.accepted[key] and not lost and not contents.lost.get(key):
        return {key: content}, 0
    entry = {"bytes": facts[0], "crc32c": facts[1], "lost": lost}
    document = encoded_document({"files": {key: entry}})
    return {f"{MENDINGS}/{secrets.token_hex(8)}~{crc32c(document):08x}.json": document, key: content}, len(lost)


def _metadata(writer: str, array: str, n_points: int) -> bytes:
    if not array:
        return group_metadata({"format": FORMAT, "writer": writer})
    return array_metadata(n_points)[array]


def _chunk(rows: list[dict[str, Any]], array: str, shard: int, before: bytes | None) -> tuple[bytes, list[str]]:
    """The chunk of an array, and the ids of the designs whose clouds are lost."""
    from fractal_farm.ifs.quantised_cloud import QuantisedClouds, quantised_attractors

    n_points = rows[0]["n_points"]
    points = np.zeros((len(rows), n_points, 3), np.uint16)
    lost = []
    if array == POINTS:
        grown = quantised_attractors([genome_of(row) for row in rows], n_points)
        for slot, row in enumerate(rows):
            stored = None if before is None else decoded_slot(before, slot, n_points)
            for cloud in (stored, grown.points[slot]):
                if cloud is not None and _checksum(cloud) == row["cloud_crc32c"]:
                    points[slot] = cloud
                    break
            else:
                lost.append(slot)
        return encoded_shard(points, lost), [rows[slot]["design_id"] for slot in lost]
    origin = np.array([row["origin"] for row in rows], np.float32)
    scale = np.array([row["scale"] for row in rows], np.float32)
    files = shard_files(QuantisedClouds(points, origin, scale), [row["design_id"] for row in rows], shard)
    return files[f"{array}/c.{shard}.0"], []


def _checksum(points: npt.NDArray[np.uint16]) -> int:
    return crc32c(points.astype("<u2", copy=False).tobytes())
