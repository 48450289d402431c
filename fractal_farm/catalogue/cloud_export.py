"""The clouds of chosen designs as one dense Zarr v3 array in their order, copied as they are stored.

A cloud is a chunk of its own, so its compressed bytes are the same in any shard: they are looked at, and copied. What
is not stored is grown again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fractal_farm.catalogue.clouds import CLOUD_COLUMNS
from fractal_farm.catalogue.layout import CLOUDS, crc32c
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.catalogue.scan import Places, Rows
from fractal_farm.catalogue.shards import (
    INDEX_BYTES,
    POINTS,
    ROOT,
    SHARD,
    array_metadata,
    decoded_cloud,
    decoded_index,
    encoded_cloud,
    joined_pieces,
)
from fractal_farm.errors import FarmError, InputError

_BLOCK = 16 * SHARD


def write_clouds(path: Path, root: Path, rows: Rows, places: Places, about: Mapping[str, Any]) -> None:
    """Write a Zarr group with the arrays points, origin, scale and design_id.

    Args:
        path: its directory, new.
        root: the catalogue.
        rows: rows of its manifest.
        places: the rows that are wanted, in the order of the first axis.
        about: attributes of the group.

    Raises:
        InputError: the clouds differ in their number of points.
        FarmError: a cloud is damaged.
    """
    sizes = sorted(set(rows.take(["n_points"], places).column(0).unique().to_pylist()))
    if len(sizes) > 1:
        choice = " or ".join(f'--where "n_points == {size}"' for size in sizes)
        raise InputError(f"clouds of {', '.join(map(str, sizes))} points do not fit one array; add {choice}")
    group = _new_group(path, len(places), sizes[0], about)
    stored = _StoredClouds(root)
    for start in range(0, len(places), _BLOCK):
        block = rows.take(CLOUD_COLUMNS, places[start : start + _BLOCK]).to_pylist()
        pieces = [stored.piece(row) if row["cloud_row"] is not None else _grow(row) for row in block]
        for first in range(0, len(block), SHARD):
            shard = path / POINTS / f"c.{(start + first) // SHARD}.0.0"
            shard.write_bytes(joined_pieces(pieces[first : first + SHARD]))
        inside = slice(start, start + len(block))
        group["origin"][inside] = np.array([row["origin"] for row in block], np.float32)
        group["scale"][inside] = np.array([row["scale"] for row in block], np.float32)
        ids = bytes.fromhex("".join(row["design_id"] for row in block))
        group["design_id"][inside] = np.frombuffer(ids, np.uint8).reshape(len(block), -1)


def _new_group(path: Path, count: int, n_points: int, about: Mapping[str, Any]) -> Any:
    import zarr

    group = zarr.open_group(path, mode="w", attributes=dict(about))
    for name, shape, kind, axes, meaning in (
        ("origin", (count, 3), "float32", ("design", "axis"), "low corner of the cloud's box"),
        ("scale", (count,), "float32", ("design",), "longest side of the cloud's box"),
        ("design_id", (count, 16), "uint8", ("design", "byte"), "the 16 bytes of the design_id in hex"),
    ):
        chunks = (min(count, _BLOCK), *shape[1:])
        attributes: dict[str, Any] = {"meaning": meaning, **({} if kind == "uint8" else {"units": "IFS units"})}
        group.create_array(
            name, shape=shape, chunks=chunks, dtype=kind, dimension_names=axes, attributes=attributes, fill_value=0
        )
    metadata = json.loads(array_metadata(n_points, count)[POINTS])
    metadata["attributes"] = {
        "units": "IFS units",
        "quantisation": "xyz = points / 65535 * scale + origin",
        "coordinates": "origin scale design_id",
    }
    (path / POINTS).mkdir()
    (path / POINTS / ROOT).write_text(json.dumps(metadata, indent=2) + "\n")
    return group


class _StoredClouds:
    """The shards of a catalogue, of which the places of the clouds are remembered."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._indexes: dict[Path, list[tuple[int, int]]] = {}

    def piece(self, row: Mapping[str, Any]) -> bytes:
        """The bytes of a cloud in its shard."""
        path = self._root / CLOUDS / row["writer"] / row["cloud_array"] / f"c.{row['cloud_row'] // SHARD}.0.0"
        try:
            with path.open("rb") as file:
                if path not in self._indexes:
                    file.seek(-INDEX_BYTES, os.SEEK_END)
                    self._indexes[path] = _checked_index(path, file.read())
                offset, length = self._indexes[path][row["cloud_row"] % SHARD]
                file.seek(offset)
                piece: bytes = file.read(length)
        except (OSError, OverflowError) as error:
            raise _damaged(path, row) from error
        points = decoded_cloud(piece, row["n_points"])
        if points is None or crc32c(np.ascontiguousarray(points).tobytes()) != row["cloud_crc32c"]:
            raise _damaged(path, row)
        return piece


def _checked_index(path: Path, content: bytes) -> list[tuple[int, int]]:
    index = decoded_index(content)
    if index is None:
        raise FarmError(f"{path}: damaged; `farm verify --repair` grows its clouds again")
    return index


def _damaged(path: Path, row: Mapping[str, Any]) -> FarmError:
    return FarmError(
        f"{path}: the cloud of design {row['design_id']} is missing or damaged; `farm verify --repair` grows it again"
    )


def _grow(row: dict[str, Any]) -> bytes:
    """The bytes of a cloud that was not stored; its box is added to the row."""
    from fractal_farm.ifs.quantised_cloud import quantised_attractors

    cloud = quantised_attractors([genome_of(row)], row["n_points"])[0]
    row["origin"], row["scale"] = cloud.origin, cloud.scale
    return encoded_cloud(cloud.points)
