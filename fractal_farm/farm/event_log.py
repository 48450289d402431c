"""The log of a run: one JSON object a line for each event, in logs/<run id>.jsonl of the catalogue."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fractal_farm.farm.events import Callback, EpochCompleted, Event, Migration

_QUIET_SECONDS = 5.0


class EventLog(Callback):
    """Appends events to the log; migrations and epochs are sampled, since a night has a hundred thousand of them."""

    def __init__(self, root: Path, run_id: str) -> None:
        path = log_path(root, run_id)
        path.parent.mkdir(exist_ok=True)
        self._file = path.open("a", buffering=1)
        self._last: dict[type, float] = {}

    def on_event(self, event: Event) -> None:
        """Write one line, unless a frequent kind of event was written a moment ago."""
        now = time.time()
        if isinstance(event, EpochCompleted | Migration):
            if now - self._last.get(type(event), 0.0) < _QUIET_SECONDS:
                return
            self._last[type(event)] = now
        line = {"at": round(now, 3), "event": type(event).__name__, **asdict(event)}
        self._file.write(json.dumps(line) + "\n")

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def log_path(root: Path, run_id: str) -> Path:
    """Where the log of a run lies."""
    return root / "logs" / f"{run_id}.jsonl"


def read_log(root: Path, run_id: str) -> Iterator[dict[str, Any]]:
    """The entries of a log, oldest first; a line that was torn by a crash is passed over."""
    try:
        with log_path(root, run_id).open() as lines:
            for line in lines:
                try:
                    yield json.loads(line)
                except ValueError:
                    continue
    except FileNotFoundError:
        return
