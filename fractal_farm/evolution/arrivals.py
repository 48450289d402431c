"""Who comes to an island from elsewhere: migrants, and designs that somebody wants it to breed from."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np

from fractal_farm.config import EvolutionConfig
from fractal_farm.evolution.archive import Archive
from fractal_farm.evolution.designs import SCORE_FIELDS, Designs, unseen, without_repeats
from fractal_farm.evolution.epoch import Candidates, GenerationStatistics, Scores
from fractal_farm.evolution.migration import settle
from fractal_farm.evolution.screening import ForeseenShapes

_GAP = SCORE_FIELDS.index("gap")
_SPARE = 8  # a library that needs room gets an eighth more


@dataclass
class WorkingSpace:
    """The working space of one epoch.

    With niches the archive holds the library, and `foreseen` what known shapes were expected to be. `chosen` are more
    parents. `room` is where a library that grows lies, with space behind it; `seen` are the identities in it.
    """

    library: Designs
    chosen: Designs
    archive: Archive | None = None
    foreseen: ForeseenShapes | None = None
    born: list[Designs] = field(default_factory=list)
    statistics: list[GenerationStatistics] = field(default_factory=list)
    room: Designs | None = None
    seen: set[bytes] = field(default_factory=set)

    def append(self, designs: Designs) -> Designs:
        """Let the library grow by the designs that are not in it; those. A long library is not copied each time."""
        count = len(self.library)
        if self.room is None or self.library.base is not self.room:
            self.room, self.seen = self.library, set(self.library["design_id"].tolist())
        newcomers = unseen(designs, self.seen)
        end = count + len(newcomers)
        if end > len(self.room):
            self.room = np.concatenate([self.library, np.zeros(end - count + count // _SPARE, self.library.dtype)])
        self.room[count:end] = newcomers
        self.library = self.room[:end]
        return newcomers


def steered(
    work: WorkingSpace, designs: Designs, config: EvolutionConfig, island: int, epoch: int
) -> Generator[Candidates, Scores, None]:
    """Chosen designs become parents for this epoch; in their first one they also arrive, and are born on island 0."""
    scores = yield Candidates(designs["genes"], designs["n_maps"], "scores", designs["symmetry"])
    chosen = designs.copy()
    for column, name in enumerate(SCORE_FIELDS):
        chosen[name] = scores.values[:, column]
    chosen["descriptor"] = scores.descriptors
    if work.archive is not None:
        gaps = yield Candidates(designs["genes"], designs["n_maps"], "gap", designs["symmetry"])
        chosen["gap"] = gaps.values[:, _GAP]
    work.chosen = chosen[scores.refusals == 0]
    arrivals = work.chosen[work.chosen["epoch"] == epoch]
    if len(arrivals):
        settled(work, [arrivals], config, island, int(arrivals["generation"][0]))
        work.born.append(arrivals if island == 0 else arrivals[:0])


def settled(work: WorkingSpace, inbox: list[Designs], config: EvolutionConfig, island: int, generation: int) -> int:
    """Let arrivals find their places; how many did."""
    arrivals = np.concatenate(inbox)
    if work.archive is None:
        policy = config.migration.replacement
        work.library, number = settle(work.library, arrivals, policy, config.seed, island, generation)
        return number
    arrivals["hits"] = 0
    entered, _ = work.archive.sift(without_repeats(arrivals, work.archive.library))
    work.archive.trim()
    work.library = work.archive.library
    return len(entered)
