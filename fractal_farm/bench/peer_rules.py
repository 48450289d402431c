"""How other programs read dimensions off a cloud, for comparison of their errors with ours.

D2: nolds fits radii of 0.1 to 0.5 standard deviations in steps of 3 %; Sprott compares the pairs within two radii a
decade apart, in his original over one random partner for each point, as flam3 does. D0: occupied boxes of one grid,
unseen boxes left out, on all levels with five points or more to a box.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from fractal_farm.fitness.morton import LEVELS

FloatArray = npt.NDArray[np.float64]

D2_RULES = ("nolds' radii", "Sprott's radii, all pairs", "Sprott, flam3: random pairs")
D0_RULES = ("one grid, seen boxes",)

_NOLDS = (0.1, 0.5, 1.03)  # standard deviations, and the step
_SPROTT = (0.00001, 0.001)  # shares of 2^3 x the squared diagonal
_RANDOM_PAIRS = 4000
_POINTS_A_BOX = 5


def d2_by_rules(points: FloatArray, seed: int) -> list[float]:
    """D2 of an (n, 3) cloud by each of `D2_RULES`."""
    deviation = float(np.std(points, ddof=1))
    low, high, step = _NOLDS
    steps = math.floor(math.log(high / low) / math.log(step))
    radii = low * deviation * step ** np.arange(steps + 1)
    diagonal = float(np.sum(np.ptp(points, axis=0) ** 2))
    two = np.sqrt(np.array(_SPROTT) * 8.0 * diagonal)
    tree = cKDTree(points)
    counts = (tree.count_neighbors(tree, np.array([*radii, *two])) - len(points)) / 2
    seen = counts[:-2] > 0
    slope = np.polyfit(np.log(radii[seen]), np.log(counts[:-2][seen]), 1)[0] if seen.sum() > 1 else 0.0
    first, second = np.random.default_rng(seed).integers(0, len(points), (2, _RANDOM_PAIRS))
    apart = np.linalg.norm(points[first] - points[second], axis=1)[first != second]
    return [float(slope), _decade(counts[-2], counts[-1]), _decade((apart < two[0]).sum(), (apart < two[1]).sum())]


def d0_by_rules(points: FloatArray) -> list[float]:
    """D0 of an (n, 3) cloud by each of `D0_RULES`."""
    unit = (points - points.min(axis=0)) / np.ptp(points, axis=0).max()
    logs = []
    for level in range(1, LEVELS + 1):
        i, j, k = np.minimum((unit * 2**level).astype(np.int64), 2**level - 1).T
        boxes = len(np.unique((i << 2 * level) | (j << level) | k))
        if boxes * _POINTS_A_BOX > len(points):
            break
        logs.append(math.log2(boxes))
    slope = float(np.polyfit(np.arange(1, len(logs) + 1), logs, 1)[0]) if len(logs) > 1 else 0.0
    return [min(3.0, slope)]


def _decade(near: float, far: float) -> float:
    """Sprott's estimate from the pairs within two radii of which the squares differ by 100."""
    return float(np.log10(far / (near - 0.5))) if far > 0 and near > 0 else 0.0
