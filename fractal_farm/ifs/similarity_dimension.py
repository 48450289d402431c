"""Similarity dimension: the s with sum over i of rho_i^s = 1 (Moran's equation; Hutchinson 1981).

For similarities whose pieces do not overlap it is the capacity dimension of the attractor; it exceeds 3 where the maps
overlap so much that the attractor is a cloud. Evolution redraws designs by it, hence scalar code.
"""

from __future__ import annotations

import math

import numpy.typing as npt

from fractal_farm.ifs.genome import RHO, Genome, as_genome
from fractal_farm.ifs.linear_algebra import largest_singular_value

_NEWTON_STEPS = 100
_CONVERGED = 1e-15


def similarity_dimension(genome: Genome | npt.ArrayLike) -> float:
    """Solution of Moran's equation for the contraction ratios of a genome.

    For the affine family the ratios are the spectral norms of the maps; the value is then an upper bound of the
    attractor's dimension and has no closer meaning.

    Args:
        genome: a `Genome` or an (N, 7) array.

    Returns:
        The dimension s > 0; above 3 (without limit) for heavily overlapping maps.

    Raises:
        InputError: the genome is invalid.
    """
    valid = as_genome(genome)
    if valid.phenotype.family == "similarity":
        return solve_moran([float(row[RHO]) for row in valid.genes])
    return solve_moran([largest_singular_value(*row[0:3], *row[4:7], *row[8:11]) for row in valid.genes.tolist()])


def solve_moran(ratios: list[float]) -> float:
    """The s with sum of ratio^s = 1, for at least two ratios in (0, 1).

    The sum is convex and decreasing in s, so that Newton's steps from s = 0 rise towards the root and never pass it.
    """
    logarithms = sorted(math.log(ratio) for ratio in ratios)
    s = 0.0
    for _ in range(_NEWTON_STEPS):
        total = 0.0
        slope = 0.0
        for logarithm in logarithms:
            power = math.exp(s * logarithm)
            total += power
            slope += power * logarithm
        step = (1.0 - total) / slope
        if not step > _CONVERGED * s:
            break
        s += step
    return s
