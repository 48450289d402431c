"""The content digest: what was found, however it was scheduled, stored or resumed (DESIGN section 4).

blake2b over the rows in order of design_id of (design_id, kind, genes, maps, probabilities, scores, descriptor,
gap, parents, operator, birth place, checksum of the cloud). Times, writers, places of storage and snapshots
stay out.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue.schema import DESCRIPTOR_LENGTH

_TEXTS = ("design_id", "kind", "operator")
_NUMBERS = ("d0", "d2", "lle", "fitness", "gap")
_INTEGERS = ("island", "epoch", "generation", "slot", "cloud_crc32c")
_LISTS = ("genes", "maps", "probabilities", "parents")

DIGEST_COLUMNS = (*_TEXTS, *_NUMBERS, *_INTEGERS, *_LISTS, "descriptor")
BLOCK = 1 << 15
"""Rows that are looked at together."""
_NOTHING = -1
"""Stands for an absent integer, and for the length of an absent list."""


def content_digest(blocks: Iterable[Any]) -> str:
    """32 hex digits over a table of designs.

    Args:
        blocks: the table in pieces: `DIGEST_COLUMNS`, design_ids all different, in their order.
    """
    digest = hashlib.blake2b(digest_size=16, person=b"farm-content-1")
    for block in blocks:
        columns = {name: _single(block.column(name)) for name in DIGEST_COLUMNS}
        pieces = [
            _fixed_width(columns),
            *(columns[name].fill_null("").cast(pa.binary()) for name in _TEXTS),
            *(_list_bytes(columns[name]) for name in _LISTS),
        ]
        digest.update(b"".join(pc.binary_join_element_wise(*pieces, b"").to_pylist()))
    return digest.hexdigest()


def _single(column: Any) -> Any:
    combined = column.combine_chunks()
    return combined.chunk(0) if isinstance(combined, pa.ChunkedArray) else combined


def _fixed_width(columns: dict[str, Any]) -> Any:
    """The numbers of each row and the lengths of what follows, as binary: equal length in every row."""
    count = len(columns["design_id"])
    lengths = [_length(columns[name]) for name in (*_TEXTS, *_LISTS)]
    integers = [_numpy(columns[name].cast(pa.int64()), _NOTHING) for name in _INTEGERS]
    numbers = [_numpy(columns[name], np.nan) for name in _NUMBERS]
    row = np.concatenate(
        [
            np.stack([*lengths, *integers], axis=1).astype("<i8").view(np.uint8).reshape(count, -1),
            np.stack(numbers, axis=1).astype("<f8").view(np.uint8).reshape(count, -1),
            _descriptor(columns["descriptor"]).astype("<f4").view(np.uint8).reshape(count, -1),
        ],
        axis=1,
    )
    offsets = np.arange(count + 1, dtype=np.int32) * row.shape[1]
    return pa.Array.from_buffers(pa.binary(), count, [None, pa.py_buffer(offsets), pa.py_buffer(row.tobytes())])


def _numpy(column: Any, absent: float) -> npt.NDArray[Any]:
    return np.asarray(column.fill_null(pa.scalar(absent, column.type)).to_numpy(zero_copy_only=False))


def _length(column: Any) -> npt.NDArray[Any]:
    measure = pc.binary_length if pa.types.is_string(column.type) else pc.list_value_length
    return _numpy(measure(column).cast(pa.int64()), _NOTHING)


def _descriptor(column: Any) -> npt.NDArray[Any]:
    values = np.full((len(column), DESCRIPTOR_LENGTH), np.nan, np.float32)
    present = column.is_valid().to_numpy(zero_copy_only=False)
    flat = column.drop_null().flatten().to_numpy(zero_copy_only=False)
    values[present] = flat.reshape(-1, DESCRIPTOR_LENGTH)
    return values


def _list_bytes(column: Any) -> Any:
    """A list column as binary, one value a row: the bytes of its float64 elements, or its strings joined."""
    if pa.types.is_string(column.type.value_type):
        return pc.fill_null(pc.binary_join(column, " "), "").cast(pa.binary())
    lengths = np.maximum(_length(column), 0)
    offsets = np.concatenate([[0], np.cumsum(lengths)]) * 8
    values = column.flatten().to_numpy(zero_copy_only=False).astype("<f8")
    buffers = [None, pa.py_buffer(offsets.astype(np.int32)), pa.py_buffer(values.tobytes())]
    return pa.Array.from_buffers(pa.binary(), len(column), buffers)
