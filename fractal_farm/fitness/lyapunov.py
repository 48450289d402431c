"""Largest Lyapunov exponent of the random iteration, in nats per step (NOTES, 'Fitness').

For similarities all exponents are equal and known exactly: LLE = sum_i P_i ln rho_i. For general affine maps it is the
growth rate of a tangent vector under the maps that the orbit drew (Benettin et al. 1980, with one vector). Most of the
noise of that average is in how often each map was drawn; the same sum for the maps' sizes alone, whose expectation is
known, is therefore taken out as a control variate. For similarities nothing else is left.

Other programs (Sprott's, flam3) report bits: nats x 1.4427.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.genome import MAX_MAPS, RHO, Genome, as_genome
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.random_iteration import iterate, stream_keys, stream_number, system_of

STEPS = 5000
_SETTLING = 64  # steps in which the tangent vector finds its direction
_SMALL = 1e-100
# A direction that no plane of symmetry of hand-written maps contains: they would never let the vector leave it.
_START = (1.0 / math.sqrt(6.0), math.sqrt(2.0) / math.sqrt(6.0), math.sqrt(3.0) / math.sqrt(6.0))


class TangentWorkspace(NamedTuple):
    """Memory for the tangent growth.

    Attributes:
        constants: (8, 12) float64, the maps x -> (k, 0, 0); iterating them writes down which maps are drawn.
        drawn: (3, 5064) float64; row 0 holds the numbers of the drawn maps.
        log_sizes: (8,) float64, ln of the root mean square stretch of each map.
    """

    constants: npt.NDArray[np.float64]
    drawn: npt.NDArray[np.float64]
    log_sizes: npt.NDArray[np.float64]


def new_tangent_workspace() -> TangentWorkspace:
    """An empty working space."""
    constants = np.zeros((MAX_MAPS, 12))
    constants[:, 3] = np.arange(MAX_MAPS)
    return TangentWorkspace(constants, np.empty((3, _SETTLING + STEPS)), np.empty(MAX_MAPS))


def lyapunov_exponent(genome: Genome | npt.ArrayLike) -> float:
    """Largest Lyapunov exponent of a genome's random iteration.

    Args:
        genome: a `Genome` or an (N, 7) array.

    Returns:
        Nats per iteration, below 0. Exact for similarities; for affine genomes from 5,000 steps of the orbit that
        scores are computed from. -inf if the drawn maps annihilate every vector.

    Raises:
        InputError: the genome is invalid.
    """
    valid = as_genome(genome)
    system = system_of(valid)
    if valid.phenotype.family == "similarity":
        return float(similarity_exponent(system, valid.n_maps))
    first, second = stream_keys(system.keys, stream_number("fitness"))
    return float(tangent_growth(system, valid.n_maps, first, second, new_tangent_workspace()))


@kernel
def similarity_exponent(system, n_maps):
    """The sum of P_i ln rho_i of a filled `System` of similarities."""
    total = 0.0
    for i in range(n_maps):
        total += system.probabilities[i] * math.log(system.rows[i, RHO])
    return total


@kernel
def tangent_growth(system, n_maps, first, second, work):
    """Growth rate of a tangent vector along the orbit of any filled `System`.

    Args:
        system: `System`.
        n_maps: number of maps.
        first: uint32 key of the orbit's random stream.
        second: uint32 key.
        work: `TangentWorkspace`.
    """
    drawn, log_sizes = work.drawn, work.log_sizes
    iterate(work.constants, system.thresholds, n_maps, system.start, first, second, drawn)
    expected = 0.0
    for i in range(n_maps):
        log_sizes[i] = _log_size(system.maps[i])
        expected += system.probabilities[i] * log_sizes[i]
    x, y, z = _START
    growth = 0.0
    sizes = 0.0
    for t in range(drawn.shape[1]):
        if t == _SETTLING:
            length = math.sqrt(x * x + y * y + z * z)
            x, y, z = x / length, y / length, z / length
            growth = 0.0
            sizes = 0.0
        k = np.int64(drawn[0, t])
        m = system.maps[k]
        x, y, z = (
            m[0] * x + m[1] * y + m[2] * z,
            m[4] * x + m[5] * y + m[6] * z,
            m[8] * x + m[9] * y + m[10] * z,
        )
        sizes += log_sizes[k]
        largest = max(abs(x), max(abs(y), abs(z)))
        if largest < _SMALL:
            if largest == 0.0:
                return -np.inf
            growth += math.log(largest)
            x, y, z = x / largest, y / largest, z / largest
    growth += 0.5 * math.log(x * x + y * y + z * z)
    return (growth - sizes) / (drawn.shape[1] - _SETTLING) + expected


@kernel
def _log_size(m):
    """ln(|A| / sqrt 3) with the Frobenius norm: ln rho of a similarity."""
    total = m[0] * m[0] + m[1] * m[1] + m[2] * m[2]
    total += m[4] * m[4] + m[5] * m[5] + m[6] * m[6]
    total += m[8] * m[8] + m[9] * m[9] + m[10] * m[10]
    return 0.5 * math.log(total / 3.0)
