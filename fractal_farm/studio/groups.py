"""Designs of the same shape under the first of them (DESIGN section 8): the grid shows one, and how many it stands for.

A design belongs to the nearest first design whose signature is less than `DISTINCT` away. Rows are taken in their
order, so that what was grouped stays as it was when a catalogue grows.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.distinctness import DISTINCT, LENGTH, first_of_each_shape

FloatArray = npt.NDArray[np.float64]
RowArray = npt.NDArray[np.int64]


class Groups:
    """The first designs of all shapes seen so far.

    Args:
        marks: (k, 6) their signatures; those with a nan are left out.
        rows: (k,) their rows.
        seen: rows that were put into groups.
    """

    def __init__(self, marks: FloatArray | None = None, rows: RowArray | None = None, seen: int = 0) -> None:
        marks, rows = np.zeros((0, LENGTH)) if marks is None else marks, np.zeros(0, np.int64) if rows is None else rows
        known = np.isfinite(marks).all(axis=1)
        self._marks, self._rows, self._seen = marks[known], rows[known], seen

    def add(self, marks: FloatArray) -> RowArray:
        """Put further rows into groups.

        Args:
            marks: (n, 6) signatures of the rows after those seen; one with a nan is a group of its own.

        Returns:
            (n,) the row of the design that stands for each one's shape; its own if it does.
        """
        rows = np.arange(self._seen, self._seen + len(marks))
        self._seen += len(marks)
        representatives = rows.copy()
        open_ = np.flatnonzero(np.isfinite(marks).all(axis=1))
        open_ = self._join(marks, open_, representatives)
        first = open_[first_of_each_shape(np.ascontiguousarray(marks[open_]))]
        self._marks = np.concatenate([self._marks, marks[first]])
        self._rows = np.concatenate([self._rows, rows[first]])
        self._join(marks, np.setdiff1d(open_, first, assume_unique=True), representatives)
        return representatives

    def _join(self, marks: FloatArray, which: RowArray, representatives: RowArray) -> RowArray:
        """Put some of the rows under known first designs; returns those that are like none."""
        from scipy.spatial import cKDTree

        if not len(which) or not len(self._marks):
            return which
        distances, nearest = cKDTree(self._marks).query(marks[which], distance_upper_bound=DISTINCT)
        alike = distances < DISTINCT
        representatives[which[alike]] = self._rows[nearest[alike]]
        return np.asarray(which[~alike], np.int64)


def group_sizes(representatives: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
    """The number of designs in each row's group."""
    return np.bincount(representatives, minlength=len(representatives))[representatives].astype("<u4")
