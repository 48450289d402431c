"""What islands tell each other: which shapes they have found, so that nobody looks for them again.

Designs stay where they were born, but for a few migrants; their marks go to all islands, an epoch after the migrants.
The archive of a run is thus spread over its islands, and no shape is sought twice for long.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.distinctness import LENGTH
from fractal_farm.evolution.archive import signatures_of
from fractal_farm.evolution.designs import Designs
from fractal_farm.evolution.epoch import EpochRecord

FIND = np.dtype([("epoch", "<i4"), ("island", "<i4"), ("signature", "<f8", (LENGTH,)), ("foreseen", "<f4", (LENGTH,))])
"""A shape that was found: its birth place, its signature and the one that was expected (nan: none was)."""
_RECENT_EPOCHS = 32


def finds_of(record: EpochRecord) -> npt.NDArray[Any]:
    """(n,) `FIND` rows of the designs that were born in an epoch of an island and are in its library after it."""
    rows = record.entrants
    born = rows[(rows["island"] == record.island) & (rows["epoch"] == record.epoch)]
    found = np.zeros(len(born), FIND)
    found["epoch"], found["island"] = record.epoch, record.island
    found["signature"] = signatures_of(born)
    found["foreseen"] = born["foreseen"]
    return found


def are_shared(config: EvolutionConfig) -> bool:
    """Whether the islands of a run tell each other what they find."""
    return config.method == "niches" and config.islands > 1 and config.migration.topology != "isolated"


class Hearsay:
    """All that was found in a run, in the order of (epoch, island)."""

    def __init__(self, found: npt.NDArray[Any]) -> None:
        """Begin with what is known, (n,) `FIND` rows in order."""
        self._chapters = [found]

    def tell(self, records: list[EpochRecord]) -> None:
        """Take in the records of all islands for the next epoch, in island order."""
        self._chapters.append(np.concatenate([finds_of(record) for record in records]))
        if len(self._chapters) > _RECENT_EPOCHS:
            self._chapters = [np.concatenate(self._chapters)]

    def until(self, epoch: int) -> npt.NDArray[Any]:
        """What was found up to an epoch."""
        found = np.concatenate(self._chapters)
        return found[: np.searchsorted(found["epoch"], epoch, side="right")]

    def elsewhere(self, island: int, first: int, last: int) -> Designs:
        """What other islands found from one epoch to another."""
        chapters = []
        for chapter in self._chapters:
            begin, end = np.searchsorted(chapter["epoch"], [first, last + 1])
            part = chapter[begin:end]
            chapters.append(part[part["island"] != island])
        return np.concatenate(chapters)
