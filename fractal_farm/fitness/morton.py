"""Morton order: points sorted along the Z curve, so that neighbours in memory are neighbours in space.

A key interleaves ten bits of each coordinate. Its leading 3 l bits number the box of side 2^-l that holds the point,
for every level l at once: one radix sort serves the box counts of all levels, and the pair counts.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.kernel import kernel

LEVELS = 10
_DIGITS = 1 << LEVELS
INDEX_BITS = 32  # below a key, the number of the point
# The bits of a 10-bit number in groups of 8, 4, 2 and 1, with gaps of twice as many zeros.
_BY_8 = np.uint32(0x030000FF)
_BY_4 = np.uint32(0x0300F00F)
_BY_2 = np.uint32(0x030C30C3)
_BY_1 = np.uint32(0x09249249)


class MortonWorkspace(NamedTuple):
    """Memory for sorting up to n points.

    Attributes:
        keys: (n,) uint64, key << 32 | index of the point; in key order after `sort_by_key`.
        spare: (n,) uint64.
        histogram: (3, 1024) uint32.
    """

    keys: npt.NDArray[np.uint64]
    spare: npt.NDArray[np.uint64]
    histogram: npt.NDArray[np.uint32]


def new_morton_workspace(n: int) -> MortonWorkspace:
    """Working space for up to n points."""
    return MortonWorkspace(np.empty(n, np.uint64), np.empty(n, np.uint64), np.empty((3, _DIGITS), np.uint32))


@kernel
def sort_by_key(frame, n, cube, work):
    """Fill work.keys with (30-bit Morton key << 32 | index), sorted; equal keys keep the order of the points.

    Args:
        frame: (3, m) float32 coordinates in [0, 1], of which n points count.
        n: number of points.
        cube: float32 side of the cube that is halved `LEVELS` times, at least 1, with a corner at the origin.
        work: `MortonWorkspace` of at least n points.
    """
    keys, spare, histogram = work.keys, work.spare, work.histogram
    scale = np.float32(_DIGITS) / cube
    for i in range(n):
        key = _spread(_digit(frame[0, i], scale))
        key |= _spread(_digit(frame[1, i], scale)) << np.uint32(1)
        key |= _spread(_digit(frame[2, i], scale)) << np.uint32(2)
        spare[i] = np.uint64(key) << np.uint64(INDEX_BITS) | np.uint64(i)
    histogram[:] = np.uint32(0)
    for i in range(n):
        for p in range(3):
            histogram[p, _radix_digit(spare[i], p)] += np.uint32(1)
    for p in range(3):
        total = np.uint32(0)
        for d in range(_DIGITS):
            here = histogram[p, d]
            histogram[p, d] = total
            total += here
        if p % 2 == 0:
            _scatter(spare, n, p, histogram, keys)
        else:
            _scatter(keys, n, p, histogram, spare)


@kernel
def gather(frame, keys, n, points):
    """The first n points of a frame (3, m) in the order of sorted keys, into points (3, k) float32, k >= n."""
    for axis in range(3):
        for i in range(n):
            points[axis, i] = frame[axis, np.uint32(keys[i])]


@kernel
def _scatter(source, n, p, histogram, target):
    """One pass of the radix sort: stable, by digit p, to the places that the histogram's running sums give."""
    for i in range(n):
        d = _radix_digit(source[i], p)
        target[histogram[p, d]] = source[i]
        histogram[p, d] += np.uint32(1)


@kernel(forceinline=True)
def _radix_digit(key, p):
    return (key >> np.uint64(INDEX_BITS + LEVELS * p)) & np.uint64(_DIGITS - 1)


@kernel(forceinline=True)
def _digit(coordinate, scale):
    """Number of the smallest box along one axis; the last one is closed."""
    return min(np.uint32(coordinate * scale), np.uint32(_DIGITS - 1))


@kernel(forceinline=True)
def _spread(x):
    """Ten bits to every third of thirty."""
    x = np.uint32(x)
    x = (x | x << np.uint32(16)) & _BY_8
    x = (x | x << np.uint32(8)) & _BY_4
    x = (x | x << np.uint32(4)) & _BY_2
    return np.uint32((x | x << np.uint32(2)) & _BY_1)
