"""Design ids by the million: as arrays that numpy sorts and searches, and found by their first digits."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from fractal_farm.errors import FarmError, InputError
from fractal_farm.ifs.design_code import digits_of_code, is_design_code

DIGITS = 32
SHORTEST_PREFIX = 4
_SHOWN = 4
_AFTER_ALL_DIGITS = b"g"

Words = npt.NDArray[np.uint64]


def id_array(column: Any) -> npt.NDArray[np.bytes_]:
    """A column of design ids as (n,) bytes of 32; see `id_pieces` for what is raised."""
    return id_words(column).view(f"S{DIGITS}").ravel()


def id_words(column: Any) -> Words:
    """A column of design_ids as (n, 4) uint64: the 32 digits as they are, eight a word."""
    return np.concatenate(list(id_pieces(column)))


def id_pieces(column: Any) -> Iterator[Words]:
    """`id_words` in pieces that are not copied.

    Raises:
        FarmError: a value that is not 32 digits long.
    """
    yield np.zeros((0, 4), np.uint64)
    for chunk in column.chunks if isinstance(column, pa.ChunkedArray) else [column]:
        if not len(chunk):
            continue
        _, offsets, digits = chunk.buffers()
        ends = np.frombuffer(offsets, np.int32)[chunk.offset : chunk.offset + len(chunk) + 1]
        if chunk.null_count or (np.diff(ends) != DIGITS).any():
            raise FarmError(f"design_id: not {DIGITS} digits in every row; see `farm verify`")
        yield np.ndarray((len(chunk), 4), np.uint64, digits, int(ends[0]))


def checked_prefix(design_id: str) -> str:
    """The first digits of an id as ids have them, from such digits or from a design code.

    Raises:
        InputError: too few, or not digits; a code with an error in it.
    """
    if is_design_code(design_id):
        return digits_of_code(design_id)
    prefix = design_id.lower()
    if len(prefix) < SHORTEST_PREFIX or set(prefix) - set("0123456789abcdef"):
        raise InputError(f"design {design_id!r}: give at least {SHORTEST_PREFIX} hex digits of its id, or its code")
    return prefix


def find_id(ids: npt.NDArray[np.bytes_], design_id: str, root: Path) -> int:
    """Place of a design in ascending ids.

    Args:
        ids: (n,) bytes of 32, ascending, all different.
        design_id: 32 hex digits, or the first four or more if no other id begins with them, or its code.
        root: the catalogue, for messages.

    Raises:
        InputError: no such id, or several.
    """
    prefix = checked_prefix(design_id)
    low, high = np.searchsorted(ids, [prefix.encode(), prefix.encode() + _AFTER_ALL_DIGITS]).tolist()
    if low == high:
        raise InputError(f"{root}: no design {design_id}; `farm list` shows the designs")
    if high - low > 1:
        shown = ", ".join(found.decode() for found in ids[low : min(high, low + _SHOWN)].tolist())
        raise InputError(f"{root}: {high - low} designs begin with {design_id}: {shown} ...; give more digits")
    return int(low)
