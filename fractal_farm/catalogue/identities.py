"""Design ids by the million: as arrays that numpy sorts and searches, and found by their first digits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.errors import FarmError, InputError

DIGITS = 32

_SHORTEST_PREFIX = 4
_SHOWN = 4
_AFTER_ALL_DIGITS = b"g"


def id_array(column: Any) -> npt.NDArray[np.bytes_]:
    """A column of design ids as (n,) bytes of 32.

    Raises:
        FarmError: a value that is not 32 digits long.
    """
    if not len(column):
        return np.empty(0, f"S{DIGITS}")
    whole = pa.chunked_array(column.chunks if isinstance(column, pa.ChunkedArray) else [column]).combine_chunks()
    whole = whole.chunk(0) if isinstance(whole, pa.ChunkedArray) else whole
    lengths = pc.binary_length(whole)
    if pc.min(lengths).as_py() != DIGITS or pc.max(lengths).as_py() != DIGITS or whole.null_count:
        raise FarmError(f"design ids: not {DIGITS} digits in every row; `farm verify` finds what is damaged")
    start = np.frombuffer(whole.buffers()[1], np.int32, 1, 4 * whole.offset)[0]
    return np.frombuffer(whole.buffers()[2], f"S{DIGITS}", len(whole), int(start))


def find_id(ids: npt.NDArray[np.bytes_], design_id: str, root: Path) -> int:
    """Place of a design in ascending ids.

    Args:
        ids: (n,) bytes of 32, ascending, all different.
        design_id: 32 hex digits, or the first four or more if no other id begins with them.
        root: the catalogue, for messages.

    Raises:
        InputError: no such id, or several.
    """
    prefix = design_id.lower()
    if len(prefix) < _SHORTEST_PREFIX or set(prefix) - set("0123456789abcdef"):
        raise InputError(f"design {design_id!r}: give at least {_SHORTEST_PREFIX} hex digits of its id")
    low, high = np.searchsorted(ids, [prefix.encode(), prefix.encode() + _AFTER_ALL_DIGITS]).tolist()
    if low == high:
        raise InputError(f"{root}: no design {design_id}; `farm list` shows the designs")
    if high - low > 1:
        shown = ", ".join(found.decode() for found in ids[low : min(high, low + _SHOWN)].tolist())
        raise InputError(f"{root}: {high - low} designs begin with {design_id}: {shown} ...; give more digits")
    return int(low)
