"""An island's library as an archive of distinct designs (DESIGN section 8; prototypes 'diversity').

A qualified design enters if its signature is at least 1 away from every member's; otherwise it is a *hit* on the
nearest one. Parents are drawn so that each number of maps has its quota, and within it by 1 / sqrt(hits), which leads
the search to where few have been, times min(1, limit / gap), which leads it to what prints in one piece. A member that
does not print gives way to a near-duplicate of clearly smaller gap.

Members are looked at in one order, that of the rows: the archive is a function of what was offered, and when. What
decides is computed in plain arithmetic of fixed order; the tree only narrows the search.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.distinctness import DISTINCT, signatures, squared_distances
from fractal_farm.evolution.designs import Designs

FloatArray = npt.NDArray[np.float64]

_SLACK = 1.0 + 1e-9  # by which the tree looks farther than counts
_LEAST_WEIGHT = 0.02  # of a member with a wide gap, that of a printable one being 1
_SMALLER = 0.8  # share of a member's gap that a successor may have


def signatures_of(designs: Designs) -> FloatArray:
    """Signatures (n, 6) of design rows."""
    return signatures(designs["descriptor"], designs["d0"], designs["d2"])


def parent_weights(library: Designs, config: EvolutionConfig) -> FloatArray:
    """How often each member of an archive is drawn as a parent, (members,) float64 above 0."""
    limit = config.niches.gap
    wide = np.where(np.isfinite(library["gap"]), np.maximum(library["gap"], limit), np.inf)
    weights = np.maximum(limit / wide, _LEAST_WEIGHT) / np.sqrt(library["hits"] + 1.0)
    shares = config.library.map_counts
    for count in np.unique(library["n_maps"]).tolist():
        members = library["n_maps"] == count
        total = float(np.cumsum(weights[members])[-1])  # a plain sum, in order
        weights[members] *= max(shares.get(count, 0.0), _LEAST_WEIGHT) / total
    return np.asarray(weights, np.float64)


class Archive:
    """The archive of an island for the length of one epoch.

    Attributes:
        library: (members,) design rows.
    """

    def __init__(self, library: Designs, config: EvolutionConfig) -> None:
        from scipy.spatial import cKDTree  # islands without an archive do without scipy

        self.library = library.copy()
        self._config = config
        self._signatures = signatures_of(library)
        self._in_tree = len(library)
        self._tree = cKDTree(self._signatures) if len(library) else None

    def sift(self, offered: Designs) -> tuple[list[int], list[tuple[int, int]]]:
        """Take in the distinct among some designs, without a gap as yet, and count hits.

        Args:
            offered: qualified rows with identities and descriptors, none of them a member.

        Returns:
            Indices of those that entered, which are the last members now, in this order; and (index, member) of
            near-duplicates of members that do not print.
        """
        marks = signatures_of(offered)
        near = self._narrowed(marks)
        limit = self._config.niches.gap
        entered: list[int] = []
        rivals: list[tuple[int, int]] = []
        fresh = self._signatures[self._in_tree :]
        hits = self.library["hits"]
        new_hits = np.zeros(len(offered), np.int32)
        members = len(self.library)
        for index, mark in enumerate(marks):
            known = np.concatenate([self._signatures[near[index]], fresh])
            if len(known):
                squares = squared_distances(mark, known)
                nearest = int(squares.argmin())
                if squares[nearest] < DISTINCT * DISTINCT:
                    old = len(near[index])
                    member = near[index][nearest] if nearest < old else self._in_tree + nearest - old
                    if member >= members:
                        new_hits[member - members] += 1
                        continue
                    hits[member] += 1
                    if not self.library["gap"][member] <= limit:
                        rivals.append((index, member))
                    continue
            entered.append(index)
            fresh = np.concatenate([fresh, mark[None]])
        rows = offered[entered]
        rows["hits"] = new_hits[: len(entered)]
        self.library = np.concatenate([self.library, rows])
        self._signatures = np.concatenate([self._signatures[: self._in_tree], fresh])
        return entered, rivals

    def replace(self, rivals: Designs, members: list[int]) -> Designs:
        """Let near-duplicates, now with their gap, take the places of members with a clearly larger one.

        Returns:
            Those that did.
        """
        taken = []
        for index, member in enumerate(members):
            if rivals["gap"][index] < _SMALLER * _known(self.library["gap"][member]):
                row = rivals[index].copy()
                row["hits"] = self.library["hits"][member]
                self.library[member] = row
                taken.append(index)
        return rivals[taken]

    def trim(self) -> None:
        """Down to capacity: the crowded and those with wide gaps leave first, the youngest of equals before others."""
        capacity = self._config.niches.capacity
        if len(self.library) > capacity:
            order = np.argsort(-parent_weights(self.library, self._config), kind="stable")
            stay = np.sort(order[:capacity])
            self.__init__(self.library[stay], self._config)  # type: ignore[misc]

    def _narrowed(self, marks: FloatArray) -> list[list[int]]:
        """Members of the tree that may be nearer than `DISTINCT`, in order, for each signature."""
        if self._tree is None or not len(marks):
            return [[] for _ in marks]
        found = self._tree.query_ball_point(marks, DISTINCT * _SLACK, return_sorted=True)
        return [list(map(int, members)) for members in found]


def _known(gap: float) -> float:
    return float(gap) if np.isfinite(gap) else np.inf
