"""The progress of a run on stderr: a live display on a terminal, plain lines now and then elsewhere."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from fractal_farm.cli.output import byte_count, duration
from fractal_farm.farm.events import (
    Callback,
    Continued,
    Draining,
    EpochCompleted,
    Event,
    Fault,
    MeshFinished,
    MirrorChanged,
    PartCommitted,
    Paused,
    Progress,
    RunEnded,
    RunStarted,
    Steered,
)

_LIMITS = (
    ("epochs", "epochs"),
    ("evaluations", "evaluated"),
    ("qualified", "kept_qualified"),
    ("distinct", "distinct"),
)
_FIRST_INTERVAL_S, _LAST_INTERVAL_S = 5.0, 60.0


@dataclass
class RunView:
    """What is known of a run from its events.

    Attributes:
        started: the event of the beginning, if there was one.
        progress: totals of the last complete epoch.
        rate: evaluations a second in this session.
        files: files in the catalogue at the last commit.
        bytes: their size.
        meshes: solids made in all sessions.
        wanted: how many the run may make; None for every qualified design.
        ending: "ending" or "ended", once it is.
    """

    started: RunStarted | None = None
    progress: Progress = field(default_factory=Progress)
    rate: float = 0.0
    files: int = 0
    bytes: int = 0
    meshes: int = 0
    wanted: int | None = None
    ending: str | None = None
    _began: float = 0.0
    _elapsed_s: float = 0.0
    _heard: float = 0.0
    _first_fraction: float | None = None

    def take(self, event: Event, now: float) -> str | None:
        """Learn from an event; what is worth a line of its own is returned."""
        if isinstance(event, RunStarted):
            self.started, self._began, self._heard = event, now, now
            self.progress, self.meshes = event.progress, event.meshes
            self.files, self.bytes = event.files, event.bytes
            again = f", on from epoch {event.progress.epochs}" if event.progress.epochs else ""
            return (
                f"run {event.name} ({event.run_id}): {event.islands} islands on {event.workers} "
                f"{'worker' if event.workers == 1 else 'workers'} ({event.executor}){again}; "
                f"catalogue {event.path}; {_need(event)}Ctrl-C ends it cleanly"
            )
        if isinstance(event, EpochCompleted):
            self.progress, self.rate = event.progress, event.rate
            self._elapsed_s, self._heard = event.elapsed_s, now
            if self._first_fraction is None:
                self._began, self._first_fraction = now, self.fraction(now)
        elif isinstance(event, PartCommitted):
            self.files, self.bytes = event.total_files, event.total_bytes
        elif isinstance(event, MeshFinished):
            self.meshes, self.wanted = event.done, event.wanted
            return f"no mesh of {event.design_id}: {event.failure}" if event.failure else None
        elif isinstance(event, Paused):
            return f"waiting: {event.cause}"
        elif isinstance(event, Continued):
            return f"going on: {event.reason}"
        elif isinstance(event, MirrorChanged):
            lacks = f"{event.files:,} {'file' if event.files == 1 else 'files'} behind"
            if event.cause is None:
                return f"mirror {event.url}: answers again, {lacks}"
            return f"mirror: {event.cause}; {lacks}, tried again while the run lives"
        elif isinstance(event, Draining):
            self.ending = "ending"
            return f"ending: {event.reason}; committing what is complete"
        elif isinstance(event, Steered):
            chosen = ", ".join(identity[:8] for identity in event.design_ids)
            return f"steered: epochs {event.first} to {event.last} breed from {chosen}, too"
        elif isinstance(event, Fault):
            return f"{event.where}: {event.cause}; {event.remedy}"
        elif isinstance(event, RunEnded):
            self.ending = "ended"
        return None

    def elapsed_s(self, now: float) -> float:
        """Seconds that all sessions have worked."""
        return self._elapsed_s + now - self._heard

    def fraction(self, now: float) -> float | None:
        """How much of the way to the nearest limit is done; None without a limit."""
        if self.started is None:
            return None
        stop = self.started.stop
        shares = [
            getattr(self.progress, value) / limit for name, value in _LIMITS if (limit := stop.get(name)) is not None
        ]
        if (hours := stop.get("hours")) is not None:
            shares.append(self.elapsed_s(now) / (3600.0 * hours))
        return min(1.0, max(shares)) if shares else None

    def left_s(self, now: float) -> float | None:
        """Seconds until the nearest limit, at the pace so far; None while nothing can be said."""
        fraction, first = self.fraction(now), self._first_fraction
        if fraction is None or first is None or fraction <= first:
            return None
        return (now - self._began) * (1.0 - fraction) / (fraction - first)

    def line(self, now: float) -> str:
        """The state of the run in one line."""
        p = self.progress
        wanted = "" if self.wanted is None else f" of {self.wanted}"
        parts = [
            f"epoch {p.epochs}",
            f"{p.evaluated:,} evaluated ({self.rate:,.0f}/s)",
            f"{p.designs:,} designs",
            f"{p.distinct:,} distinct",
            f"best {p.best_fitness:.3f}",
            f"{self.meshes}{wanted} meshes",
            f"{byte_count(self.bytes)} in {self.files} files",
            duration(self.elapsed_s(now)),
        ]
        if self.ending is not None:
            parts.append(self.ending)
        elif self.fraction(now) == 1.0:
            parts.append("meshing")
        elif (left := self.left_s(now)) is not None:
            parts.append(f"{duration(left)} left")
        return ", ".join(parts)


def _need(event: RunStarted) -> str:
    """What the run writes at most, as far as it is known."""
    if event.first_hour_bytes is None:
        return ""
    first, whole = byte_count(event.first_hour_bytes), event.whole_bytes
    if whole is None:
        return f"at most {first} of disk in its first hour; "
    more = f", {first} in its first hour" if whole > event.first_hour_bytes else ""
    return f"at most {byte_count(whole)} of disk{more}; "


@contextlib.contextmanager
def progress_display() -> Iterator[Callback]:
    """A callback that shows a run on stderr while the context lasts."""
    from rich.console import Console

    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    if not console.is_terminal:
        yield _PlainLines(console)
        return
    from rich.live import Live

    display = _LiveDisplay(console)
    with Live(console=console, get_renderable=display.renderable, refresh_per_second=4, transient=True):
        yield display


class _PlainLines(Callback):
    """A line for what matters, and for the state at intervals that grow from 5 to 60 seconds."""

    def __init__(self, console: Any) -> None:
        self._console = console
        self._view = RunView()
        self._last = float("-inf")

    def on_event(self, event: Event) -> None:
        now = time.monotonic()
        remark = self._view.take(event, now)
        if remark is not None:
            self._console.print(remark)
        interval = min(_LAST_INTERVAL_S, max(_FIRST_INTERVAL_S, self._view.elapsed_s(now) / 20))
        due = isinstance(event, (EpochCompleted, MeshFinished)) and now - self._last >= interval
        if due or isinstance(event, RunEnded):
            self._last = now
            self._console.print(self._view.line(now))


class _LiveDisplay(Callback):
    """Two lines at the foot of the terminal, redrawn; what matters scrolls above them."""

    def __init__(self, console: Any) -> None:
        self._console = console
        self._view = RunView()

    def on_event(self, event: Event) -> None:
        remark = self._view.take(event, time.monotonic())
        if remark is not None:
            self._console.print(remark)

    def renderable(self) -> Any:
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        if self._view.started is None:
            return Text("starting")
        now = time.monotonic()
        fraction = self._view.fraction(now)
        bar = ProgressBar(total=1.0, completed=fraction or 0.0, pulse=fraction is None)
        lines = Table.grid(expand=True)
        lines.add_row(bar)
        lines.add_row(Text(self._view.line(now)))
        return lines
