"""Ctrl-C and SIGTERM: the first asks the run to end at its last complete epoch, the second ends it at once.

Once it ends at once, further signals change nothing: the workers are being sent away.
"""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType


@contextlib.contextmanager
def interrupts() -> Iterator[Callable[[], str | None]]:
    """Watch for signals; install it after Ray has started, which sets handlers of its own.

    Yields:
        A function that says why the run should end, or None.
    """
    reason: list[str] = []

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
