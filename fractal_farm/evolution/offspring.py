"""Broods: the genomes of a block of slots, bred from a library or drawn at random.

A slot whose similarity dimension falls outside the configured range, or of which the closed forms promise too little,
draws again from its own stream, up to `ATTEMPTS` times, and then stays empty.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.evolution.archive import parent_weights
from fractal_farm.evolution.designs import Designs, Operator
from fractal_farm.evolution.foresight import expected_fitness
from fractal_farm.evolution.operators import (
    block_crossover,
    gaussian_mutation,
    proportional,
    random_genes,
    similarity_dimension_within,
)
from fractal_farm.ifs.genome import RHO, ROW_LENGTH
from fractal_farm.random_streams import Purpose, stream

ATTEMPTS = 16
STEERED_SHARE = 0.5
"""Of the parents drawn while a run is steered, those that somebody chose."""

Place = tuple[int, int, int, int]
Slots = npt.NDArray[np.intp]


class Brood(NamedTuple):
    """Genomes of the slots that were filled.

    Attributes:
        slots: (B,) int32, increasing.
        genes: (B, M, K) float64, padded with rows of 0.
        n_maps: (B,) int64.
        parents: (B, 2) design ids as bytes, empty where there is none.
        operators: (B,) uint8, `Operator` codes.
    """

    slots: npt.NDArray[np.int32]
    genes: npt.NDArray[np.float64]
    n_maps: npt.NDArray[np.int64]
    parents: npt.NDArray[np.bytes_]
    operators: npt.NDArray[np.uint8]


def max_maps(config: EvolutionConfig) -> int:
    """The largest number of maps that any genome of a run can have."""
    return max([*config.library.map_counts, *(len(seed) for seed in config.library.seeds)])


def founders(config: EvolutionConfig, island: int) -> Brood:
    """The brood of generation 0: the configured seeds first, random genomes after them."""
    size = config.library.size
    brood = _filled(config, np.arange(size), lambda k, rows: _random(config, (island, 0, 0, k), size, rows))
    seeds = config.library.seeds[:size]
    if not seeds:
        return brood
    genes = np.zeros((len(seeds), *brood.genes.shape[1:]))
    for index, maps in enumerate(seeds):
        genes[index, : len(maps)] = maps
    planted = Brood(
        np.arange(len(seeds), dtype=np.int32),
        genes,
        np.array([len(maps) for maps in seeds], np.int64),
        np.zeros((len(seeds), 2), "S32"),
        np.full(len(seeds), Operator.SEED, np.uint8),
    )
    rest = brood.slots >= len(seeds)
    columns: Any = zip(planted, brood, strict=True)
    return Brood(*(np.concatenate([ours, theirs[rest]]) for ours, theirs in columns))


def offspring(
    library: Designs,
    config: EvolutionConfig,
    island: int,
    generation: int,
    block: int,
    slots: int,
    wanted: Slots | None = None,
    again: int = 0,
    chosen: Designs | None = None,
) -> Brood:
    """A block of offspring.

    Args:
        library: parents; random genomes are drawn if there are none.
        config: evolution section.
        island: index of the island.
        generation: number of the generation, from 1.
        block: number of the block within the generation; its first slot is block * slots.
        slots: slots in a block.
        wanted: the slots of the block to fill; all if None.
        again: how often the block has been asked for before; each time draws other numbers.
        chosen: parents that somebody chose, and that are drawn as often as all of the library together.

    Returns:
        The slots that could be filled.
    """
    weights = library["fitness"] if config.method != "niches" else parent_weights(library, config)
    if chosen is not None and len(chosen):
        library, weights = _with_chosen(chosen, library, weights)
    random = config.method == "random" or len(library) == 0

    def draw(attempt: int, rows: Slots) -> Brood:
        place = (island, generation, block, attempt)
        return _random(config, place, slots, rows) if random else _bred(library, weights, config, place, slots, rows)

    brood = _filled(config, np.arange(slots) if wanted is None else wanted, draw, again * ATTEMPTS)
    return brood._replace(slots=brood.slots + np.int32(block * slots))


def _with_chosen(
    chosen: Designs, library: Designs, weights: npt.NDArray[np.float64]
) -> tuple[Designs, npt.NDArray[np.float64]]:
    """The chosen parents before those of the library, and the weights of all."""
    total = float(np.cumsum(weights)[-1]) if len(weights) else 0.0  # a plain sum, in order
    others = weights * ((1.0 - STEERED_SHARE) / total) if total > 0.0 else np.zeros(len(library))
    return np.concatenate([chosen, library]), np.concatenate(
        [np.full(len(chosen), STEERED_SHARE / len(chosen)), others]
    )


def _filled(config: EvolutionConfig, rows: Slots, draw: Callable[[int, Slots], Brood], first: int = 0) -> Brood:
    """Draw until every slot holds a candidate that is worth an evaluation, or has had its attempts."""
    if config.method != "niches" and (config.similarity_dimension is None or config.phenotype.family != "similarity"):
        return draw(first, rows)
    found = []
    for attempt in range(first, first + ATTEMPTS):
        brood = draw(attempt, rows)
        good = _worthwhile(brood, config)
        found.append([column[good] for column in brood])
        rows = rows[~good]
        if not len(rows):
            break
    joined = [np.concatenate(columns) for columns in zip(*found, strict=True)]
    order = np.argsort(joined[0])
    return Brood(*(column[order] for column in joined))


def _worthwhile(brood: Brood, config: EvolutionConfig) -> npt.NDArray[np.bool_]:
    """(B,) bool: similarity dimension in range; with niches also no copy, and as good as it must be expected to be."""
    good = np.ones(len(brood.slots), bool)
    if config.method == "niches":
        good = brood.operators != Operator.COPY
    if config.phenotype.family != "similarity":
        return good
    if config.similarity_dimension is not None:
        good &= similarity_dimension_within(brood.genes, brood.n_maps, config.similarity_dimension)
    least = config.niches.expected_fitness
    if config.method == "niches" and least is not None:
        for b in np.flatnonzero(good).tolist():
            good[b] = expected_fitness(brood.genes[b, : brood.n_maps[b], RHO].tolist(), config) >= least
    return good


def _random(config: EvolutionConfig, place: Place, slots: int, rows: Slots) -> Brood:
    """Random genomes for some rows of a block."""
    affine = config.phenotype.family == "affine"
    rng = stream(config.seed, Purpose.FOUNDERS, *place)
    genes, n_maps = random_genes(rng, slots, max_maps(config), affine, config.library.map_counts)
    return Brood(
        rows.astype(np.int32),
        genes[rows],
        n_maps[rows],
        np.zeros((len(rows), 2), "S32"),
        np.full(len(rows), Operator.RANDOM, np.uint8),
    )


def _bred(
    library: Designs,
    weights: npt.NDArray[np.float64],
    config: EvolutionConfig,
    place: Place,
    slots: int,
    rows: Slots,
) -> Brood:
    """Offspring for some rows of a block; numbers are drawn for all rows, so that none depends on the others."""
    shape = (slots, max_maps(config), ROW_LENGTH[config.phenotype.family])
    drawn = stream(config.seed, Purpose.PARENTS, *place).random((slots, 2))[rows]
    first, second = proportional(weights, drawn).T
    n_maps, identities = library["n_maps"], library["design_id"]
    genes, crossed = block_crossover(
        library["genes"][first],
        library["genes"][second],
        n_maps[first],
        n_maps[second],
        stream(config.seed, Purpose.CROSSOVER, *place).random((slots, 3))[rows],
        config.crossover.probability if config.method != "niches" else config.niches.crossover,
    )
    probability, sigma = _scales(config, place, slots, rows)
    rng = stream(config.seed, Purpose.MUTATION, *place)
    genes, mutated = gaussian_mutation(
        genes,
        n_maps[first],
        rng.random(shape)[rows],
        rng.standard_normal(shape)[rows],
        probability,
        sigma,
        config.phenotype.family == "affine",
    )
    lineage = np.stack([identities[first], np.where(crossed, identities[second], b"")], axis=1)
    operators = np.choose(
        crossed + 2 * mutated,
        [Operator.COPY, Operator.CROSSOVER, Operator.MUTATION, Operator.CROSSOVER_MUTATION],
    )
    return Brood(rows.astype(np.int32), genes, n_maps[first], lineage.astype("S32"), operators.astype(np.uint8))


def _scales(
    config: EvolutionConfig, place: Place, slots: int, rows: Slots
) -> tuple[float, float] | tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Probability and standard deviation of mutation: one for all, or with niches drawn for each slot, (rows, 1, 1)."""
    if config.method != "niches":
        return config.mutation.probability, config.mutation.sigma
    drawn = stream(config.seed, Purpose.SCALES, *place).random((slots, 2))[rows]
    choices = (np.array(config.niches.probabilities), np.array(config.niches.sigmas))
    probability, sigma = (
        values[(drawn[:, k] * len(values)).astype(np.intp)][:, None, None] for k, values in enumerate(choices)
    )
    return probability, sigma
