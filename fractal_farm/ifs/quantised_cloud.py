"""Clouds as they are stored: 16-bit integers in Morton order (research 'storage', section 1.2).

xyz = origin + scale * q / 65535, one origin and one scale a cloud, both exact in float32. The order of points
carries no information in a cloud; along a Morton curve neighbours in memory are neighbours in space, so that
bit-shuffled bytes compress to 40 % of float32, and every k-th point is a stratified sample. Scores are
computed *before* quantising; the error is at most half a step, 7.7e-6 of the longest side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.ifs.copies import place_copies
from fractal_farm.ifs.genome import MAX_MAPS, ROW_LENGTH, Genome, Phenotype
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.random_iteration import PURPOSES, grow
from fractal_farm.ifs.symmetry import symmetry_codes
from fractal_farm.ifs.system import build_system, new_system, reading_of

STEPS = 65535
_DIGIT_BITS = 12
_BUCKETS = 1 << _DIGIT_BITS
_DIGITS = 4  # of a 48-bit key
# The bits of a 16-bit number in groups of 8, 4, 2 and 1, with gaps of twice as many zeros.
_BY_8 = np.uint64(0x0000FF0000FF)
_BY_4 = np.uint64(0x00F00F00F00F)
_BY_2 = np.uint64(0x0C30C30C30C3)
_BY_1 = np.uint64(0x249249249249)


@dataclass(frozen=True, eq=False)
class QuantisedCloud:
    """One cloud.

    Attributes:
        points: (n, 3) uint16, in Morton order (x is the lowest bit).
        origin: (3,) float32, IFS units, the low corner of the bounding box, rounded down.
        scale: float32, IFS units, longest side of the box, rounded up; 0 if all points are equal.
    """

    points: npt.NDArray[np.uint16]
    origin: npt.NDArray[np.float32]
    scale: np.float32

    def dequantise(self) -> npt.NDArray[np.float64]:
        """(n, 3) float64, IFS units."""
        return dequantise(self.points, self.origin, self.scale)


@dataclass(frozen=True, eq=False)
class QuantisedClouds:
    """A batch of m clouds of n points each.

    Attributes:
        points: (m, n, 3) uint16, each cloud in Morton order.
        origin: (m, 3) float32, IFS units.
        scale: (m,) float32, IFS units.
    """

    points: npt.NDArray[np.uint16]
    origin: npt.NDArray[np.float32]
    scale: npt.NDArray[np.float32]

    def __len__(self) -> int:
        return int(self.points.shape[0])

    def __getitem__(self, index: int) -> QuantisedCloud:
        return QuantisedCloud(self.points[index], self.origin[index], self.scale[index])


def quantise(points: npt.ArrayLike) -> QuantisedCloud:
    """One cloud as 16-bit integers in Morton order.

    Args:
        points: (n, 3) finite numbers, IFS units, n >= 1.

    Raises:
        InputError: another shape, or a coordinate that is not finite or beyond float32.
    """
    return quantise_clouds(np.asarray(points, dtype=np.float64)[np.newaxis])[0]


def quantise_clouds(points: npt.ArrayLike) -> QuantisedClouds:
    """A batch of clouds as 16-bit integers, in one call without the GIL.

    Args:
        points: (m, n, 3) finite numbers, IFS units, n >= 1.

    Raises:
        InputError: another shape, or a coordinate that is not finite or beyond float32.
    """
    given = np.ascontiguousarray(points, dtype=np.float64)
    if given.ndim != 3 or given.shape[2] != 3 or given.shape[1] < 1:
        raise InputError(f"points: shape {given.shape[1:]}; a cloud is (n, 3) with at least one point")
    clouds = empty_clouds(given.shape[0], given.shape[1])
    failed = quantise_batch(given, clouds.points, clouds.origin, clouds.scale)
    if failed >= 0:
        raise InputError(f"points: cloud {failed} has coordinates that are not finite or exceed float32")
    return clouds


def quantised_attractors(genomes: Sequence[Genome], n_points: int, purpose: str = "fitness") -> QuantisedClouds:
    """The clouds of `attractor_points`, grown and quantised without an intermediate copy for each.

    Args:
        genomes: m valid genomes.
        n_points: points of each cloud, at least 1.
        purpose: one of `random_iteration.PURPOSES`.

    Raises:
        InputError: a genome that cannot be iterated, or whose points exceed float32; n_points below 1.
    """
    if n_points < 1:
        raise InputError(f"n_points is {n_points}; a cloud has at least 1 point")
    if purpose not in PURPOSES:
        raise InputError(f"purpose is {purpose!r}; choose one of {', '.join(PURPOSES)}")
    clouds = empty_clouds(len(genomes), n_points)
    by_phenotype: dict[Phenotype, list[int]] = {}
    for index, genome in enumerate(genomes):
        by_phenotype.setdefault(genome.phenotype, []).append(index)
    for phenotype, members in by_phenotype.items():
        genes = np.zeros((len(members), MAX_MAPS, ROW_LENGTH[phenotype.family]))
        by_hand = np.full((len(members), MAX_MAPS), -1.0)
        n_maps = np.array([genomes[index].n_maps for index in members], dtype=np.int64)
        for place, index in enumerate(members):
            genome = genomes[index]
            genes[place, : genome.n_maps] = genome.genes
            if genome.probabilities is not None:
                by_hand[place, : genome.n_maps] = genome.probabilities
        failed = grow_batch(
            genes,
            n_maps,
            by_hand,
            symmetry_codes(genomes[index].symmetry for index in members),
            reading_of(phenotype),
            PURPOSES[purpose],
            new_system(),
            np.array(members, dtype=np.int64),
            clouds.points,
            clouds.origin,
            clouds.scale,
        )
        if failed >= 0:
            raise InputError(f"genome {failed} ({genomes[failed].design_id}) has no cloud: invalid, or beyond float32")
    return clouds


def empty_clouds(m: int, n: int) -> QuantisedClouds:
    """Memory for m clouds of n points, to be filled by a kernel."""
    return QuantisedClouds(np.empty((m, n, 3), np.uint16), np.empty((m, 3), np.float32), np.empty(m, np.float32))


def dequantise(points: npt.NDArray[np.uint16], origin: npt.ArrayLike, scale: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Invert the quantisation: origin + scale * q / 65535, evaluated in float64.

    Args:
        points: (..., n, 3) uint16.
        origin: (..., 3), IFS units.
        scale: (...), IFS units.

    Returns:
        (..., n, 3) float64, IFS units.
    """
    corner = np.asarray(origin, dtype=np.float64)[..., np.newaxis, :]
    side = np.asarray(scale, dtype=np.float64)[..., np.newaxis, np.newaxis]
    return np.asarray(corner + side * points / STEPS)


@kernel
def quantise_batch(points, quantised, origin, scale):  # type: ignore[no-untyped-def]
    """Quantise m clouds.

    Args:
        points: (m, n, 3) float64.
        quantised: (m, n, 3) uint16, filled.
        origin: (m, 3) float32, filled.
        scale: (m,) float32, filled.

    Returns:
        The index of the first cloud that is not finite in float32 (the rest is not filled), or -1.
    """
    n = points.shape[1]
    keys = np.empty(n, np.uint64)
    spare = np.empty(n, np.uint64)
    counts = np.empty(_BUCKETS, np.int64)
    for i in range(points.shape[0]):
        scale[i] = quantise_cloud(points[i], quantised[i], origin[i], keys, spare, counts)
        if not np.isfinite(scale[i]):
            return i
    return -1


@kernel
def grow_batch(  # type: ignore[no-untyped-def]
    genes, n_maps, by_hand, symmetries, reading, purpose, system, rows, quantised, origin, scale
):
    """Grow and quantise the clouds of a batch of genomes of one phenotype.

    Args:
        genes: (b, M, K) float64, zero padded.
        n_maps: (b,) int64.
        by_hand: (b, M) float64 probabilities set by hand; first entry of a row < 0 for none.
        symmetries: (b,) uint8 codes.
        reading: `Reading` of the phenotype.
        purpose: number of the purpose, see `PURPOSES`.
        system: `System`, working space.
        rows: (b,) int64, where in the arrays below each cloud goes.
        quantised: (m, n, 3) uint16, filled at `rows`.
        origin: (m, 3) float32, filled at `rows`.
        scale: (m,) float32, filled at `rows`.

    Returns:
        The row of the first genome without a finite cloud (the rest is not filled), or -1.
    """
    n = quantised.shape[1]
    orbit = np.empty((3, n))
    keys = np.empty(n, np.uint64)
    spare = np.empty(n, np.uint64)
    counts = np.empty(_BUCKETS, np.int64)
    for i in range(genes.shape[0]):
        row = rows[i]
        if build_system(genes[i], n_maps[i], reading, by_hand[i], system) != 0:
            return row
        place_copies(symmetries[i], n_maps[i], system)
        grow(system, n_maps[i], purpose, orbit)
        scale[row] = quantise_cloud(orbit.T, quantised[row], origin[row], keys, spare, counts)
        if not np.isfinite(scale[row]):
            return row
    return -1


@kernel
def quantise_cloud(points, quantised, origin, keys, spare, counts):  # type: ignore[no-untyped-def]
    """Quantise one cloud; for use inside other kernels.

    Args:
        points: (n, 3) float64.
        quantised: (n, 3) uint16, filled.
        origin: (3,) float32, filled.
        keys: (n,) uint64, working space.
        spare: (n,) uint64, working space.
        counts: (4096,) int64, working space.

    Returns:
        The scale, float32; not finite if the cloud is not, and then nothing else is to be used.
    """
    n = points.shape[0]
    longest = 0.0
    for axis in range(3):
        low = points[0, axis]
        high = low
        for i in range(n):
            x = points[i, axis]
            if not np.isfinite(x):
                return np.float32(np.nan)
            low = min(low, x)
            high = max(high, x)
        origin[axis] = _rounded_down(low)
        longest = max(longest, high - np.float64(origin[axis]))
    scale = -_rounded_down(-longest)
    if not np.isfinite(scale):
        return scale
    for axis in range(3):
        corner = np.float64(origin[axis])
        for i in range(n):
            step = 0
            if scale > 0.0:
                step = int((points[i, axis] - corner) / np.float64(scale) * STEPS + 0.5)
            key = _spread(np.uint64(step)) << np.uint64(axis)
            keys[i] = key if axis == 0 else keys[i] | key
    _sort(keys, spare, counts)
    for i in range(n):
        quantised[i, 0] = _gathered(keys[i])
        quantised[i, 1] = _gathered(keys[i] >> np.uint64(1))
        quantised[i, 2] = _gathered(keys[i] >> np.uint64(2))
    return scale


@kernel
def _rounded_down(x):  # type: ignore[no-untyped-def]
    """The largest float32 that is not above x; -inf below the range of float32."""
    nearest = np.float32(x)
    if np.float64(nearest) > x:
        return np.nextafter(nearest, np.float32(-np.inf))
    return nearest


@kernel(inline="always")
def _spread(x):  # type: ignore[no-untyped-def]
    """The 16 bits of x, two zeros between any two of them."""
    x = (x | (x << np.uint64(16))) & _BY_8
    x = (x | (x << np.uint64(8))) & _BY_4
    x = (x | (x << np.uint64(4))) & _BY_2
    return (x | (x << np.uint64(2))) & _BY_1


@kernel(inline="always")
def _gathered(x):  # type: ignore[no-untyped-def]
    """Inverse of `_spread`."""
    x = x & _BY_1
    x = (x | (x >> np.uint64(2))) & _BY_2
    x = (x | (x >> np.uint64(4))) & _BY_4
    x = (x | (x >> np.uint64(8))) & _BY_8
    return (x | (x >> np.uint64(16))) & np.uint64(STEPS)


@kernel
def _sort(keys, spare, counts):  # type: ignore[no-untyped-def]
    """Radix sort of 48-bit keys, four digits of 12 bits; the result is in `keys` again."""
    n = keys.shape[0]
    mask = np.uint64(_BUCKETS - 1)
    source, target = keys, spare
    for digit in range(_DIGITS):
        shift = np.uint64(digit * _DIGIT_BITS)
        counts[:] = 0
        for i in range(n):
            counts[(source[i] >> shift) & mask] += 1
        place = 0
        for bucket in range(_BUCKETS):
            size = counts[bucket]
            counts[bucket] = place
            place += size
        for i in range(n):
            bucket = (source[i] >> shift) & mask
            target[counts[bucket]] = source[i]
            counts[bucket] += 1
        source, target = target, source
