"""Ctrl-C and SIGTERM: the first asks the run to end at its last complete epoch, the second ends it at once.

Once it ends at once, further signals change nothing: the workers are being sent away. Before the run begins both end
the command, by exceptions that Python raises wherever it is at the moment. Where nobody can catch them (in what is
called at a fork, by an import, or for dead objects) Python prints them and goes on; `listening` keeps them for the run.
"""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType

_SIGINT = "interrupted"
_SIGTERM = "asked to end (SIGTERM)"
_early: list[str] = []
"""Signals that were lost before there was a run."""


@contextlib.contextmanager
def listening() -> Iterator[None]:
    """From the start of a command to its end: remember what Python cannot raise."""

    def hear(lost: sys.UnraisableHookArgs) -> None:
        if issubclass(lost.exc_type, KeyboardInterrupt | SystemExit):  # Ray's handler of SIGTERM raises the latter
            _early.append(_SIGINT if lost.exc_type is KeyboardInterrupt else _SIGTERM)
        else:
            before(lost)

    before, sys.unraisablehook = sys.unraisablehook, hear
    try:
        yield
    finally:
        sys.unraisablehook = before
        _early.clear()


def heed() -> None:
    """Raise what was lost.

    Raises:
        KeyboardInterrupt: somebody has asked for the end.
    """
    if _early:
        raise KeyboardInterrupt


@contextlib.contextmanager
def interrupts() -> Iterator[Callable[[], str | None]]:
    """Watch for signals; install it after Ray has started, which sets handlers of its own.

    Yields:
        A function that says why the run should end, or None.
    """
    reason = list(_early[:1])

    def handle(number: int, _frame: FrameType | None) -> None:
        reason.append(_SIGINT if number == signal.SIGINT else _SIGTERM)
        if len(reason) == 2:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: reason[0] if reason else None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
