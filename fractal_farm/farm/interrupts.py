"""Ctrl-C and SIGTERM: the first asks the run to end at its last complete epoch, the second ends it at once.

Once it ends at once, further signals change nothing: the workers are being sent away. Before the run begins Ctrl-C ends
the command; should Python raise it where nobody can catch it (in a callback of an import, say), the run hears of it.
"""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType

_early: list[str] = []
"""Signals that came before there was a run."""


@contextlib.contextmanager
def listening() -> Iterator[None]:
    """From the start of a command on: remember Ctrl-C besides raising it."""

    def handle(_number: int, _frame: FrameType | None) -> None:
        _early.append("interrupted")
        raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    if before is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _early.clear()


@contextlib.contextmanager
def interrupts() -> Iterator[Callable[[], str | None]]:
    """Watch for signals; install it after Ray has started, which sets handlers of its own.

    Yields:
        A function that says why the run should end, or None.
    """
    reason = list(_early[:1])

    def handle(number: int, _frame: FrameType | None) -> None:
        reason.append("interrupted" if number == signal.SIGINT else "asked to end (SIGTERM)")
        if len(reason) == 2:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: reason[0] if reason else None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
