"""What a genome's fitness will be, by closed forms, before anything is computed: to choose candidates, never to score.

For similarities that do not overlap D0 = s with sum rho^s = 1, D2 = t with sum p^2 rho^-t = 1, and LLE = sum p ln rho
(NOTES, 'Fitness'). Of the crisp random genomes that are expected above .85, 99 % are; of those that are above, 80 % are
expected there. Scalar arithmetic alone: the last bits of numpy's powers depend on the machine.
"""

from __future__ import annotations

import math

from fractal_farm.config import EvolutionConfig, FitnessConfig
from fractal_farm.ifs.similarity_dimension import solve_moran

_NEWTON_STEPS = 100
_CONVERGED = 1e-9


def expected_fitness(ratios: list[float], config: EvolutionConfig) -> float:
    """Eq 3.7 of the dimensions that similarities of these ratios have if they do not overlap.

    Args:
        ratios: rho of each map, in (0, 1), at least two.
        config: says what probabilities and fitness are made of.

    Returns:
        In [0, 1].
    """
    probabilities = floored(ratios, config.phenotype.influence)
    d0 = solve_moran(ratios)
    d2 = _correlation_dimension(ratios, probabilities, d0)
    lle = sum(p * math.log(rho) for p, rho in zip(probabilities, ratios, strict=True))
    return _fitness(min(d0, 3.0), min(d2, 3.0), lle, config.fitness)


def floored(ratios: list[float], influence: float) -> list[float]:
    """Eqs 3.3 and 3.4: proportional to the volume, at least 1 / (influence N); the largest pays for the others."""
    volumes = [rho * rho * rho for rho in ratios]
    total = sum(volumes)
    floor = 1.0 / (influence * len(ratios))
    raised = [max(volume / total, floor) for volume in volumes]
    largest = max(range(len(raised)), key=raised.__getitem__)
    raised[largest] = max(raised[largest] - (sum(raised) - 1.0), floor)
    return raised


def _correlation_dimension(ratios: list[float], probabilities: list[float], d0: float) -> float:
    """Newton's steps from D0, which is not below D2: the sum is convex, so they fall towards the root."""
    logarithms = [-math.log(rho) for rho in ratios]
    squares = [p * p for p in probabilities]
    t = d0
    for _ in range(_NEWTON_STEPS):
        powers = [square * math.exp(t * ln) for square, ln in zip(squares, logarithms, strict=True)]
        step = (sum(powers) - 1.0) / sum(power * ln for power, ln in zip(powers, logarithms, strict=True))
        t -= step
        if not step > _CONVERGED:
            break
    return max(t, 0.0)


def _fitness(d0: float, d2: float, lle: float, formula: FitnessConfig) -> float:
    terms = ((d0 / 3.0, formula.d0), (d2 / 3.0, formula.d2), (lle, formula.lle))
    distance = sum((value - centre) ** 2 / (2.0 * width * width) for value, (centre, width) in terms)
    return min(1.0, max(0.0, formula.amplitude * math.exp(-distance) + formula.baseline))
