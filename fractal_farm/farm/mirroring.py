"""Beside a run: a thread that keeps the mirror of its catalogue (DESIGN section 9).

Evolution and writer never wait for it. While the object store does not answer it tries again, for as long as the run
lives; in the end the run gives it some time to catch up, and says how far it has come.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from fractal_farm.catalogue.mirror import (
    MIRROR_STATE,
    Backlog,
    LeaseLostError,
    StoreError,
    Uploader,
    check_target,
    kept,
    write_state,
)
from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError, InputError
from fractal_farm.farm.events import Callback, Event, Fault, MeshFinished, MirrorChanged, PartCommitted, RunEnded

_LOOK_SECONDS = 15.0
_PAUSE_SECONDS = 1.0
_FIRST_RETRY_SECONDS, _LAST_RETRY_SECONDS = 1.0, 60.0
_TELL_SECONDS = 1.0
_SILENT_SECONDS = 30.0
_CATCH_UP_SECONDS = 600.0


def check_mirror(config: RunConfig, root: Path, *, new: bool) -> None:
    """Refuse a mirror that cannot be, before anything is made or started.

    Args:
        config: of the run.
        root: the catalogue; it need not exist.
        new: a new run must reach its mirror; one that goes on may find it silent, and tries again.

    Raises:
        InputError: what to correct.
    """
    url = config.catalogue.mirror
    if url is None:
        return
    try:
        check_target(url, root)
    except StoreError as error:
        if new:
            raise InputError(
                f"{error}; look at AWS_ENDPOINT_URL and AWS_REGION, or leave catalogue.mirror out"
            ) from None


@contextlib.contextmanager
def mirroring(config: RunConfig, root: Path, announce: Callable[[Event], None]) -> Iterator[Mirroring | None]:
    """Keep the mirror of a run's catalogue, if it is to have one, while the context lasts.

    However the run ends, but for a second Ctrl-C, the mirror gets its time to catch up.

    Args:
        config: of the run.
        root: the catalogue.
        announce: hears when the mirror falls silent, and when it answers again.

    Raises:
        InputError: the mirror is another catalogue's, or another process keeps it.
    """
    url = config.catalogue.mirror
    if url is None:
        (root / MIRROR_STATE).unlink(missing_ok=True)  # of an earlier session
        yield None
        return
    mirror = Mirroring(root, url, f"run {config.name} ({config.run_id})", announce)
    try:
        mirror.start()
        yield mirror
    except Exception:
        mirror.finish()
        raise
    finally:
        mirror.leave()


class Mirroring(Callback):
    """The thread; a callback, since what the run does tells when there is something to do."""

    def __init__(self, root: Path, url: str, holder: str, announce: Callable[[Event], None]) -> None:
        self._root = root
        self._url = url
        self._holder = holder
        self._announce = announce
        self._news: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._wake = threading.Event()
        self._ending = threading.Event()
        self._leaving = threading.Event()
        self._complete = False
        self._kept = contextlib.ExitStack()
        self._uploader: Uploader | None = None
        self._backlog = Backlog(0, 0)
        self._arrived = 0
        self._told = self._moved = 0.0
        self._thread = threading.Thread(target=self._work, name="mirror")

    def start(self) -> None:
        """Take the mirror into our hands, if it answers, and begin.

        Raises:
            InputError: it is another's.
        """
        with contextlib.suppress(StoreError):
            self._connect()
        self._thread.start()

    def on_event(self, event: Event) -> None:
        """Look for new files after what makes them; pass on what the thread has to say."""
        if isinstance(event, PartCommitted | MeshFinished | RunEnded):
            self._wake.set()
        while not self._news.empty():
            self._announce(self._news.get())

    def finish(self) -> MirrorChanged:
        """Wait until the mirror is complete, or no file has arrived for half a minute, or ten minutes have passed.

        Returns:
            What it lacks, and why; no file and no cause if it is complete.
        """
        self._ending.set()
        self._wake.set()
        begun = self._moved = time.monotonic()
        while self._thread.is_alive():
            now = time.monotonic()
            if now - self._moved > _SILENT_SECONDS or now - begun > _CATCH_UP_SECONDS:
                break
            self._thread.join(0.1)
        if self._complete:
            return MirrorChanged(self._url, 0, 0, None)
        lacks = self._backlog
        return MirrorChanged(self._url, lacks.files, lacks.bytes, lacks.cause or "it is slow, or was far behind")

    def leave(self) -> None:
        """End the thread, soon."""
        self._leaving.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(_PAUSE_SECONDS)

    def _work(self) -> None:
        pause_s = _FIRST_RETRY_SECONDS
        with self._kept:
            while not self._leaving.is_set() and not self._complete:
                last = self._ending.is_set()
                self._wake.clear()
                try:
                    self._connect().catch_up(self._progress, everything=last)
                except Exception as error:  # a library's own must not end the thread
                    self._fail(error)
                    if isinstance(error, LeaseLostError):
                        return
                    self._leaving.wait(pause_s)
                    pause_s = min(2 * pause_s, _FIRST_RETRY_SECONDS if last else _LAST_RETRY_SECONDS)
                    continue
                pause_s = _FIRST_RETRY_SECONDS
                self._note(Backlog(0, 0))
                self._complete = last
                if not last:
                    self._wake.wait(_LOOK_SECONDS)
                    self._ending.wait(_PAUSE_SECONDS)

    def _connect(self) -> Uploader:
        """Become who keeps the mirror, unless we are."""
        if self._uploader is None:
            place = kept(self._root, self._url, self._holder, lambda *line: self._say(Fault("mirror", *line)))
            self._uploader = self._kept.enter_context(place)
        return self._uploader

    def _progress(self, backlog: Backlog) -> None:
        assert self._uploader is not None
        if self._uploader.arrived == self._arrived:  # nothing yet: what was amiss may still be
            backlog = replace(backlog, cause=self._backlog.cause)
        else:
            self._arrived = self._uploader.arrived
            self._moved = time.monotonic()
        self._note(backlog)

    def _fail(self, error: Exception) -> None:
        cause = str(error) if isinstance(error, FarmError) else f"{type(error).__name__}: {error}"
        self._note(replace(self._backlog, cause=" ".join(cause.split())))

    def _note(self, backlog: Backlog) -> None:
        """Remember how far the mirror is behind, and tell; a change of its condition is an event."""
        changed = (backlog.cause is None) != (self._backlog.cause is None)
        self._backlog = backlog
        if changed:
            self._say(MirrorChanged(self._url, backlog.files, backlog.bytes, backlog.cause))
        moment = time.monotonic()
        if changed or backlog.files == 0 or moment - self._told >= _TELL_SECONDS:
            self._told = moment
            with contextlib.suppress(FarmError):
                write_state(self._root, self._url, backlog)

    def _say(self, event: Event) -> None:
        """Announce an event; callbacks are called in the driver's own thread alone."""
        if threading.current_thread() is self._thread:
            self._news.put(event)
        else:
            self._announce(event)
