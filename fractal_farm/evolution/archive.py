"""An island's library as an archive of distinct designs (DESIGN section 8; prototypes 'diversity').

A qualified design enters if its signature is at least 1 away from every member's; otherwise it is a *hit* on the
nearest one. Parents are drawn so that each number of maps has its quota, and within it by 1 / hits^2, which leads the
search to where few have been, times min(1, limit / gap), which leads it to what prints in one piece. A member that does
not print gives way to a near-duplicate of clearly smaller gap.

Members are looked at in one order, that of the rows: the archive is a function of what was offered, and when.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.distinctness import LENGTH, DistinctSet, signatures
from fractal_farm.evolution.designs import Designs

FloatArray = npt.NDArray[np.float64]

_LEAST_WEIGHT = 0.02  # of a member with a wide gap, that of a printable one being 1
_SMALLER = 0.8  # share of a member's gap that a successor may have


def signatures_of(designs: Designs) -> FloatArray:
    """Signatures (n, 6) of design rows."""
    return signatures(designs["descriptor"], designs["d0"], designs["d2"])


def parent_weights(library: Designs, config: EvolutionConfig) -> FloatArray:
    """How often each member of an archive is drawn as a parent, (members,) float64 above 0."""
    limit = config.niches.gap
    wide = np.where(np.isfinite(library["gap"]), np.maximum(library["gap"], limit), np.inf)
    visits = library["hits"] + 1.0
    weights = np.maximum(limit / wide, _LEAST_WEIGHT) / (visits * visits)
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
        self.library = library.copy()
        self._config = config
        self._elsewhere = np.zeros((0, LENGTH))
        self._shapes = self._known()

    def hear(self, elsewhere: FloatArray) -> None:
        """Turn away, from now on, what is like one of these (n, 6) signatures of shapes found elsewhere."""
        self._elsewhere = elsewhere
        self._shapes = self._known()

    def sift(self, offered: Designs) -> tuple[list[int], list[tuple[int, int]]]:
        """Take in the distinct among some designs, and count hits.

        Args:
            offered: qualified rows with identities and descriptors, none of them a member.

        Returns:
            Indices of those that entered, which are the last members now, in this order; and (index, member) of
            near-duplicates of earlier members that do not print.
        """
        members = len(self.library)
        nearest, entered = self._shapes.sift(signatures_of(offered))
        self.library = np.concatenate([self.library, offered[entered]])
        rivals = []
        for index, member in enumerate(map(self._member, nearest)):
            if member >= 0 and not entered[index]:
                self.library["hits"][member] += 1
                if member < members and not self.library["gap"][member] <= self._config.niches.gap:
                    rivals.append((index, member))
        return np.flatnonzero(entered).tolist(), rivals

    def replace(self, rivals: Designs, members: list[int]) -> Designs:
        """Let near-duplicates, now with their gap, take the places of members with a clearly larger one.

        Returns:
            Those that did.
        """
        taken = []
        for index, member in enumerate(members):
            gap = self.library["gap"][member]
            if rivals["gap"][index] < _SMALLER * (gap if np.isfinite(gap) else np.inf):
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
            self.library = self.library[np.sort(order[:capacity])]
            self._shapes = self._known()

    def _known(self) -> DistinctSet:
        """Members first: of a migrant and the news of it, the migrant counts the hits."""
        self._settled = len(self.library)
        return DistinctSet(np.concatenate([signatures_of(self.library), self._elsewhere]))

    def _member(self, number: int) -> int:
        """The member that is a number of the set of shapes; -1 if it is none."""
        if number < self._settled:
            return number
        later = number - len(self._elsewhere)
        return later if later >= self._settled else -1
