"""What is said when a process is caught inside Ray.

A thread that waits inside Ray for a dead head cannot be woken; after a minute Ray ends the whole process, with words
of its own. These watchers end it earlier, with a line that helps. Nothing is lost: the farm is crash-only.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
from collections.abc import Iterator

_HEAD = "gcs_server"
_LOOK_SECONDS = 0.1
_GRACE_SECONDS = 5.0


def end_at_once(reason: str) -> None:
    """End this process with a line on stderr and exit code 1."""
    os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, f"farm: error: {reason}\n".encode())
    os._exit(1)


@contextlib.contextmanager
def watched_start() -> Iterator[None]:
    """While Ray starts inside this process: end it when Ray's head dies and the start does not notice."""
    over = threading.Event()
    threading.Thread(target=_watch, args=(over,), name="start of Ray", daemon=True).start()
    try:
        yield
    finally:
        over.set()


def _watch(over: threading.Event) -> None:
    seen = False
    while not over.wait(_LOOK_SECONDS):
        alive = _head_lives()
        if seen and not alive:
            if not over.wait(_GRACE_SECONDS):
                end_at_once("Ray's own gcs_server died while Ray started; give the same command again")
            return
        seen = seen or alive


def _head_lives() -> bool:
    import psutil

    for child in psutil.Process().children():
        with contextlib.suppress(psutil.Error):
            if child.name() == _HEAD and child.status() != psutil.STATUS_ZOMBIE:
                return True
    return False
