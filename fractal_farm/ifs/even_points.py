"""Points spread evenly over a shape: as many as asked for, one in each cell of a grid that the shape passes through.

A cut set is even where the pieces of an attractor do not overlap. Here a large one is thinned out, so that places
where pieces lie upon each other get no more points than others.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.corresponding import corresponding_points
from fractal_farm.ifs.genome import Genome

FloatArray = npt.NDArray[np.float64]

_CANDIDATES = 8  # for each point
_BISECTIONS = 24
_ENOUGH = 0.99


def even_points(genome: Genome, n_points: int) -> FloatArray:
    """Points of a valid genome's shape, as even as where its pieces do not overlap: one in each cell of a grid.

    Args:
        genome: of any family.
        n_points: at least 100.

    Returns:
        (n_points, 3) float64, IFS units.
    """
    candidates = corresponding_points([genome], _CANDIDATES * n_points)[0]
    origin = candidates.min(axis=0)
    small, large = 0.0, float(np.ptp(candidates, axis=0).max()) or 1.0
    chosen = np.zeros(1, np.intp)
    for _ in range(_BISECTIONS):
        cell = 0.5 * (small + large)
        places = ((candidates - origin) / cell).astype(np.int64)
        side = int(places.max()) + 1
        _, first = np.unique((places[:, 0] * side + places[:, 1]) * side + places[:, 2], return_index=True)
        if len(first) > n_points:
            small = cell
        else:
            large, chosen = cell, first
            if len(first) > _ENOUGH * n_points:
                break
    kept = np.zeros(len(candidates), bool)
    kept[chosen] = True
    # Dust fills its cells all at once: some places get a second point.
    others = np.flatnonzero(~kept)
    missing = n_points - len(chosen)
    if 0 < missing <= len(others):
        kept[others[np.arange(missing) * len(others) // missing]] = True
    return candidates[kept]
