"""Which of many drawn genomes are evaluated, with niches: those that closed forms speak for, and that print.

Of `DRAWS` genomes a slot takes the first whose similarity dimension is in range, whose fitness is expected to qualify,
and whose shape is foreseen to be more than a bare line, and unlike all members of the archive and all candidates before
it. If its gap turns out too wide, the slot is drawn for again. What is foreseen decides who is evaluated, never what is
kept.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.distinctness import DistinctSet, signatures
from fractal_farm.evolution.designs import SCORE_FIELDS, Designs, Operator
from fractal_farm.evolution.epoch import Candidates, Scores, Wanted
from fractal_farm.evolution.fullness import is_full
from fractal_farm.evolution.offspring import Brood, Slots, drawing, joined, planted, selected

DRAWS = 16
_DRAWN_TOGETHER = 4
"""Draws that are foreseen at once: slots that find a candidate early do without the later ones."""
_D0, _D2, _FITNESS, _GAP = (SCORE_FIELDS.index(name) for name in ("d0", "d2", "fitness", "gap"))
_MOST_DIMENSIONS = 3.0


def screened_offspring(
    library: Designs,
    config: EvolutionConfig,
    island: int,
    generation: int,
    block: int,
    slots: int,
    shapes: ForeseenShapes,
    chosen: Designs | None = None,
) -> Generator[Candidates, Scores, tuple[Brood, Scores]]:
    """A block of offspring that are worth an evaluation and print in one piece, and their scores.

    Args:
        library: members of the archive.
        config: evolution section.
        island: index of the island.
        generation: number of the generation, from 1.
        block: number of the block within the generation.
        slots: slots in a block; those that find no candidate stay empty.
        shapes: what is foreseen of those that are known; candidates of this block are entered.
        chosen: more parents, see `offspring`.

    Yields:
        Candidates; send back their scores.
    """
    wanted: Slots = np.arange(slots)
    found: list[Brood] = []
    for again in range(max(1, config.niches.gap_attempts)):
        place = (island, generation, block)
        brood = yield from _promising(library, config, place, slots, wanted, again, shapes, chosen)
        if config.niches.gap_attempts:
            scores = yield from evaluated(brood, "within")
            brood = selected(brood, scores.values[:, _GAP] <= config.niches.gap)
        found.append(brood)
        wanted = np.setdiff1d(wanted, brood.slots - block * slots)
        if not len(wanted):
            break
    brood = joined(found)
    brood = selected(brood, np.argsort(brood.slots))
    scores = yield from evaluated(brood)
    if config.niches.gap_attempts:
        scores.values[:, _GAP] = config.niches.gap
    return brood, scores


class ForeseenShapes:
    """What is foreseen of the shapes that somebody has found, and of candidates, for the length of an epoch."""

    def __init__(self, known: npt.NDArray[np.float32], config: EvolutionConfig) -> None:
        """Begin with the (n, 6) expected signatures of shapes that are known, nan where nothing was expected."""
        self._distance = config.niches.foreseen_distance
        self._known = DistinctSet(self._sound(known))
        self._since = DistinctSet(self._sound(known[:0]))

    def forget_candidates(self, born_since: npt.NDArray[np.float32]) -> None:
        """Forget the candidates of earlier generations, but for those that were found to be new shapes."""
        self._since = DistinctSet(self._sound(born_since))

    def are_new(self, marks: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """Which candidates, (n, 6), are unlike all that was known when the epoch began."""
        return np.ones(len(marks), bool) if self._distance is None else ~self._known.near(self._units(marks))

    def enter(self, marks: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
        """Which of these new candidates, (n, 6), are unlike those that were entered before; they are entered."""
        if self._distance is None:
            return np.ones(len(marks), bool)
        return np.array(self._since.sift(self._units(marks))[1], bool)

    def _sound(self, marks: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
        """Those that are numbers."""
        return self._units(marks[np.isfinite(marks).all(axis=1)])

    def _units(self, marks: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
        """In units of the distance that is asked for."""
        return marks.astype(np.float64) / (self._distance or 1.0)


def screened_founders(config: EvolutionConfig, island: int) -> Generator[Candidates, Scores, Brood]:
    """The brood of generation 0: seeds, then random genomes that are worth an evaluation."""
    size = config.library.size
    nobody = np.zeros(0)
    brood = yield from _promising(nobody, config, (island, 0, 0), size, np.arange(size), 0, None)
    brood = planted(brood, config)
    if config.foreseeable:
        foreseen = yield Candidates(brood.genes, brood.n_maps, "foreseen", brood.symmetries)
        brood = brood._replace(foreseen=_marks(foreseen))
    return brood


def evaluated(brood: Brood, wanted: Wanted = "scores") -> Generator[Candidates, Scores, Scores]:
    """The scores of a brood; nobody is asked about an empty one."""
    if not len(brood.slots):
        return Scores.unknown(0)
    scores = yield Candidates(brood.genes, brood.n_maps, wanted, brood.symmetries)
    return scores


def _promising(
    library: Designs,
    config: EvolutionConfig,
    place: tuple[int, int, int],
    slots: int,
    wanted: Slots,
    again: int,
    shapes: ForeseenShapes | None,
    parents: Designs | None = None,
) -> Generator[Candidates, Scores, Brood]:
    """For each wanted slot the first of its draws that nothing speaks against."""
    draw = drawing(library, config, place, slots, parents)
    chosen: list[Brood] = []
    first = again * DRAWS
    for attempts in (range(first + k, first + k + _DRAWN_TOGETHER) for k in range(0, DRAWS, _DRAWN_TOGETHER)):
        brood = draw(attempts, wanted)
        good = brood.operators != Operator.COPY
        if config.foreseeable:
            foreseen = yield Candidates(brood.genes, brood.n_maps, "foreseen", brood.symmetries)
            brood = brood._replace(foreseen=_marks(foreseen))
            good &= _worthwhile(foreseen, config)
            if shapes is not None:
                good[good] = shapes.are_new(brood.foreseen[good])
        is_open = np.ones(len(wanted), bool)
        for start in range(0, len(good), len(wanted)):
            rows = np.flatnonzero(is_open & good[start : start + len(wanted)])
            if shapes is not None and config.foreseeable:
                rows = rows[shapes.enter(brood.foreseen[start + rows])]
            is_open[rows] = False
            chosen.append(selected(brood, start + rows))
        wanted = wanted[is_open]
        if not len(wanted):
            break
    brood = joined(chosen)
    return selected(brood, np.argsort(brood.slots))


def _worthwhile(foreseen: Scores, config: EvolutionConfig) -> npt.NDArray[np.bool_]:
    """(B,) bool: similarity dimension in range, as good as it must be expected to be, and no bare line.

    The D0 of a cloud tells of those parts that random iteration reaches: the D2 of closed forms foresees it better
    (standard deviation .07 for what is nearly a line) than their D0 does (.13).
    """
    good: npt.NDArray[np.bool_] = foreseen.refusals == 0
    if config.similarity_dimension is not None:
        low, high = config.similarity_dimension
        good &= (foreseen.values[:, _D0] >= low) & (foreseen.values[:, _D0] <= high)
    if config.niches.expected_fitness is not None:
        good &= foreseen.values[:, _FITNESS] >= config.niches.expected_fitness
    return good & is_full(foreseen.values[:, _D2], foreseen.descriptors, config)


def _marks(foreseen: Scores) -> npt.NDArray[np.float32]:
    """(B, 6) signatures that are expected."""
    d0, d2 = (np.minimum(foreseen.values[:, k], _MOST_DIMENSIONS) for k in (_D0, _D2))
    return signatures(foreseen.descriptors, d0, d2).astype(np.float32)
