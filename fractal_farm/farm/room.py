"""Room on the disk: while there is none the farm waits, and goes on by itself when there is (DESIGN section 5)."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path

_RETRY_SECONDS = 3.0


class Room:
    """Whether more may be written to a catalogue."""

    def __init__(self, root: Path, min_free_gb: float, announce: Callable[[str | None], None]) -> None:
        """Begin with room.

        Args:
            root: the catalogue.
            min_free_gb: nothing new is begun while less than this is free.
            announce: hears why the farm waits, once, and None when it goes on.
        """
        self._root = root
        self._min_free_gb = min_free_gb
        self._announce = announce
        self._refused = False
        self._next_try = 0.0
        self._waiting = False

    def refuse(self, cause: str) -> None:
        """A write found no space; `due` says when to try again."""
        self._refused = True
        self._next_try = time.monotonic() + _RETRY_SECONDS
        self._tell(cause)

    def accept(self) -> None:
        """A write found space."""
        self._refused = False

    @property
    def due(self) -> bool:
        """Whether a write that was refused should be tried again."""
        return time.monotonic() >= self._next_try

    def is_short(self) -> bool:
        """Whether nothing new may be begun now."""
        free_gb = shutil.disk_usage(self._root).free / 1e9
        low = free_gb < self._min_free_gb
        if low:
            self._tell(f"only {free_gb:.2g} GB are free, less than catalogue.min_free_gb {self._min_free_gb:g}")
        elif not self._refused:
            self._tell(None)
        return low or self._refused

    def _tell(self, cause: str | None) -> None:
        if (cause is not None) != self._waiting:
            self._waiting = cause is not None
            self._announce(cause)
