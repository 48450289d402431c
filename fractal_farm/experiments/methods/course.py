"""One run in this process, epoch by epoch: the farm's schedule, islands and evaluation, without catalogue or Ray.

An evaluation is a whole one (cloud, D0, D2, LLE), counted as the farm counts it: what the paper's preset evaluates
beyond its tenth accepted offspring is as if it had never been drawn. Genomes that closed forms were asked about, and
searches for a gap, are counted apart. Islands work side by side: evaluations follow each other by (epoch, generation,
island).
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.evolution.designs import SCORE_FIELDS, Designs
from fractal_farm.evolution.epoch import Candidates, EpochRecord, IslandState, Scores, Wanted, founding_state
from fractal_farm.evolution.hearsay import FIND, Hearsay, are_shared
from fractal_farm.evolution.island import advance, drive
from fractal_farm.evolution.migration import sources
from fractal_farm.farm.schedule import Schedule
from fractal_farm.farm.work import evaluate_candidates, warm_up

_FITNESS = SCORE_FIELDS.index("fitness")
State = Mapping[str, npt.NDArray[Any]]
Block = tuple[npt.NDArray[np.float64], npt.NDArray[np.int64], npt.NDArray[np.float64]]
"""Candidates that were evaluated: genes (B, M, K), n_maps (B,) and fitness (B,)."""


class Totals(NamedTuple):
    """What a run has done and cost so far.

    Attributes:
        evaluated: whole evaluations.
        foreseen: genomes that closed forms were asked about.
        gap_searches: genomes whose gap was searched, to its end or until it was known to be wide or narrow enough.
        cpu_s: processor time, seconds.
        wall_s: time by the clock, seconds.
    """

    evaluated: float = 0
    foreseen: float = 0
    gap_searches: float = 0
    cpu_s: float = 0.0
    wall_s: float = 0.0


class Finds(NamedTuple):
    """Candidates that qualified, in the order in which they were evaluated.

    Attributes:
        number: (n,) int64 number of the evaluation, from 0.
        genes: (n, M, K) float64, padded with 0.
        n_maps: (n,) int64.
    """

    number: npt.NDArray[np.int64]
    genes: npt.NDArray[np.float64]
    n_maps: npt.NDArray[np.int64]


class Course:
    """A run that stands after some whole epoch of all islands.

    Attributes:
        totals: at the beginning and after each epoch.
    """

    def __init__(self, config: EvolutionConfig, state: State | None = None) -> None:
        """Begin, or go on from a `state`.

        Kernels are compiled here, so that no epoch is charged for it.
        """
        self._config = config
        migration = config.migration
        links = sources(migration.topology, config.islands, migration.degree, config.seed)
        empty = founding_state(config)
        libraries = dict.fromkeys(range(config.islands), empty) if state is None else _unpacked(state)
        found = np.zeros(0, FIND) if state is None else state["found"]
        hearsay = Hearsay(found) if are_shared(config) else None
        self._schedule = Schedule(links, migration.lag, libraries, hearsay=hearsay)
        self._leaving: dict[tuple[int, int], Designs] = {} if state is None else _unpacked_leaving(state)
        for (island, epoch), rows in self._leaving.items():
            self._schedule.remember(island, epoch, rows)
        self.totals = [Totals()] if state is None else [Totals(*row) for row in state["totals"].tolist()]
        warm_up(evaluate_candidates, config)

    def epoch(self) -> Finds:
        """Take all islands through one epoch; what qualified in it."""
        began = time.process_time(), time.perf_counter()
        asked: Counter[Wanted] = Counter()
        scored: list[tuple[int, int, Any]] = []
        for island, epoch in self._schedule.ready():
            clerk = _Clerk(self._config)
            inbox, start = self._schedule.start(island, epoch)
            record = drive(advance(start, inbox, self._config, island, epoch), clerk)
            self._schedule.finish(record)
            self._leaving[island, epoch] = self._schedule.state[island].library[record.emigrants]
            asked += clerk.asked
            scored += [(generation, island, block) for generation, block in _by_generation(clerk.blocks, record)]
        last = self._schedule.complete - self._config.migration.lag
        self._leaving = {key: rows for key, rows in self._leaving.items() if key[1] > last}
        scored.sort(key=lambda entry: entry[:2])
        genes, n_maps, fitness = (
            np.concatenate(parts) for parts in zip(*(block for _, _, block in scored), strict=True)
        )
        before = self.totals[-1]
        spent = time.process_time() - began[0], time.perf_counter() - began[1]
        counts = len(fitness), asked["foreseen"], asked["within"] + asked["gap"], *spent
        self.totals.append(Totals(*(old + new for old, new in zip(before, counts, strict=True))))
        qualified = np.flatnonzero(fitness > self._config.qualified)
        return Finds(qualified + int(before.evaluated), genes[qualified], n_maps[qualified])

    def state(self) -> State:
        """What it takes to go on from here, as arrays."""
        islands = self._schedule.state
        keys = sorted(self._leaving)
        hearsay = self._schedule.hearsay
        return {
            "found": np.zeros(0, FIND) if hearsay is None else hearsay.until(self._schedule.complete),
            "epoch": np.array(self._schedule.complete),
            "sizes": np.array([len(islands[island].library) for island in sorted(islands)]),
            "libraries": np.concatenate([islands[island].library for island in sorted(islands)]),
            "left": np.array([(*key, len(self._leaving[key])) for key in keys]),
            "leaving": np.concatenate([self._leaving[key] for key in keys]),
            "totals": np.array(self.totals, np.float64),
        }


class _Clerk:
    """Evaluates for an island, and writes down what was asked for and what was evaluated."""

    def __init__(self, config: EvolutionConfig) -> None:
        self._config = config
        self.asked: Counter[Wanted] = Counter()
        self.blocks: list[Block] = []

    def __call__(self, candidates: Candidates) -> Scores:
        scores = evaluate_candidates(candidates, self._config)
        self.asked[candidates.wanted] += len(candidates.n_maps)
        if candidates.wanted == "scores":
            self.blocks.append((candidates.genes, candidates.n_maps, scores.values[:, _FITNESS]))
        return scores


def _by_generation(blocks: list[Block], record: EpochRecord) -> Iterator[tuple[int, Block]]:
    """(generation, block) of what the farm counts: as many of each generation as its statistics say."""
    rest = iter(blocks)
    for entry in record.statistics:
        missing = entry.evaluated
        while missing > 0:
            genes, n_maps, fitness = next(rest)
            yield entry.generation, (genes[:missing], n_maps[:missing], fitness[:missing])
            missing -= len(fitness)


def _unpacked(state: State) -> dict[int, IslandState]:
    ends = np.cumsum(state["sizes"])[:-1]
    epoch = int(state["epoch"])
    return {island: IslandState(epoch, rows) for island, rows in enumerate(np.split(state["libraries"], ends))}


def _unpacked_leaving(state: State) -> dict[tuple[int, int], Designs]:
    islands, epochs, sizes = state["left"].T
    parts = np.split(state["leaving"], np.cumsum(sizes)[:-1])
    return {(int(island), int(epoch)): rows for island, epoch, rows in zip(islands, epochs, parts, strict=True)}
