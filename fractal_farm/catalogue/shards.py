"""The Zarr v3 arrays of one writer, encoded in memory (research 'storage', section 4.2).

zarr-python writes the metadata; the shard bytes are put together here, byte for byte as zarr-python would,
because it needs four times as long for them (0.7 against 0.17 ms of CPU a cloud) and the writer shares a core
with the search. Arrays are declared once at full size and never resized: a hole costs nothing, and readers
never go stale.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue.layout import CLOUDS, FEATURES, FORMAT, crc32c

if TYPE_CHECKING:
    from fractal_farm.ifs.quantised_cloud import QuantisedClouds

SHARD = 256
"""Designs in one shard; each commit begins a new one."""
INDEX_BYTES = 16 * SHARD + 4
"""Of the places of the clouds in a shard, at its end."""
CAPACITY = 1 << 20
"""Declared rows of a writer's arrays."""
ROOT = "zarr.json"
"""Name of the metadata of a group or array."""
POINTS = "points"
TRANSFORM = "transform"
DESIGN_ID = "design_id"
ATTRIBUTE = "fractal_farm"
"""Key under which our groups describe themselves."""

_SEAL = "crc32c"
_ID_BYTES = 16
_EMPTY_SLOT = np.iinfo(np.uint64).max


def group_metadata(about: Mapping[str, Any]) -> bytes:
    """zarr.json of a group that says something about itself."""
    return _json({"zarr_format": 3, "node_type": "group", "attributes": {ATTRIBUTE: about}})


def sealed_group_metadata(about: Mapping[str, Any]) -> bytes:
    """zarr.json of a group that nothing else vouches for: it carries the checksum of itself without it."""
    return group_metadata({**about, _SEAL: f"{crc32c(group_metadata(about)):08x}"})


def root_documents() -> dict[str, bytes]:
    """The documents that make a directory an empty catalogue: key -> content; the root comes first."""
    about: dict[str, Any] = {"format": FORMAT, "min_reader": FORMAT, "features": sorted(FEATURES)}
    return {ROOT: sealed_group_metadata(about), f"{CLOUDS}/{ROOT}": sealed_group_metadata({"format": FORMAT})}


def is_root_document(key: str, content: bytes) -> bool:
    """Whether every bit of such a document is as it was written, by this version or another one."""
    try:
        about = json.loads(content)["attributes"][ATTRIBUTE]
        seal = about.pop(_SEAL, None)
    except (ValueError, RecursionError, KeyError, TypeError, AttributeError):
        return False
    if seal is None:  # written before documents were sealed
        known: dict[str, dict[str, Any]] = {
            ROOT: {"format": "1.0", "min_reader": "1.0", "features": []},
            f"{CLOUDS}/{ROOT}": {"format": "1.0"},
        }
        return content == group_metadata(known[key])
    return content == sealed_group_metadata(about)


@functools.cache
def array_metadata(n_points: int, rows: int = CAPACITY) -> dict[str, bytes]:
    """zarr.json of each array of a group whose clouds have n_points points: array name -> content.

    Args:
        n_points: points of a cloud.
        rows: designs that the arrays have room for.
    """
    import zarr
    from zarr.codecs import BloscCodec, Crc32cCodec

    store = zarr.storage.MemoryStore()
    common: dict[str, Any] = {
        "fill_value": 0,
        "chunk_key_encoding": {"name": "default", "separator": "."},
        "filters": None,
    }
    zarr.create_array(
        store,
        name=POINTS,
        shape=(rows, n_points, 3),
        chunks=(1, n_points, 3),
        shards=(SHARD, n_points, 3),
        dtype="uint16",
        compressors=[
            BloscCodec(cname="zstd", clevel=3, shuffle="bitshuffle", typesize=2),
            Crc32cCodec(),
        ],
        dimension_names=("design", "point", "axis"),
        attributes={
            "units": "IFS units",
            "quantisation": "xyz = origin + scale * q / 65535, with transform = (origin x, y, z, scale)",
            "coordinates": f"{TRANSFORM} {DESIGN_ID}",
        },
        **common,
    )
    zarr.create_array(
        store,
        name=TRANSFORM,
        shape=(rows, 4),
        chunks=(SHARD, 4),
        dtype="float32",
        compressors=[Crc32cCodec()],
        dimension_names=("design", "parameter"),
        attributes={"units": "IFS units", "parameters": ["origin_x", "origin_y", "origin_z", "scale"]},
        **common,
    )
    zarr.create_array(
        store,
        name=DESIGN_ID,
        shape=(rows, _ID_BYTES),
        chunks=(SHARD, _ID_BYTES),
        dtype="uint8",
        compressors=[Crc32cCodec()],
        dimension_names=("design", "byte"),
        attributes={"meaning": "the 16 bytes of the design_id in hex; all zero where no design is stored"},
        **common,
    )
    names = (POINTS, TRANSFORM, DESIGN_ID)
    return {name: _json(zarr.open_array(store, path=name).metadata.to_dict()) for name in names}


def shard_files(clouds: QuantisedClouds, design_ids: list[str], first_shard: int) -> dict[str, bytes]:
    """The chunk files of a batch of clouds, from shard `first_shard` on.

    Args:
        clouds: m clouds.
        design_ids: their m ids, 32 hex digits each.
        first_shard: index of the first shard, none of it written before.

    Returns:
        key within the writer's group -> content; three files for each 256 clouds begun.
    """
    files = {}
    transform = np.concatenate([clouds.origin, clouds.scale[:, np.newaxis]], axis=1).astype("<f4")
    ids = np.frombuffer(bytes.fromhex("".join(design_ids)), np.uint8).reshape(-1, _ID_BYTES)
    for shard, start in enumerate(range(0, len(clouds), SHARD), start=first_shard):
        rows = slice(start, start + SHARD)
        files[f"{POINTS}/c.{shard}.0.0"] = encoded_shard(clouds.points[rows])
        files[f"{TRANSFORM}/c.{shard}.0"] = _encoded_chunk(transform[rows])
        files[f"{DESIGN_ID}/c.{shard}.0"] = _encoded_chunk(ids[rows])
    return files


def encoded_shard(points: npt.NDArray[np.uint16], empty: Collection[int] = ()) -> bytes:
    """One shard: a blosc chunk for each cloud, each with its CRC32C, then the index of (offset, length).

    Args:
        points: (m, n, 3) uint16, m <= 256; the other slots stay empty.
        empty: slots below m that stay empty too.
    """
    return joined_pieces(b"" if slot in empty else encoded_cloud(cloud) for slot, cloud in enumerate(points))


def joined_pieces(clouds: Iterable[bytes]) -> bytes:
    """One shard of clouds that are encoded already, each in its slot; an empty one leaves its slot empty."""
    index = np.full((SHARD, 2), _EMPTY_SLOT, "<u8")
    pieces = list(clouds)
    offset = 0
    for slot, piece in enumerate(pieces):
        if piece:
            index[slot] = offset, len(piece)
            offset += len(piece)
    return b"".join([*pieces, _sealed(index.tobytes())])


def encoded_cloud(points: npt.NDArray[np.uint16]) -> bytes:
    """One cloud as it lies in a shard: a blosc chunk and its CRC32C."""
    from numcodecs import blosc  # type: ignore[import-untyped]

    return _sealed(blosc.compress(points.astype("<u2", copy=False).tobytes(), b"zstd", 3, blosc.BITSHUFFLE, 0, 2))


def decoded_cloud(piece: bytes, n_points: int) -> npt.NDArray[np.uint16] | None:
    """The inverse of `encoded_cloud`; None if the piece is damaged."""
    from numcodecs import blosc

    content = _unsealed(piece)
    if content is None:
        return None
    try:
        points = np.frombuffer(blosc.decompress(content), "<u2")
    except (RuntimeError, ValueError):
        return None
    return points.reshape(n_points, 3) if points.size == 3 * n_points else None


def decoded_slot(shard: bytes, slot: int, n_points: int) -> npt.NDArray[np.uint16] | None:
    """One cloud of a shard, (n_points, 3) uint16; None if it is damaged, or the slot is empty."""
    places = decoded_index(shard[-INDEX_BYTES:])
    if places is None:
        return None
    offset, length = places[slot]
    return decoded_cloud(shard[offset : offset + length], n_points)


def decoded_index(content: bytes) -> list[tuple[int, int]] | None:
    """(offset, length) of the cloud in each slot, from the last `INDEX_BYTES` of a shard; None if it is damaged."""
    index = _unsealed(content)
    if index is None or len(content) != INDEX_BYTES:
        return None
    return [(offset, length) for offset, length in np.frombuffer(index, "<u8").reshape(SHARD, 2).tolist()]


def _encoded_chunk(rows: npt.NDArray[Any]) -> bytes:
    whole = np.zeros((SHARD, rows.shape[1]), rows.dtype)
    whole[: len(rows)] = rows
    return _sealed(whole.tobytes())


def _sealed(content: bytes) -> bytes:
    return content + crc32c(content).to_bytes(4, "little")


def _unsealed(content: bytes) -> bytes | None:
    body, seal = content[:-4], content[-4:]
    return body if len(seal) == 4 and crc32c(body) == int.from_bytes(seal, "little") else None


def _json(content: dict[str, Any]) -> bytes:
    return json.dumps(content, indent=2).encode() + b"\n"
