"""Times of short functions, and what else went on meanwhile."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fractal_farm.fitness.simd import instruction_set

_LOAD = Path("/proc/loadavg")
_PROCESSORS = Path("/proc/cpuinfo")


@dataclass(frozen=True)
class Machine:
    """Where measurements were taken.

    Attributes:
        processor: its name.
        cores: that this process may use.
        instruction_set: that kernels are compiled for.
        python: its version.
    """

    processor: str
    cores: int
    instruction_set: str
    python: str


def this_machine() -> Machine:
    """The machine at hand."""
    names = [line.partition(":")[2].strip() for line in _lines(_PROCESSORS) if line.startswith("model name")]
    return Machine(
        names[0] if names else platform.machine(),
        len(os.sched_getaffinity(0)),
        instruction_set(),
        platform.python_version(),
    )


def load() -> float:
    """Mean number of processes that ran or waited in the last minute."""
    return float(_lines(_LOAD)[0].split()[0])


def shortest(function: Callable[[], object], budget: float = 0.2, fewest: int = 3) -> float:
    """Shortest processor time of one call, in seconds.

    Args:
        function: what to time; called once before, so that it is compiled and its memory is warm.
        budget: seconds to spend on repetitions.
        fewest: repetitions in any case.
    """
    function()
    best = float("inf")
    spent = 0.0
    count = 0
    while count < fewest or spent < budget:
        start = time.thread_time()
        function()
        taken = time.thread_time() - start
        best = min(best, taken)
        spent += taken
        count += 1
    return best


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text().splitlines()
    except OSError:
        return ["0 0 0"]
