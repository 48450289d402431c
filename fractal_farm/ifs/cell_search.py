"""One point of the attractor in every cell that it meets, found by breadth-first search.

For maps that overlap so much that the address tree holds many times more words than there are cells. A point whose cell
is taken is dropped, and what would have grown from it is up to a cell's diagonal away; such losses add up to diagonal /
(1 - q), q the largest contraction. So the search does not use the maps but words of them that at least halve the
attractor: some 60, or hundreds where a map hardly contracts. The loss is then 2 diagonals by proof (and half a cell in
practice), whatever the maps; MAX_WORDS is enough for ratios up to 0.999, beyond which `Cells.spacing` says more.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.enclosure import Enclosure, grow_words, image
from fractal_farm.ifs.kernel import kernel

MAX_WORDS = 1024
MAX_CELLS = 2**32
_HALF = 0.5
_FIRST_POINTS = 1024  # room at the start; it doubles
_BIT_BITS = 6  # 64 cells a word
_BIT_MASK = (1 << _BIT_BITS) - 1


class Cells(NamedTuple):
    """The words of a search.

    Attributes:
        words: (K, 12) float64, maps whose images of the attractor make up the attractor.
        spacing: side of the cells, for a cover within a radius of 1.
    """

    words: npt.NDArray[np.float64]
    spacing: float


def cells_of(maps: npt.NDArray[np.float64], n_maps: int, enclosure: Enclosure) -> Cells:
    """Words for a search of the attractor of the first n_maps of `maps` (M, 12); `enclosure` is filled."""
    words = np.empty((MAX_WORDS, 12))
    count, largest = grow_words(maps, n_maps, enclosure, _HALF, words, np.empty(MAX_WORDS))
    return Cells(words[:count].copy(), (1.0 - float(largest)) / math.sqrt(3.0))


def search_cells(cells: Cells, enclosure: Enclosure, spacing: float, max_points: int) -> npt.NDArray[np.float64] | None:
    """One point of the attractor in each cell that the search reaches.

    Args:
        cells: see `cells_of`.
        enclosure: filled `Enclosure`; its box holds the attractor.
        spacing: side of a cell, IFS units.
        max_points: upper bound of the number of points.

    Returns:
        (m, 3) float64 in order of discovery; None where there are more points than allowed, or more than MAX_CELLS
        cells (of which one bit each is kept) in the box.
    """
    lower = enclosure.box[0]
    shape = np.maximum(np.ceil((enclosure.box[1] - lower) / spacing), 1.0) + 1.0
    if float(shape[0] * shape[1] * shape[2]) > MAX_CELLS:
        return None
    start = enclosure.anchor[:3].copy()
    points, complete = _search(cells.words, start, lower, spacing, shape.astype(np.int64), max_points)
    return points if complete else None


@kernel
def _search(words, start, lower, spacing, shape, max_points):  # type: ignore[no-untyped-def]
    """The search; returns points (m, 3) and whether they are complete."""
    seen = np.zeros((shape[0] * shape[1] * shape[2] >> _BIT_BITS) + 1, np.uint64)
    points = np.empty((min(_FIRST_POINTS, max_points), 3))
    points[0] = start
    count = 1
    done = 0
    while done < count:
        x = points[done, 0]
        y = points[done, 1]
        z = points[done, 2]
        done += 1
        for k in range(len(words)):
            u, v, w = image(words[k], x, y, z)
            i = min(max(int((u - lower[0]) / spacing), 0), shape[0] - 1)
            j = min(max(int((v - lower[1]) / spacing), 0), shape[1] - 1)
            m = min(max(int((w - lower[2]) / spacing), 0), shape[2] - 1)
            index = (i * shape[1] + j) * shape[2] + m
            bit = np.uint64(1) << np.uint64(index & _BIT_MASK)
            if seen[index >> _BIT_BITS] & bit:
                continue
            seen[index >> _BIT_BITS] |= bit
            if count == max_points:
                return points, False
            if count == len(points):
                longer = np.empty((min(2 * count, max_points), 3))
                longer[:count] = points
                points = longer
            points[count, 0] = u
            points[count, 1] = v
            points[count, 2] = w
            count += 1
    return points[:count], True
