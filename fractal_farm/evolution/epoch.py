"""What passes between islands and those who drive them: candidates, scores, states and the record of an epoch.

A record holds no more than what changed; with the state before it, it gives the state after it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.distinctness import DESCRIPTOR_LENGTH
from fractal_farm.evolution.designs import SCORE_FIELDS, Designs, design_dtype, unpadded
from fractal_farm.evolution.offspring import max_maps
from fractal_farm.ifs.genome import ROW_LENGTH, Genome, Phenotype

Wanted = Literal["foreseen", "within", "scores", "gap", "solid"]
STEERED = -1
"""In an inbox, the source of designs that somebody chose: only genes, identity and birth place are filled in."""
ELSEWHERE = -2
"""In an inbox, the source of what other islands have found, see `hearsay.FIND`."""


class Candidates(NamedTuple):
    """Genomes to evaluate.

    Attributes:
        genes: (B, M, K) float64, padded with 0.
        n_maps: (B,) int64.
        wanted: "scores"; "gap" for that number alone, "within" for `niches.gap` in its place
            where it is no more than that, and infinity elsewhere; "solid" for the gap and estimates of the solid;
            "foreseen" for what closed forms say of D0, D2, fitness and descriptor, the latter where the fitness is
            `niches.expected_fitness` or more.
        symmetries: (B,) codes of `ifs.symmetry`; None: nobody has any.
    """

    genes: npt.NDArray[np.float64]
    n_maps: npt.NDArray[np.int64]
    wanted: Wanted = "scores"
    symmetries: npt.NDArray[Any] | None = None

    def part(self, which: slice | npt.NDArray[Any]) -> Candidates:
        """Some of them, by a slice, a mask or indices."""
        symmetries = None if self.symmetries is None else self.symmetries[which]
        return self._replace(genes=self.genes[which], n_maps=self.n_maps[which], symmetries=symmetries)

    def genomes(self, phenotype: Phenotype) -> list[Genome]:
        """All of them as genomes."""
        symmetries = np.zeros(len(self.n_maps), np.uint8) if self.symmetries is None else self.symmetries
        return unpadded(self.genes, self.n_maps, symmetries, phenotype)


class Scores(NamedTuple):
    """What was found out about candidates.

    Attributes:
        values: (B, 10) float64 in the order of `SCORE_FIELDS`, nan where it was not wanted.
        refusals: (B,) uint8 `Refusal` codes.
        descriptors: (B, 14) float32, nan where it was not wanted.
    """

    values: npt.NDArray[np.float64]
    refusals: npt.NDArray[np.uint8]
    descriptors: npt.NDArray[np.float32]

    @classmethod
    def unknown(cls, count: int) -> Scores:
        """Scores of so many candidates that nothing is known of."""
        values = np.full((count, len(SCORE_FIELDS)), np.nan)
        descriptors = np.full((count, DESCRIPTOR_LENGTH), np.nan, np.float32)
        return cls(values, np.zeros(count, np.uint8), descriptors)


@dataclass(frozen=True)
class GenerationStatistics:
    """What happened in one generation of one island.

    Attributes:
        generation: its number; 0 is the founding of the library.
        evaluated: candidates that were evaluated.
        refused: candidates among them that got no score.
        accepted: candidates that passed the elimination.
        qualified: candidates above the threshold of qualified designs.
        joined: candidates that entered the library.
        mean_accepted: mean fitness of the accepted (0 if there are none).
        best: highest fitness in the library afterwards.
    """

    generation: int
    evaluated: int
    refused: int
    accepted: int
    qualified: int
    joined: int
    mean_accepted: float
    best: float


@dataclass(frozen=True)
class IslandState:
    """An island after an epoch; epoch -1 is before it was founded, with an empty library.

    Attributes:
        epoch: its number.
        library: members.
        elsewhere: what it had heard of other islands by then; None if they keep their finds to themselves.
    """

    epoch: int
    library: Designs
    elsewhere: Designs | None = None


@dataclass(frozen=True)
class EpochRecord:
    """Everything that an epoch of an island decided.

    Attributes:
        island: index of the island.
        epoch: number of the epoch.
        survivors: indices into the previous library, in the order in which they lead the new one.
        entrants: rows that follow them; `library_after` puts the two together.
        order: permutation that puts survivors and entrants into the library's order.
        emigrants: indices into the new library of those whose copies leave.
        born: rows that joined the library at some time of the epoch, in order of birth.
        statistics: one entry a generation.
        arrivals: (source island, number sent) for each source; `settled` of them found a place.
        settled: number of arrivals that found a place.
        hits: by how much the hits of every member of the new library have grown; empty without niches.
    """

    island: int
    epoch: int
    survivors: npt.NDArray[np.int32]
    entrants: Designs
    order: npt.NDArray[np.int32]
    emigrants: npt.NDArray[np.int32]
    born: Designs
    statistics: tuple[GenerationStatistics, ...]
    arrivals: tuple[tuple[int, int], ...] = ()
    settled: int = 0
    hits: npt.NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))


def founding_state(config: EvolutionConfig) -> IslandState:
    """The state of any island before its first epoch."""
    dtype = design_dtype(max_maps(config), ROW_LENGTH[config.phenotype.family])
    return IslandState(-1, np.zeros(0, dtype))


def state_after(before: IslandState, record: EpochRecord, inbox: list[tuple[int, Designs]]) -> IslandState:
    """The state at the end of a record's epoch, from the one before it and what had arrived."""
    news = [found for source, found in inbox if source == ELSEWHERE]
    heard = [found for found in (before.elsewhere, *news) if found is not None]
    elsewhere = np.concatenate(heard) if heard else None
    return IslandState(record.epoch, library_after(before.library, record), elsewhere)


def library_after(previous: Designs, record: EpochRecord) -> Designs:
    """The library at the end of a record's epoch, from the one before it."""
    library = _taken(np.concatenate([_taken(previous, record.survivors), record.entrants]), record.order)
    if len(record.hits):
        library["hits"] += record.hits
    return library


def _taken(rows: Designs, places: npt.NDArray[np.int32]) -> Designs:
    """`rows[places]`; the rows themselves where that is all of them in their order, as in a library that only grows."""
    return rows if np.array_equal(places, np.arange(len(rows))) else rows[places]
