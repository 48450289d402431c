"""Memory of processes that live for a night and whose arrays grow all the time."""

from __future__ import annotations

import contextlib
import ctypes

_M_MMAP_THRESHOLD = -3  # of mallopt(3)
_LARGE_BYTES = 128 * 1024


def return_large_arrays() -> None:
    """Let the C library give large arrays back to the system as soon as they are freed, in this process.

    By itself glibc keeps more and more of them, in pieces that the next ones, which are larger, do not fit into: an
    archive that grows takes more than twice the memory of its data. Other C libraries do without. Not for processes
    that evaluate solids, which take a third more time when each of their grids gets new memory.
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
