"""Shape descriptor: what a cloud looks like, whatever its place, size, orientation and handedness (DESIGN section 8).

Twelve quantiles of the distance between two points of the cloud (the shape distribution D2 of Osada et al. 2002), in
units of its root mean square, and the ratios of the principal standard deviations, smallest and middle to largest.
A quantile here is the mean over a twelfth of the pairs: where the distribution has gaps, as Cantor-like shapes have,
the value at one rank jumps from cloud to cloud, and the mean does not.

Pairs follow a lattice: of the points in Morton order, point i meets point (a i + b) mod n with a near the golden
section of n. Thus 2 n pairs cover the product of the cloud with itself evenly, and tell as much as all pairs do. They
are sorted by a histogram of squared distances in 64 bins an octave, the leading bits of the float32.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.fitness.cloud_frame import fit_frame, new_frame_workspace
from fractal_farm.fitness.morton import gather, new_morton_workspace, sort_by_key
from fractal_farm.fitness.points import as_cloud
from fractal_farm.fitness.simd import EXPONENT_BIAS, FRACTION_BITS
from fractal_farm.ifs.kernel import kernel

N_QUANTILES = 12
LENGTH = N_QUANTILES + 2

_GOLDEN_SECTION = 0.6180339887498949
_ROUNDS = 2  # pairs for each point
_SHIFT = 17  # float32 bits that are not in the number of a bin, which leaves 64 bins an octave
_PER_OCTAVE = 1 << (FRACTION_BITS - _SHIFT)
_FIRST = (EXPONENT_BIAS - 46) * _PER_OCTAVE  # bin of d^2 = 2^-46, the square of the coordinates' grid
_BINS = 49 * _PER_OCTAVE  # up to d^2 < 8
_LAST = np.int32(_BINS - 1)


class DescriptorWorkspace(NamedTuple):
    """Memory for the descriptor of one cloud of n points.

    Attributes:
        squares: (n,) float32 squared distances.
        bits: (n,) uint32, the same memory.
        roots: (n,) float64, distances.
        bins: (n,) int32, their bins.
        pairs: (3136,) int64, number of pairs in each bin.
        distances: (3136,) float64, sum of their distances.
    """

    squares: npt.NDArray[np.float32]
    bits: npt.NDArray[np.uint32]
    roots: npt.NDArray[np.float64]
    bins: npt.NDArray[np.int32]
    pairs: npt.NDArray[np.int64]
    distances: npt.NDArray[np.float64]


def new_descriptor_workspace(n: int) -> DescriptorWorkspace:
    """Working space for clouds of n points."""
    squares = np.empty(n, np.float32)
    return DescriptorWorkspace(
        squares,
        squares.view(np.uint32),
        np.empty(n),
        np.empty(n, np.int32),
        np.empty(_BINS, np.int64),
        np.empty(_BINS),
    )


def shape_descriptor(points: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """Descriptor of the shape of a cloud; the Euclidean distance of two descriptors compares two shapes.

    Args:
        points: (n, 3) real array, n >= 2, in any order.

    Returns:
        (14,) float32: mean pair distances of twelve equal shares of the pairs, ascending, over the root mean square
        pair distance; then the smallest and the middle principal standard deviation over the largest, in [0, 1]. All
        0 if the cloud is a single point.

    Raises:
        InputError: the points are not an (n, 3) table of finite numbers.
    """
    cloud = as_cloud(points)
    n = cloud.shape[1]
    frame = new_frame_workspace()
    coordinates, ordered = np.empty((3, n), np.float32), np.empty((3, n), np.float32)
    descriptor = np.zeros(LENGTH, np.float32)
    _describe_cloud(
        cloud, frame, coordinates, new_morton_workspace(n), ordered, new_descriptor_workspace(n), descriptor
    )
    return descriptor


@kernel
def _describe_cloud(cloud, frame, coordinates, morton, ordered, work, descriptor):
    n = cloud.shape[1]
    if fit_frame(cloud, frame, coordinates):
        sort_by_key(coordinates, n, np.float32(1.0), morton)
        gather(coordinates, morton.keys, n, ordered)
        describe(ordered, n, frame.variances, work, descriptor)


@kernel
def describe(points, n, variances, work, descriptor):
    """Fill a descriptor.

    Args:
        points: (3, m) float32 coordinates of a cloud in its frame, of which the first n count, in Morton order.
        n: number of points, at least 2.
        variances: (3,) float64 along the principal axes, descending.
        work: `DescriptorWorkspace` of at least n points.
        descriptor: (14,) float32, filled.
    """
    squares, bits, roots, bins = work.squares, work.bits, work.roots, work.bins
    pairs, distances = work.pairs, work.distances
    pairs[:] = 0
    distances[:] = 0.0
    step = _lattice_step(n)
    total = 0.0
    for r in range(_ROUNDS):
        _squared_distances(points, n, step, r * n // _ROUNDS, squares)
        for i in range(n):  # in loops of their own these take several points at a time
            roots[i] = math.sqrt(np.float64(squares[i]))
            bins[i] = min(max(np.int32(bits[i] >> np.uint32(_SHIFT)) - np.int32(_FIRST), np.int32(0)), _LAST)
        for i in range(n):
            b = np.uint32(bins[i])
            total += squares[i]
            pairs[b] += 1
            distances[b] += roots[i]
    quantile_means(pairs, distances, _ROUNDS * n, descriptor)
    root_mean_square = math.sqrt(total / (_ROUNDS * n))
    for q in range(N_QUANTILES):
        descriptor[q] /= root_mean_square
    for k in range(2):
        descriptor[N_QUANTILES + k] = math.sqrt(variances[2 - k] / variances[0]) if variances[0] > 0.0 else 0.0


@kernel
def _lattice_step(n):
    """The first number from the golden section of n on that has no factor in common with n."""
    step = max(1, int(_GOLDEN_SECTION * n))
    while True:
        a = n
        b = step
        while b != 0:
            a, b = b, a % b
        if a == 1:
            return step
        step += 1


@kernel
def _squared_distances(points, n, step, offset, squares):
    """Squared distance of every point i to point (step i + offset) mod n, or the next one if that is i itself."""
    j = offset
    for i in range(n):
        k = j
        if k == i:
            k = k + 1 if k + 1 < n else 0
        x = points[0, i] - points[0, k]
        y = points[1, i] - points[1, k]
        z = points[2, i] - points[2, k]
        squares[i] = x * x + y * y + z * z
        j += step
        if j >= n:
            j -= n


@kernel
def quantile_means(pairs, distances, total, descriptor):
    """Means of the distances over twelve equal shares of the pairs, in ascending order."""
    share = total / N_QUANTILES
    b = -1
    left = 0.0
    mean = 0.0
    for q in range(N_QUANTILES):
        missing = share
        gathered = 0.0
        while missing > 0.0:
            while left <= 0.0 and b + 1 < pairs.size:
                b += 1
                left = float(pairs[b])
                mean = distances[b] / left if left > 0.0 else mean
            taken = min(left, missing) if left > 0.0 else missing
            gathered += taken * mean
            missing -= taken
            left -= taken
        descriptor[q] = gathered / share
