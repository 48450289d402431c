"""Stages of the making of a solid, for whoever waits for it: a bar, a log, the stopwatch of `farm bench --solids`."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called as each stage begins, with its name and the share of the work that is usually done by then, 0 to 1."""

Begin = Callable[[str], None]

STAGES = {
    "gap": 0.0,
    "cover": 0.02,
    "distance field": 0.3,
    "one body": 0.55,
    "marching cubes": 0.6,
    "simplify": 0.65,
    "made": 1.0,
}
"""In order; the shares are those of a large solid. "made" is the end."""


def ignore(name: str) -> None:
    """Nobody waits."""


def beginner(progress: Progress | None) -> Begin:
    """What tells `progress` of a stage by its name."""
    return ignore if progress is None else lambda name: progress(name, STAGES[name])
