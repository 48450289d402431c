"""Points to draw a design from: a cover of the whole attractor and its copies, as even as its pieces allow.

Random iteration visits thin parts too rarely: of a fern with rho = 0.98 it shows the root. A cut set of the address
tree shows all of it with as few points. Where maps overlap heavily, and a cut set of that size is coarse, random
iteration fills in.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.copies import copied
from fractal_farm.ifs.cover import cut_set_of, enclosure_of
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.random_iteration import attractor_points, system_of
from fractal_farm.ifs.similarity_dimension import similarity_dimension

_ENOUGH = 0.6
_TRIALS = 6
_CROWDED = 2.5


def display_points(genome: Genome, n_points: int) -> tuple[npt.NDArray[np.float64], float | None]:
    """Some n_points points of a valid genome's shape, and the radius to draw them at, if one fits all.

    Returns:
        (m, 3) float64, m between 0.6 and 2 times n_points, IFS units; and the radius or None.
    """
    dimension = similarity_dimension(genome)
    crowded = dimension > _CROWDED
    wanted = n_points // 2 if crowded else n_points
    system = system_of(genome)
    cover = _even_cover(genome, dimension, max(1, wanted // int(system.n_copies[0])))
    if cover is None:
        return attractor_points(genome, n_points, "display"), None
    points, radius = copied(cover[0], system), cover[1]
    if not crowded:
        return points, 0.5 * radius
    return np.concatenate([points, attractor_points(genome, n_points - wanted, "display")]), None


def _even_cover(genome: Genome, dimension: float, n_points: int) -> tuple[npt.NDArray[np.float64], float] | None:
    """A cut set of the attractor of about n_points words and its radius; None if the count cannot be met."""
    enclosure = enclosure_of(genome, 1e-2, 0.0)
    logarithm = -math.log(n_points) / dimension
    for _ in range(_TRIALS):
        radius = float(enclosure.anchor[3]) * math.exp(logarithm)
        points = cut_set_of(genome, enclosure, radius, 2 * n_points)
        if points is None:
            logarithm += math.log(2.0) / dimension
        elif len(points) < _ENOUGH * n_points:
            logarithm += math.log(len(points) / n_points) / dimension
        else:
            return points, radius
    return None
