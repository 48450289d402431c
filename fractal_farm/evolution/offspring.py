"""Broods: the genomes of a block of slots, bred from a library or drawn at random.

A slot whose similarity dimension falls outside the configured range draws again from its own stream, up to `ATTEMPTS`
times, and then stays empty. With niches all draws of a slot are made at once, and `screening` chooses among them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.distinctness import LENGTH
from fractal_farm.evolution.archive import parent_weights
from fractal_farm.evolution.designs import Designs, Operator
from fractal_farm.evolution.operators import (
    block_crossover,
    gaussian_mutation,
    proportional,
    random_genes,
    similarity_dimension_within,
)
from fractal_farm.ifs.genome import ROW_LENGTH
from fractal_farm.ifs.symmetry import NO_SYMMETRY, SYMMETRIES, symmetry_codes
from fractal_farm.random_streams import Purpose, stream

ATTEMPTS = 16
REDRAWN = 0.1
"""Of the offspring, those that draw a symmetry instead of inheriting it."""
STEERED_SHARE = 0.5
"""Of the parents drawn while a run is steered, those that somebody chose."""

Place = tuple[int, int, int]
"""Island, generation, block."""
Slots = npt.NDArray[np.intp]


class Brood(NamedTuple):
    """Genomes of the slots that were filled.

    Attributes:
        slots: (B,) int32, increasing.
        genes: (B, M, K) float64, padded with rows of 0.
        n_maps: (B,) int64.
        parents: (B, 2) design ids as bytes, empty where there is none.
        operators: (B,) uint8, `Operator` codes.
        symmetries: (B,) uint8 codes of `ifs.symmetry`.
        foreseen: (B, 6) float32 expected signatures, nan where there are none.
    """

    slots: npt.NDArray[np.int32]
    genes: npt.NDArray[np.float64]
    n_maps: npt.NDArray[np.int64]
    parents: npt.NDArray[np.bytes_]
    operators: npt.NDArray[np.uint8]
    symmetries: npt.NDArray[np.uint8]
    foreseen: npt.NDArray[np.float32]


Draw = Callable[[Sequence[int], Slots], Brood]
"""Numbers of draws, and slots: see `drawing`."""


def max_maps(config: EvolutionConfig) -> int:
    """The largest number of maps that any genome of a run can have."""
    return max([*config.library.map_counts, *(len(seed) for seed in config.library.seeds)])


def founders(config: EvolutionConfig, island: int) -> Brood:
    """The brood of generation 0: the configured seeds first, random genomes after them."""
    size = config.library.size
    nobody = np.zeros(0)
    return planted(_filled(config, size, _drawing(nobody, config, (island, 0, 0), size, None)), config)


def planted(brood: Brood, config: EvolutionConfig) -> Brood:
    """The founders, with the configured seeds in the first slots."""
    seeds = config.library.seeds[: config.library.size]
    if not seeds:
        return brood
    genes = np.zeros((len(seeds), *brood.genes.shape[1:]))
    for index, maps in enumerate(seeds):
        genes[index, : len(maps)] = maps
    ours = _brood(
        np.arange(len(seeds)),
        genes,
        np.array([len(maps) for maps in seeds], np.int64),
        np.zeros((len(seeds), 2), "S32"),
        np.full(len(seeds), Operator.SEED),
        symmetry_codes(config.library.seed_symmetries or [NO_SYMMETRY] * len(seeds))[: len(seeds)],
    )
    return joined([ours, selected(brood, brood.slots >= len(seeds))])


def offspring(
    library: Designs,
    config: EvolutionConfig,
    island: int,
    generation: int,
    block: int,
    slots: int,
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
        chosen: more parents, that somebody chose: they are drawn as often as all of the library together.

    Returns:
        The slots that could be filled.
    """
    draw = _drawing(library, config, (island, generation, block), slots, chosen)
    return _moved(_filled(config, slots, draw), block * slots)


def drawing(
    library: Designs,
    config: EvolutionConfig,
    place: Place,
    slots: int,
    chosen: Designs | None = None,
) -> Draw:
    """What draws offspring for some slots of a block, as often as one likes.

    Args:
        library: parents; random genomes are drawn if there are none.
        config: evolution section.
        place: island, generation, block.
        slots: slots in a block.
        chosen: see `offspring`.

    Returns:
        A function of the numbers of some draws, each of which has random numbers of its own, and of slots: the brood
        of all these draws for all these slots, all first draws before all second ones.
    """
    draw = _drawing(library, config, place, slots, chosen)
    return lambda attempts, rows: _moved(draw(attempts, rows), place[2] * slots)


def selected(brood: Brood, which: npt.NDArray[Any]) -> Brood:
    """Some members of a brood, by a mask or by indices."""
    columns: Any = (column[which] for column in brood)
    return Brood(*columns)


def joined(broods: list[Brood]) -> Brood:
    """One brood after the other."""
    columns: Any = zip(*broods, strict=True)
    return Brood(*(np.concatenate(parts) for parts in columns))


def _drawing(library: Designs, config: EvolutionConfig, place: Place, slots: int, chosen: Designs | None) -> Draw:
    """As `drawing`, with slots counted from the first of the block."""
    steered = chosen is not None and len(chosen) > 0
    if config.method == "random" or (len(library) == 0 and not steered):
        return lambda attempts, rows: _random(config, place, attempts, slots, rows)
    weights = library["fitness"] if config.method != "niches" else parent_weights(library, config)
    if chosen is not None and steered:
        library, weights = _with_chosen(chosen, library, weights)
    return lambda attempts, rows: _bred(library, weights, config, place, attempts, slots, rows)


def _with_chosen(
    chosen: Designs, library: Designs, weights: npt.NDArray[np.float64]
) -> tuple[Designs, npt.NDArray[np.float64]]:
    """The chosen parents before those of the library, and the weights of all."""
    total = float(np.cumsum(weights)[-1]) if len(weights) else 0.0  # a plain sum, in order
    others = weights * ((1.0 - STEERED_SHARE) / total) if total > 0.0 else np.zeros(len(library))
    ours = np.full(len(chosen), STEERED_SHARE / len(chosen))
    return np.concatenate([chosen, library]), np.concatenate([ours, others])


def _moved(brood: Brood, first: int) -> Brood:
    return brood._replace(slots=brood.slots + np.int32(first))


def _filled(config: EvolutionConfig, slots: int, draw: Draw) -> Brood:
    """Draw until every slot holds a candidate of a similarity dimension in range, or has had its attempts."""
    rows = np.arange(slots)
    if config.similarity_dimension is None or config.phenotype.family != "similarity":
        return draw([0], rows)
    found = []
    for attempt in range(ATTEMPTS):
        brood = draw([attempt], rows)
        good = similarity_dimension_within(brood.genes, brood.n_maps, config.similarity_dimension)
        found.append(selected(brood, good))
        rows = rows[~good]
        if not len(rows):
            break
    brood = joined(found)
    return selected(brood, np.argsort(brood.slots))


def _random(config: EvolutionConfig, place: Place, attempts: Sequence[int], slots: int, rows: Slots) -> Brood:
    """Random genomes for some rows of a block."""
    affine = config.phenotype.family == "affine"
    found = []
    for rng in _streams(config, Purpose.FOUNDERS, place, attempts):
        genes, n_maps = random_genes(rng, slots, max_maps(config), affine, config.library.map_counts)
        found.append((genes[rows], n_maps[rows]))
    genes, n_maps = (np.concatenate(parts) for parts in zip(*found, strict=True))
    parents, operators = np.zeros((len(n_maps), 2), "S32"), np.full(len(n_maps), Operator.RANDOM)
    symmetries, _ = _symmetries(config, place, attempts, slots, rows)
    return _brood(np.tile(rows, len(attempts)), genes, n_maps, parents, operators, symmetries)


def _brood(
    slots: npt.NDArray[Any],
    genes: npt.NDArray[np.float64],
    n_maps: npt.NDArray[np.int64],
    parents: npt.NDArray[Any],
    operators: npt.NDArray[Any],
    symmetries: npt.NDArray[np.uint8],
) -> Brood:
    """A brood of which nothing is foreseen."""
    foreseen = np.full((len(slots), LENGTH), np.nan, np.float32)
    lineage = parents.astype("S32"), operators.astype(np.uint8)
    return Brood(slots.astype(np.int32), genes, n_maps.astype(np.int64), *lineage, symmetries, foreseen)


def _bred(
    library: Designs,
    weights: npt.NDArray[np.float64],
    config: EvolutionConfig,
    place: Place,
    attempts: Sequence[int],
    slots: int,
    rows: Slots,
) -> Brood:
    """Offspring for some rows of a block."""
    shape = (slots, max_maps(config), ROW_LENGTH[config.phenotype.family])
    drawn = _uniform(config, Purpose.PARENTS, place, attempts, (slots, 2), rows)
    first, second = proportional(weights, drawn).T
    n_maps, identities = library["n_maps"], library["design_id"]
    genes, crossed = block_crossover(
        library["genes"][first],
        library["genes"][second],
        n_maps[first],
        n_maps[second],
        _uniform(config, Purpose.CROSSOVER, place, attempts, (slots, 3), rows),
        config.crossover.probability if config.method != "niches" else config.niches.crossover,
        config.crossover.kind,
    )
    probability, sigma = _scales(config, place, attempts, slots, rows)
    streams = _streams(config, Purpose.MUTATION, place, attempts)
    genes, mutated = gaussian_mutation(
        genes,
        n_maps[first],
        np.concatenate([rng.random(shape)[rows] for rng in streams]),
        np.concatenate([rng.standard_normal(shape)[rows] for rng in streams]),
        probability,
        sigma,
        config.phenotype.family == "affine",
        config.mutation.repair,
    )
    lineage = np.stack([identities[first], np.where(crossed, identities[second], b"")], axis=1)
    inherited = library["symmetry"][first].astype(np.uint8)
    symmetries, changed = _symmetries(config, place, attempts, slots, rows, inherited)
    operators = Operator.COPY + crossed + 2 * mutated + 4 * changed
    return _brood(np.tile(rows, len(attempts)), genes, n_maps[first], lineage, operators, symmetries)


def _symmetries(
    config: EvolutionConfig,
    place: Place,
    attempts: Sequence[int],
    slots: int,
    rows: Slots,
    inherited: npt.NDArray[np.uint8] | None = None,
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.bool_]]:
    """Symmetries drawn by the configured shares, or inherited and seldom drawn anew; and which are not inherited ones.

    Without any but `none` in the configuration nothing is drawn: what chosen parents have is inherited all the same.
    """
    count = len(attempts) * len(rows)
    before = np.zeros(count, np.uint8) if inherited is None else inherited
    if set(config.symmetries) == {NO_SYMMETRY}:
        return before, np.zeros(count, np.bool_)
    drawn = _uniform(config, Purpose.SYMMETRY, place, attempts, (slots, 2), rows)
    codes = np.sort(symmetry_codes(config.symmetries))
    shares = np.array([config.symmetries[SYMMETRIES[code].name] for code in codes])
    chosen = codes[proportional(shares, drawn[:, 0])]
    after = chosen if inherited is None else np.where(drawn[:, 1] < REDRAWN, chosen, before)
    return after, after != before


def _scales(
    config: EvolutionConfig, place: Place, attempts: Sequence[int], slots: int, rows: Slots
) -> tuple[float, float] | tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Probability and standard deviation of mutation: one for all, or with niches drawn for each one, (n, 1, 1)."""
    if config.method != "niches":
        return config.mutation.probability, config.mutation.sigma
    drawn = _uniform(config, Purpose.SCALES, place, attempts, (slots, 2), rows)
    choices = (np.array(config.niches.probabilities), np.array(config.niches.sigmas))
    probability, sigma = (
        values[(drawn[:, k] * len(values)).astype(np.intp)][:, None, None] for k, values in enumerate(choices)
    )
    return probability, sigma


def _uniform(
    config: EvolutionConfig,
    purpose: Purpose,
    place: Place,
    attempts: Sequence[int],
    shape: tuple[int, ...],
    rows: Slots,
) -> npt.NDArray[np.float64]:
    """Uniform numbers of some rows of a block, draw after draw; drawn for all rows, so that none depends on others."""
    return np.concatenate([rng.random(shape)[rows] for rng in _streams(config, purpose, place, attempts)])


def _streams(
    config: EvolutionConfig, purpose: Purpose, place: Place, attempts: Sequence[int]
) -> list[np.random.Generator]:
    return [stream(config.seed, purpose, *place, attempt) for attempt in attempts]
