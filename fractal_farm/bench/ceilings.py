"""What this machine can do at best: the limits that the stages of an evaluation are held against.

The clock is taken from a chain of instructions of one cycle each, the bandwidth from copies within the cache, and the
latency of the random iteration from its own recurrence without the choice of a map.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fractal_farm.bench.stopwatch import shortest
from fractal_farm.ifs.kernel import kernel

_CHAIN = 100_000
_CYCLES_A_STEP = 6  # three shifts and three exclusive ors, each in need of the one before
_COPIED = 40_000  # bytes: what one stage reads of 5,000 points
_REPEATED = 50
_SHIFTS = (np.uint64(13), np.uint64(7), np.uint64(17))  # Marsaglia's xorshift


@dataclass(frozen=True)
class Ceilings:
    """Limits of one core.

    Attributes:
        clock: cycles a second.
        bandwidth: bytes a second, read and written, within the cache.
        recurrence: seconds for each step of x -> A x + b, one after the other.
    """

    clock: float
    bandwidth: float
    recurrence: float


def measure_ceilings() -> Ceilings:
    """Measure them, in under a second."""
    source, target = np.ones(_COPIED // 8), np.empty(_COPIED // 8)
    row = np.array([0.5, 0.1, 0.1, 1.0, -0.1, 0.5, 0.1, 1.0, -0.1, -0.1, 0.5, 1.0])
    points = np.empty((3, _CHAIN))
    return Ceilings(
        _CYCLES_A_STEP * _CHAIN / shortest(lambda: _chain(np.uint64(1), _CHAIN)),
        2.0 * _COPIED * _REPEATED / shortest(lambda: _copy(source, target, _REPEATED)),
        shortest(lambda: _recur(row, points)) / _CHAIN,
    )


@kernel
def _chain(x, n):
    for _ in range(n):
        x ^= x << _SHIFTS[0]
        x ^= x >> _SHIFTS[1]
        x ^= x << _SHIFTS[2]
    return x


@kernel
def _copy(source, target, times):
    for k in range(times):
        for i in range(source.size):
            target[i] = source[i]
        target[k] += 1.0  # or the copies would be one


@kernel
def _recur(m, points):
    x = y = z = 0.0
    for t in range(points.shape[1]):
        x, y, z = (
            m[0] * x + m[1] * y + m[2] * z + m[3],
            m[4] * x + m[5] * y + m[6] * z + m[7],
            m[8] * x + m[9] * y + m[10] * z + m[11],
        )
        points[0, t] = x
        points[1, t] = y
        points[2, t] = z
