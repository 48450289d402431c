"""Random iteration algorithm (NOTES; paper section 3.2.2): x_{t+1} = w_k(x_t), k drawn with probability P_k.

The orbit starts *on* the attractor, at the fixed point of the most probable map: no burn-in, which would need 700
steps at rho = 0.98. Draws come from a counter-based stream keyed by the content of the genome and by a purpose, in
32-bit operations with integer thresholds: the same points on every machine, and in a browser.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.ifs.copies import place_copies, spread_over_copies
from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.symmetry import symmetry_code
from fractal_farm.ifs.system import (
    FIRST_FACTOR,
    FIRST_SHIFT,
    INCREMENT,
    NEXT_FACTOR,
    NEXT_SHIFT,
    System,
    build_system,
    new_system,
    reading_of,
    scramble,
)

PURPOSES = {"fitness": 0, "display": 1, "repeat": 2}
GENERATOR_VERSION = "ria-1"
_LARGEST = np.uint32(0xFFFFFFFF)


def attractor_points(
    genome: Genome | npt.ArrayLike, n: int, purpose: str = "fitness", repeat: int = 0
) -> npt.NDArray[np.float64]:
    """Points of the attractor by random iteration, spread over its copies if the genome has a symmetry.

    Args:
        genome: a `Genome` or an (N, 7) array.
        n: number of points, at least 1; a longer orbit begins with the shorter one.
        purpose: "fitness" (the cloud that scores are computed from), "display" or "repeat".
        repeat: number of an independent repetition.

    Returns:
        (n, 3) float64, in orbit order, IFS units.

    Raises:
        InputError: the genome is invalid, n is below 1, or the purpose unknown.
    """
    if n < 1:
        raise InputError(f"n is {n}; ask for at least 1 point")
    valid = as_genome(genome)
    system = system_of(valid)
    points = np.empty((3, n))
    grow(system, valid.n_maps, stream_number(purpose, repeat), points)
    return np.ascontiguousarray(points.T)


def stream_number(purpose: str, repeat: int = 0) -> int:
    """Number of a genome's random stream for one purpose and repetition, as `stream_keys` takes it.

    Raises:
        InputError: the purpose is unknown, or repeat below 0.
    """
    if purpose not in PURPOSES:
        raise InputError(f"purpose is {purpose!r}; choose one of {', '.join(PURPOSES)}")
    if repeat < 0:
        raise InputError(f"repeat is {repeat}; it must be 0 or above")
    return PURPOSES[purpose] + len(PURPOSES) * repeat


def system_of(genome: Genome) -> System:
    """The filled `System` of one valid genome."""
    system = new_system()
    by_hand = np.array(genome.probabilities if genome.probabilities is not None else (-1.0,))
    build_system(genome.genes.copy(), genome.n_maps, reading_of(genome.phenotype), by_hand, system)
    place_copies(symmetry_code(genome.symmetry, "genome"), genome.n_maps, system)
    return system


@kernel
def grow(system, n_maps, stream, points):  # type: ignore[no-untyped-def]
    """Fill points (3, n) with the cloud of one of a genome's streams, spread over the copies of the attractor."""
    first, second = stream_keys(system.keys, stream)
    iterate(system.maps, system.thresholds, n_maps, system.start, first, second, points)
    if system.n_copies[0] > 1:
        spread_over_copies(system, first, second, points)


@kernel
def stream_keys(keys, stream):  # type: ignore[no-untyped-def]
    """The two 32-bit keys of one of a genome's streams, from its number."""
    first = scramble(keys[0] ^ np.uint32(stream))
    second = scramble(keys[1] + np.uint32(stream))
    return first, second


@kernel
def iterate(maps, thresholds, n_maps, start, first, second, points):  # type: ignore[no-untyped-def]
    """Fill points (3, n) with the orbit of `start`; draw t is a hash of (keys, t).

    Args:
        maps: (M, 12) float64 maps.
        thresholds: (M,) uint32 cumulative probabilities times 2^32.
        n_maps: number of maps.
        start: (3,) float64 point on the attractor.
        first: uint32 key.
        second: uint32 key.
        points: (3, n) float64, filled in orbit order.
    """
    x = start[0]
    y = start[1]
    z = start[2]
    low = thresholds[0]
    high = thresholds[1] if n_maps > 2 else _LARGEST
    counter = np.uint32(first)
    for t in range(points.shape[1]):
        counter = np.uint32(counter + INCREMENT)
        draw = counter ^ (counter >> FIRST_SHIFT)
        draw = np.uint32(draw * FIRST_FACTOR) ^ np.uint32(second)
        draw ^= draw >> NEXT_SHIFT
        draw = np.uint32(draw * NEXT_FACTOR)
        draw ^= draw >> NEXT_SHIFT
        k = np.uint64(draw >= low)
        if n_maps > 2:
            k += np.uint64(draw >= high)
            for j in range(2, n_maps - 1):
                k += np.uint64(draw >= thresholds[j])
        m = maps[k]
        x, y, z = (
            m[0] * x + m[1] * y + m[2] * z + m[3],
            m[4] * x + m[5] * y + m[6] * z + m[7],
            m[8] * x + m[9] * y + m[10] * z + m[11],
        )
        points[0, t] = x
        points[1, t] = y
        points[2, t] = z
