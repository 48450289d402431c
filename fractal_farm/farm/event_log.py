"""The log of a run: one JSON object a line for each event, in logs/<run id>.jsonl of the catalogue."""

from __future__ import annotations

import contextlib
import json
import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import BinaryIO

from fractal_farm.farm.events import Callback, EpochCompleted, Event, Migration

_QUIET_SECONDS = 5.0
_BLOCK = 1 << 16


class EventLog(Callback):
    """Appends events to the log; migrations and epochs are sampled, since a night has a hundred thousand of them.

    A line that a crash or a full disk tore is cut off before the next one; the log is for people, and the run does not
    depend on it.
    """

    def __init__(self, root: Path, run_id: str) -> None:
        path = log_path(root, run_id)
        path.parent.mkdir(exist_ok=True)
        self._file = path.open("ab+", buffering=0)
        self._whole = _end_of_whole_lines(self._file)
        self._last: dict[type, float] = {}

    def on_event(self, event: Event) -> None:
        """Write one line, unless a frequent kind of event was written a moment ago."""
        now = time.time()
        if isinstance(event, EpochCompleted | Migration):
            if now - self._last.get(type(event), 0.0) < _QUIET_SECONDS:
                return
            self._last[type(event)] = now
        line = json.dumps({"at": round(now, 3), "event": type(event).__name__, **asdict(event)}).encode() + b"\n"
        with contextlib.suppress(OSError):
            self._file.truncate(self._whole)
            if self._file.write(line) == len(line):
                self._whole += len(line)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _end_of_whole_lines(file: BinaryIO) -> int:
    size = file.seek(0, os.SEEK_END)
    while size:
        start = max(0, size - _BLOCK)
        file.seek(start)
        newline = file.read(size - start).rfind(b"\n")
        if newline >= 0:
            return start + newline + 1
        size = start
    return 0


def log_path(root: Path, run_id: str) -> Path:
    """Where the log of a run lies."""
    return root / "logs" / f"{run_id}.jsonl"
