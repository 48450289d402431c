"""How far two clouds lie apart once one is laid upon the other: the check behind what the signatures say.

Signatures of unrelated designs can coincide; clouds that cover each other cannot. Both clouds are moved to their
centre, scaled to one size and turned to their principal axes; of the 48 orientations of the axes (and of each a little
tilted, for designs as thick as they are wide) the few that fit best are refined by iterative closest points (Besl and
McKay 1992) with a free scale. The distance is the mean from each point to the other cloud, in radii of the shape: the
symmetric Chamfer distance. Mirror images count as the same, as for the descriptor, which cannot tell them apart.

Measured on the 929 crisp qualified designs among 6,000 random ones, clouds of 5,000 points: 500 copies with other
random numbers, turned, scaled and half of them mirrored lie at .006 (median), 95 % below .023, 99 % below .043, 99.8 %
below `SAME_SHAPE`. 500 unrelated pairs lie at .056 and above, median .21. Of 300 unrelated pairs whose signatures
coincide (less than 1 apart) 99.3 % lie above `SAME_SHAPE`, median .11: what signatures merge, the clouds tell apart.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

SAME_SHAPE = 0.05  # aligned distance below which two clouds cover each other

_INNER = 0.98  # share of the points that centre, size and axes are taken from: few draws reach the outermost pieces
_TILT = np.deg2rad(22.0)
_APART = 2.6  # trace of the turn between two orientations that count as one (37 degrees)
_CELLS = 40  # of the grid of distances, a side
_REACH = 2.6  # half its side, radii of the shape
_SCAN, _ROUGH, _FINE, _MEASURED = 150, 120, 300, 800  # points of a cloud that are moved at each stage
_STARTS = 4
_ROUGH_STEPS, _FINE_STEPS = 6, 8
_ABOUT = 1.0  # a rough step takes a partner up to twice as far as the nearest
_FITTED = 0.95  # share of the points, those that are nearest, that a step fits


def aligned_distance(first: npt.ArrayLike, second: npt.ArrayLike) -> float:
    """Mean distance between two clouds laid upon each other; below `SAME_SHAPE` they show one shape.

    Args:
        first: (n, 3) real, n >= 2.
        second: (m, 3) real, m >= 2; place, size, orientation and handedness are indifferent.

    Returns:
        In radii of the shape, that is the root mean square distance of its points from its centre; infinite if one of
        them is a single point, 0 if both are.
    """
    return float(aligned_distances(first, [second])[0])


def aligned_distances(cloud: npt.ArrayLike, others: Sequence[npt.ArrayLike]) -> FloatArray:
    """`aligned_distance` of one cloud from many, (len(others),) float64; they are compared side by side in threads."""
    target = _posed(np.asarray(cloud, np.float64))
    grid = None if target is None else _distance_grid(target.points)

    def distance(points: npt.ArrayLike) -> float:
        posed = _posed(np.asarray(points, np.float64))
        if target is None or grid is None or posed is None:
            return 0.0 if target is posed else np.inf
        return _distance(posed, target, grid)

    with ThreadPoolExecutor() as threads:
        return np.array(list(threads.map(distance, others)), np.float64)


@dataclass(frozen=True)
class _Posed:
    """A cloud about its centre, of radius 1, along its principal axes; with its search tree."""

    points: FloatArray
    tree: Any


def _posed(points: FloatArray) -> _Posed | None:
    """None for a single point."""
    from scipy.spatial import cKDTree

    offsets = points - np.median(points, axis=0)
    squares = np.square(offsets).sum(axis=1)
    inner = squares <= np.quantile(squares, _INNER)
    offsets -= offsets[inner].mean(axis=0)
    radius = np.sqrt(np.square(offsets[inner]).sum(axis=1).mean())
    if not radius > 0.0:
        return None
    offsets /= radius
    _, axes = np.linalg.eigh(offsets[inner].T @ offsets[inner])
    placed = offsets @ axes[:, ::-1]
    return _Posed(placed, cKDTree(placed))


def _distance(moving: _Posed, target: _Posed, grid: npt.NDArray[np.float32]) -> float:
    rough = _every(moving.points, _ROUGH)
    found = [_refined(rough, target, turn, np.zeros(3), _ROUGH_STEPS) for turn in _starts(moving.points, grid)]
    _, turn, shift = min(found, key=lambda candidate: candidate[0])
    _, turn, shift = _refined(_every(moving.points, _FINE), target, turn, shift, _FINE_STEPS, fine=True)
    scale = np.cbrt(abs(np.linalg.det(turn)))
    there, _ = target.tree.query(_every(moving.points, _MEASURED) @ turn + shift)
    back, _ = moving.tree.query((_every(target.points, _MEASURED) - shift) @ np.linalg.inv(turn))
    return float((there.mean() + scale * back.mean()) / 2.0)


def _starts(points: FloatArray, grid: npt.NDArray[np.float32]) -> list[FloatArray]:
    """The orientations in which a cloud lies nearest to the one of the grid, (3, 3) each."""
    turns = _orientations()
    cells = (((_every(points, _SCAN) @ turns + _REACH) * (_CELLS / (2.0 * _REACH))).clip(0, _CELLS - 1)).astype(np.intp)
    costs = grid[cells[..., 0], cells[..., 1], cells[..., 2]].mean(axis=1)
    chosen: list[FloatArray] = []
    for index in np.argsort(costs, kind="stable").tolist():
        if all(np.trace(turns[index].T @ other) < _APART for other in chosen):
            chosen.append(turns[index])
            if len(chosen) == _STARTS:
                break
    return chosen


def _refined(
    points: FloatArray, target: _Posed, turn: FloatArray, shift: FloatArray, steps: int, *, fine: bool = False
) -> tuple[float, FloatArray, FloatArray]:
    """Iterative closest points: the mean distance reached, the (if fine, scaled) turn and the shift: p turn + shift."""
    about = 0.0 if fine else _ABOUT
    count = max(2, int(_FITTED * len(points)))
    for _ in range(steps):
        distances, partners = target.tree.query(points @ turn + shift, eps=about)
        near = np.argpartition(distances, min(count, len(points)) - 1)[:count]
        ours, theirs = points[near], target.points[partners[near]]
        middle, centre = ours.mean(axis=0), theirs.mean(axis=0)
        ours = ours - middle
        left, stretches, right = np.linalg.svd(ours.T @ (theirs - centre))
        spread = float(np.square(ours).sum())
        scale = stretches.sum() / spread if fine and spread > 0.0 else 1.0
        turn = left @ right * (scale if scale > 0.0 else 1.0)
        shift = centre - middle @ turn
    distances, _ = target.tree.query(points @ turn + shift, eps=about)
    return float(distances.mean()), turn, shift


def _every(points: FloatArray, count: int) -> FloatArray:
    """About so many of the points, evenly from their order."""
    return points[:: max(1, len(points) // count)]


def _distance_grid(points: FloatArray) -> npt.NDArray[np.float32]:
    """Distance from each cell of a grid about the centre to the nearest cell with points, (cells, cells, cells)."""
    from scipy.ndimage import distance_transform_edt

    width = 2.0 * _REACH / _CELLS
    empty = np.ones((_CELLS, _CELLS, _CELLS), bool)
    cells = ((points + _REACH) / width).clip(0, _CELLS - 1).astype(np.intp)
    empty[tuple(cells.T)] = False
    return np.asarray(distance_transform_edt(empty), np.float32) * np.float32(width)


@functools.cache
def _orientations() -> FloatArray:
    """The 48 orientations of three axes, mirrored ones among them, each as it is and tilted six ways: (336, 3, 3)."""
    from scipy.spatial.transform import Rotation

    axes = [
        np.diag(signs)[list(order)]
        for order in itertools.permutations(range(3))
        for signs in itertools.product([1.0, -1.0], repeat=3)
    ]
    tilts = Rotation.from_rotvec(_TILT * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])).as_matrix()
    return np.array([tilt @ turn for tilt in tilts for turn in axes])
