"""How far the making of a solid is: one line on a terminal, nothing elsewhere."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from fractal_farm.cli.output import byte_count


class StageLine:
    """What `make_solid` tells, as a line of text."""

    def __init__(self, name: str, live: Any = None) -> None:
        """A line about something called `name`, on a `rich.live.Live`; nothing is shown on None."""
        self._name = name
        self._live = live
        self._memory = ""
        self.text = ""

    def stage(self, stage: str, share: float) -> None:
        """A stage begins when this share of the work, 0 to 1, is usually done."""
        self._show(f"{self._name}: {stage}, {share:.0%}{self._memory}")

    def memory(self, size: int) -> None:
        """So many bytes will be taken at most."""
        self._memory = f", at most {byte_count(size)} of memory"
        self._show(self.text + self._memory)

    def _show(self, text: str) -> None:
        self.text = text
        if self._live is not None:
            from rich.text import Text

            self._live.update(Text(text), refresh=True)


@contextlib.contextmanager
def stage_line(name: str) -> Iterator[StageLine]:
    """A line on stderr as long as the context lasts, if stderr is a terminal."""
    from rich.console import Console

    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    if not console.is_terminal:
        yield StageLine(name)
        return
    from rich.live import Live

    with Live(console=console, auto_refresh=False, transient=True) as live:
        yield StageLine(name, live)
