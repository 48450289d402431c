"""Prototypes: a few designs that show the breadth of a catalogue, each standing for those that are like it.

They are medoids in the space of signatures. The first ones are spread by farthest points (Gonzalez 1985), which finds
the rare shapes that a random start misses; then, in turn, each design goes to its nearest prototype, and each group
takes the member nearest to its mean, which is its exact medoid under squared distances. Nothing is drawn at random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError

_ROUNDS = 20
_SAMPLE = 100_000  # designs among which prototypes are looked for


@dataclass(frozen=True)
class Prototypes:
    """Medoids and their groups, the largest first.

    Attributes:
        medoids: (k,) int64, indices of the designs.
        sizes: (k,) int64, designs in each group.
        spreads: (k,) float64, root mean square distance of the group from its medoid, in signature units.
        group_of: (n,) int64, the group of each design; -1 where the signature is not a number.
    """

    medoids: npt.NDArray[np.int64]
    sizes: npt.NDArray[np.int64]
    spreads: npt.NDArray[np.float64]
    group_of: npt.NDArray[np.int64]


def prototypes(marks: npt.ArrayLike, count: int) -> Prototypes:
    """Choose prototypes.

    Args:
        marks: (axes, n) real signatures; columns with a nan are left out. Of more than 100,000 designs every so many is
            looked at when medoids are chosen; all are assigned to the groups.
        count: how many; fewer if there are fewer different designs.

    Raises:
        InputError: no design has a signature, or count is below 1.
    """
    columns = np.asarray(marks, np.float32)
    if count < 1:
        raise InputError(f"number of prototypes: {count}; ask for at least 1")
    known = np.flatnonzero(np.isfinite(columns).all(axis=0))
    if not len(known):
        raise InputError("no design has a descriptor; there is nothing to compare")
    sample = known[:: -(-len(known) // _SAMPLE)]
    points = np.ascontiguousarray(columns[:, sample])
    medoids = _spread(points, count)
    for _ in range(_ROUNDS):
        group_of, _ = _assigned(points, points[:, medoids])
        moved = _medoids(points, group_of, medoids)
        if np.array_equal(moved, medoids):
            break
        medoids = moved
    group_of, squares = _assigned(columns[:, known], points[:, medoids])
    sizes = np.bincount(group_of, minlength=len(medoids))
    spreads = np.sqrt(np.bincount(group_of, squares, minlength=len(medoids)) / sizes)
    chosen = sample[medoids]
    order = np.lexsort((chosen, -sizes))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    groups = np.full(columns.shape[1], -1, np.int64)
    groups[known] = rank[group_of]
    return Prototypes(chosen[order], sizes[order], spreads[order], groups)


def _spread(points: npt.NDArray[np.float32], count: int) -> npt.NDArray[np.int64]:
    """Indices of points far apart from each other: first the one nearest to the mean, then always the farthest."""
    chosen = [int(_squares(points, points.mean(axis=1)).argmin())]
    nearest = _squares(points, points[:, chosen[0]])
    while len(chosen) < count and nearest.max() > 0.0:
        chosen.append(int(nearest.argmax()))
        np.minimum(nearest, _squares(points, points[:, chosen[-1]]), out=nearest)
    return np.array(chosen, np.int64)


def _assigned(
    points: npt.NDArray[np.float32], centres: npt.NDArray[np.float32]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float32]]:
    """The nearest centre of each point, the first of equal ones, and the squared distance."""
    group_of = np.zeros(points.shape[1], np.int64)
    nearest = _squares(points, centres[:, 0])
    for number in range(1, centres.shape[1]):
        squares = _squares(points, centres[:, number])
        closer = squares < nearest
        group_of[closer] = number
        nearest[closer] = squares[closer]
    return group_of, nearest


def _medoids(
    points: npt.NDArray[np.float32], group_of: npt.NDArray[np.int64], medoids: npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:
    sizes = np.bincount(group_of, minlength=len(medoids))
    means = np.array([np.bincount(group_of, values, minlength=len(medoids)) / sizes for values in points])
    squares = np.zeros(points.shape[1])
    for values, mean in zip(points, means, strict=True):
        squares += np.square(values - mean[group_of])
    order = np.lexsort((squares, group_of))
    return np.asarray(order[np.searchsorted(group_of[order], np.arange(len(medoids)))], np.int64)


def _squares(points: npt.NDArray[np.float32], centre: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Squared distances (n,) of points (axes, n) from one (axes,)."""
    total = np.zeros(points.shape[1], np.float32)
    for values, middle in zip(points, centre, strict=True):
        total += np.square(values - middle)
    return total
