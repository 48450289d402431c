"""Ctrl-C and SIGTERM: the first asks the run to end at its last complete epoch, the second ends it at once.

Once it ends at once, further signals change nothing: the workers are being sent away. Before the run begins both end
the command, by exceptions that Python raises wherever it is at the moment. Where nobody can catch them (in what is
called at a fork, by an import, or for dead objects) Python prints them and goes on; `listening` raises them again.
Where another exception takes the place of one (as `shutil.rmtree` can, while Ray starts), `interrupts` raises it again.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

_AGAIN_SECONDS = 0.1


@contextlib.contextmanager
def listening() -> Iterator[None]:
    """From the start of a command to its end: a signal that Python cannot raise comes again a moment later."""
    echoes: list[threading.Timer] = []
    here = threading.current_thread() is threading.main_thread()
    ours = here and signal.getsignal(signal.SIGINT) is signal.default_int_handler

    def hear(lost: sys.UnraisableHookArgs) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt | SystemExit):
            before(lost)
            return
        # Ray's handler of SIGTERM raises SystemExit.
        number = signal.SIGINT if lost.exc_type is KeyboardInterrupt else signal.SIGTERM
        echoes.append(threading.Timer(_AGAIN_SECONDS, os.kill, (os.getpid(), number)))
        echoes[-1].daemon = True
        echoes[-1].start()

    before, sys.unraisablehook = sys.unraisablehook, hear
    if ours:
        signal.signal(signal.SIGINT, _Interrupt())
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.unraisablehook = before
        for echo in echoes:
            echo.cancel()


@contextlib.contextmanager
def interrupts() -> Iterator[Callable[[], str | None]]:
    """Watch for signals; install it after Ray has started, which sets handlers of its own.

    Yields:
        A function that says why the run should end, or None.

    Raises:
        KeyboardInterrupt: An earlier one, since `listening`, never arrived.
    """
    reason: list[str] = []

    def handle(number: int, _frame: FrameType | None) -> None:
        reason.append("interrupted" if number == signal.SIGINT else "asked to end (SIGTERM)")
        if len(reason) == 2:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        earlier = before[signal.SIGINT]
        if isinstance(earlier, _Interrupt) and earlier.came:
            raise KeyboardInterrupt
        yield lambda: reason[0] if reason else None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Interrupt:
    """Python's own handler of SIGINT, with a memory."""

    def __init__(self) -> None:
        self.came = False

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        self.came = True
        raise KeyboardInterrupt
