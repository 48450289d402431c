"""When two designs are different: six numbers a design, in units of what chance does to them (DESIGN section 8).

The numbers of a descriptor are noisy to different degrees, and together: where one quantile of a cloud comes out large
its neighbours do. So they are not compared as they are. The signature holds their linear discriminants (Fisher 1936):
of all directions in the space of descriptor, D0 and D2, those in which designs differ most, measured by how far two
clouds of the same design lie apart. Two designs are *distinct* if their signatures are at least 1 apart. Of random
qualified designs, 98 % of the copies with other random numbers, and less than 1 % of unrelated pairs, are nearer.

Sums run in a fixed order, since they decide what is kept.
"""

from __future__ import annotations

import functools
import importlib.resources
import json
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError

FloatArray = npt.NDArray[np.float64]

DESCRIPTOR_LENGTH = 14
LENGTH = 6
DISTINCT = 1.0  # distance at and above which two designs are distinct
_SLACK = 1.0 + 1e-9  # by which the tree looks farther than counts
_FIRST_BLOCK, _BLOCK = 64, 4096  # signatures that are looked at together
_FRESH = 256  # members that wait for a place in the tree, at most, or a quarter of those in it


def signatures(descriptors: npt.ArrayLike, d0: npt.ArrayLike, d2: npt.ArrayLike) -> FloatArray:
    """Signatures of designs.

    Args:
        descriptors: (n, 14) real, see `fitness.shape_descriptor`.
        d0: (n,) capacity dimensions.
        d2: (n,) correlation dimensions.

    Returns:
        (n, 6) float64; nan where a number is.

    Raises:
        InputError: shapes that do not fit.
    """
    shapes = np.asarray(descriptors, np.float64)
    dimensions = np.asarray(d0, np.float64), np.asarray(d2, np.float64)
    n = len(shapes)
    if shapes.shape != (n, DESCRIPTOR_LENGTH) or any(values.shape != (n,) for values in dimensions):
        raise InputError(f"descriptors: shape {shapes.shape}; give (n, {DESCRIPTOR_LENGTH}), and n values of D0 and D2")
    features = [*np.ascontiguousarray(shapes.T), *dimensions]
    result = np.zeros((n, LENGTH))
    for column, weights in enumerate(projection()):
        for weight, feature in zip(weights, features, strict=True):
            result[:, column] += weight * feature
    return result


class DistinctSet:
    """Signatures of which any two are distinct, in the order in which they were found.

    The tree only narrows the search; what decides is plain arithmetic in fixed order.
    """

    def __init__(self, marks: FloatArray) -> None:
        """Begin with some members.

        Args:
            marks: (n, 6) float64, taken as they are.
        """
        self._marks = marks
        self._plant()

    def __len__(self) -> int:
        return len(self._marks)

    def sift(self, marks: FloatArray) -> tuple[list[int], list[bool]]:
        """Offer signatures, one after the other; those that are distinct from all members become members.

        Args:
            marks: (n, 6) float64; one that is not a number is never distinct.

        Returns:
            For each, the number of its nearest member (its own if it entered, -1 if it is not a number), and whether
            it entered.
        """
        if len(self._marks) - self._in_tree > max(_FRESH, self._in_tree // 4):
            self._plant()
        near = self._narrowed(marks)
        fresh = self._marks[self._in_tree :]
        members: list[int] = []
        entered: list[bool] = []
        for index, mark in enumerate(marks):
            if not np.isfinite(mark).all():
                members.append(-1)
                entered.append(False)
                continue
            known = np.concatenate([self._marks[near[index]], fresh])
            squares = squared_distances(mark, known)
            nearest = int(squares.argmin()) if len(known) else -1
            if nearest >= 0 and squares[nearest] < DISTINCT * DISTINCT:
                old = len(near[index])
                members.append(near[index][nearest] if nearest < old else self._in_tree + nearest - old)
                entered.append(False)
            else:
                members.append(self._in_tree + len(fresh))
                entered.append(True)
                fresh = np.concatenate([fresh, mark[None]])
        self._marks = np.concatenate([self._marks[: self._in_tree], fresh])
        return members, entered

    def near(self, marks: FloatArray) -> npt.NDArray[np.bool_]:
        """Which of (n, 6) signatures are like a member; none that is not a number is."""
        if len(self._marks) > self._in_tree:
            self._plant()
        found = np.zeros(len(marks), bool)
        sound = np.flatnonzero(np.isfinite(marks).all(axis=1))
        if self._tree is not None:
            found[sound] = _near_any(self._tree, self._marks, marks[sound], workers=1)
        return found

    def _plant(self) -> None:
        from scipy.spatial import cKDTree  # islands without an archive do without scipy

        self._in_tree = len(self._marks)
        self._tree = cKDTree(self._marks) if self._in_tree else None

    def _narrowed(self, marks: FloatArray) -> list[list[int]]:
        """Members of the tree that may be nearer than `DISTINCT`, in order, for each signature."""
        sound = np.isfinite(marks).all(axis=1)
        near: list[list[int]] = [[] for _ in marks]
        if self._tree is not None and sound.any():
            found = self._tree.query_ball_point(marks[sound], DISTINCT * _SLACK, return_sorted=True)
            for index, members in zip(np.flatnonzero(sound).tolist(), found, strict=True):
                near[index] = list(map(int, members))
        return near


def first_of_each_shape(marks: FloatArray) -> npt.NDArray[np.bool_]:
    """Which signatures are distinct from all earlier ones that are: what `DistinctSet.sift` says, by the million.

    Args:
        marks: (n, 6) float64, in the order that decides; one that is not a number is never distinct.

    Returns:
        (n,) bool.
    """
    from scipy.spatial import cKDTree

    entered = np.zeros(len(marks), bool)
    members = np.zeros(0, np.intp)  # of the tree
    fresh = np.zeros(0, np.intp)  # members since it was planted
    tree = None
    start, size = 0, _FIRST_BLOCK
    while start < len(marks):
        block = np.arange(start, min(start + size, len(marks)))
        start, size = start + size, min(2 * size, _BLOCK)
        block = block[np.isfinite(marks[block]).all(axis=1)]
        for known, planted in ((members, tree), (fresh, cKDTree(marks[fresh]) if len(fresh) else None)):
            if planted is not None:
                block = block[~_near_any(planted, marks[known], marks[block])]
        chosen = block[_greedy(marks[block])]
        entered[chosen] = True
        fresh = np.concatenate([fresh, chosen])
        if len(fresh) > max(_BLOCK, len(members) // 4):
            members, fresh = np.concatenate([members, fresh]), np.zeros(0, np.intp)
            tree = cKDTree(marks[members])
    return entered


def _near_any(tree: Any, members: FloatArray, marks: FloatArray, workers: int = -1) -> npt.NDArray[np.bool_]:
    """Which signatures are nearer than `DISTINCT` to a member; plain sums say where the tree's arithmetic may err."""
    distance, _ = tree.query(marks, distance_upper_bound=DISTINCT * _SLACK, workers=workers)
    near = distance < DISTINCT / _SLACK
    for index in np.flatnonzero(~near & np.isfinite(distance)):
        around = tree.query_ball_point(marks[index], DISTINCT * _SLACK)
        near[index] = bool((squared_distances(marks[index], members[around]) < DISTINCT * DISTINCT).any())
    return np.asarray(near, bool)


def _greedy(marks: FloatArray) -> npt.NDArray[np.intp]:
    """Indices of signatures that are distinct from the earlier ones chosen."""
    from scipy.spatial import cKDTree

    if not len(marks):
        return np.zeros(0, np.intp)
    pairs = cKDTree(marks).query_pairs(DISTINCT * _SLACK, output_type="ndarray")
    squares = np.zeros(len(pairs))
    for column in range(LENGTH):
        difference = marks[pairs[:, 1], column] - marks[pairs[:, 0], column]
        squares += difference * difference
    pairs = pairs[squares < DISTINCT * DISTINCT]
    stays = np.ones(len(marks), bool)
    for earlier, later in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))].tolist():
        if stays[earlier]:
            stays[later] = False
    return np.flatnonzero(stays)


def squared_distances(one: FloatArray, many: FloatArray) -> FloatArray:
    """Squared distances (n,) of one signature (6,) from many (n, 6)."""
    total = np.zeros(len(many))
    for column in range(LENGTH):
        difference = many[:, column] - one[column]
        total += difference * difference
    return total


@functools.cache
def projection() -> tuple[tuple[float, ...], ...]:
    """The discriminants: six rows of sixteen weights."""
    text = importlib.resources.files("fractal_farm").joinpath("distinctness.json").read_text()
    return tuple(tuple(row) for row in json.loads(text)["projection"])
