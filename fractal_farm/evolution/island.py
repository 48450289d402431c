"""One island for one epoch, as a pure function of its state, its inbox and the configuration (DESIGN section 4).

`advance` is a generator: it yields blocks of candidates, is sent their scores, and returns the record of the epoch.
Whoever drives it decides where candidates are evaluated; nothing that is decided here depends on that.
"""

from __future__ import annotations

from collections.abc import Callable, Generator

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.evolution.archive import Archive, parent_weights
from fractal_farm.evolution.arrivals import WorkingSpace, settled, steered
from fractal_farm.evolution.designs import (
    SCORE_FIELDS,
    Designs,
    Operator,
    genomes_of,
    total_order,
    without_repeats,
)
from fractal_farm.evolution.epoch import (
    ELSEWHERE,
    STEERED,
    Candidates,
    EpochRecord,
    GenerationStatistics,
    IslandState,
    Scores,
    founding_state,
)
from fractal_farm.evolution.fullness import is_full
from fractal_farm.evolution.migration import emigrants
from fractal_farm.evolution.offspring import Brood, founders, offspring
from fractal_farm.evolution.screening import ForeseenShapes, evaluated, screened_founders, screened_offspring

_GAP = SCORE_FIELDS.index("gap")
_SOLID = slice(_GAP, len(SCORE_FIELDS))
ACCEPTED_BLOCK = 32
ACCEPTED_BLOCKS_LIMIT = 1024


def advance(
    state: IslandState,
    inbox: list[tuple[int, Designs]],
    config: EvolutionConfig,
    island: int,
    epoch: int,
) -> Generator[Candidates, Scores, EpochRecord]:
    """Take an island through one epoch.

    Args:
        state: the island after epoch - 1.
        inbox: (source island, emigrants) for each source, in index order; (`ELSEWHERE`, finds) of other islands;
            (`STEERED`, designs) for those that somebody wants it to breed from, which arrive in the epoch that is
            their birth place's.
        config: the evolution section of the run's configuration.
        island: index of the island.
        epoch: number of the epoch, from 0; epoch 0 also founds the library.

    Yields:
        Blocks of candidates; send back their `Scores`.

    Returns:
        The record of the epoch (as the generator's value).
    """
    before = state.library
    work = WorkingSpace(before, before[:0], Archive(before, config) if config.method == "niches" else None)
    first = epoch * config.generations_per_epoch + 1
    if epoch == 0:
        brood = founders(config, island) if work.archive is None else (yield from screened_founders(config, island))
        scores = yield from evaluated(brood)
        yield from _found(work, brood, scores, config, island)
    migrants = [(source, leaving) for source, leaving in inbox if source not in (STEERED, ELSEWHERE)]
    found_place = settled(work, [leaving for _, leaving in migrants], config, island, first) if migrants else 0
    for designs in (designs for source, designs in inbox if source == STEERED):
        yield from steered(work, designs, config, island, epoch)
    _hear(work, state, [found for source, found in inbox if source == ELSEWHERE], config)
    for generation in range(first, first + config.generations_per_epoch):
        yield from _generation(work, config, island, epoch, generation)
    yield from _measure_solids(work)
    after = work.library
    merit = after["fitness"] if work.archive is None else parent_weights(after, config)
    migration = config.migration
    leaving = emigrants(after, merit, migration.selection, migration.emigrants, config.seed, island, generation)
    origin = _origin(after, before)
    stayed, came = np.flatnonzero(origin >= 0), np.flatnonzero(origin < 0)
    order = np.empty(len(after), np.int32)
    order[np.concatenate([stayed, came])] = np.arange(len(after), dtype=np.int32)
    hits = np.zeros(len(after) if work.archive is not None else 0, np.int32)
    if work.archive is not None:
        hits[stayed] = after["hits"][stayed] - before["hits"][origin[stayed]]
    return EpochRecord(
        island,
        epoch,
        origin[stayed].astype(np.int32),
        after[came],
        order,
        np.array(leaving, np.int32),
        np.concatenate(work.born) if work.born else after[:0],
        tuple(work.statistics),
        tuple((source, len(leaving)) for source, leaving in migrants),
        found_place,
        hits,
    )


def drive(steps: Generator[Candidates, Scores, EpochRecord], evaluate: Callable[[Candidates], Scores]) -> EpochRecord:
    """Run `advance` to its end with one function that evaluates a block."""
    try:
        candidates = next(steps)
        while True:
            candidates = steps.send(evaluate(candidates))
    except StopIteration as stop:
        record: EpochRecord = stop.value
        return record


def _origin(after: Designs, before: Designs) -> npt.NDArray[np.intp]:
    """Where the designs of a library were in the one before, -1 for those that are new."""
    identities, known = after["design_id"], before["design_id"]
    if np.array_equal(identities[: len(known)], known):  # it has only grown, and may be long
        return np.concatenate([np.arange(len(known)), np.full(len(after) - len(known), -1)])
    places = {identity: k for k, identity in enumerate(known.tolist())}
    return np.array([places.get(identity, -1) for identity in identities.tolist()], np.intp)


def _found(
    work: WorkingSpace, brood: Brood, scores: Scores, config: EvolutionConfig, island: int
) -> Generator[Candidates, Scores, None]:
    """The first library: every founder that has a score, whatever its fitness; of an archive, as any generation."""
    rows = _scored(brood, scores, config, island, 0, 0)
    scored = rows[scores.refusals == 0]
    if work.archive is not None:
        found = yield from _enter(work, work.archive, scored, config)
    else:
        found = without_repeats(_identified(scored, config), work.library)
        work.library = np.concatenate([work.library, found])
    # Every island begins with the same seeds; they are born on the first.
    work.born.append(found if island == 0 else found[found["operator"] != Operator.SEED])
    work.statistics.append(_statistics(work, config, 0, rows["fitness"], scores.refusals, len(found)))


def _hear(work: WorkingSpace, state: IslandState, news: list[Designs], config: EvolutionConfig) -> None:
    """What other islands have found is known from now on; migrants were taken in all the same."""
    if work.archive is None:
        return
    heard = [found for found in (state.elsewhere, *news) if found is not None]
    if heard:
        work.archive.hear(np.concatenate([found["signature"] for found in heard]))
    work.foreseen = ForeseenShapes(np.concatenate([found["foreseen"] for found in (work.library, *heard)]), config)


def _generation(
    work: WorkingSpace, config: EvolutionConfig, island: int, epoch: int, generation: int
) -> Generator[Candidates, Scores, None]:
    """Breed, evaluate, eliminate, and let the accepted join."""
    rows: list[Designs] = []
    refusals: list[npt.NDArray[np.uint8]] = []
    accepted = 0
    block = 0
    if work.foreseen is not None:
        born_since = (work.library["epoch"] == epoch) & (work.library["island"] == island)
        work.foreseen.forget_candidates(work.library["foreseen"][born_since])
    while True:
        slots = config.offspring or ACCEPTED_BLOCK
        if work.archive is not None:
            place = (island, generation, block)
            assert work.foreseen is not None
            brood, scores = yield from screened_offspring(
                work.library, config, *place, slots, work.foreseen, work.chosen
            )
        else:
            brood = offspring(work.library, config, island, generation, block, slots, work.chosen)
            scores = yield from evaluated(brood)
        if len(brood.slots):
            scored = _scored(brood, scores, config, island, epoch, generation)
            passed = (scores.refusals == 0) & (scored["fitness"] >= config.elimination)
            count = len(scored)
            if config.accepted is not None and accepted + int(passed.sum()) >= config.accepted:
                # The slots after the last one needed are speculation: as if they had never been drawn.
                count = int(np.flatnonzero(passed)[config.accepted - accepted - 1]) + 1
            rows.append(scored[:count])
            refusals.append(scores.refusals[:count])
            accepted += int(passed[:count].sum())
        block += 1
        if config.accepted is None or accepted >= config.accepted or block == ACCEPTED_BLOCKS_LIMIT:
            break
    scored = np.concatenate(rows) if rows else work.library[:0]
    refused = np.concatenate(refusals) if refusals else np.zeros(0, np.uint8)
    passed = scored[(refused == 0) & (scored["fitness"] >= config.elimination)]
    if work.archive is not None:
        newcomers = yield from _enter(work, work.archive, passed, config)
    else:
        newcomers = _join(work, passed, config)
    work.born.append(newcomers)
    work.statistics.append(_statistics(work, config, generation, scored["fitness"], refused, len(newcomers)))


def _enter(
    work: WorkingSpace, archive: Archive, scored: Designs, config: EvolutionConfig
) -> Generator[Candidates, Scores, Designs]:
    """The distinct among the qualified enter the archive, with their gap or a bound of it; those that did.

    Bare lines stay out, unless they were given as seeds.
    """
    qualified = scored["fitness"] > config.qualified
    welcome = is_full(scored["d0"], scored["descriptor"], config) | (scored["operator"] == Operator.SEED)
    offered = without_repeats(_identified(scored[qualified & welcome], config), archive.library)
    entered, rivals = archive.sift(offered)
    asked = offered[entered + [index for index, _ in rivals]]
    unknown = np.isnan(asked["gap"])
    unknown[len(entered) :] = True  # a bound does not tell whose gap is smaller
    if unknown.any():
        sought = asked[unknown]
        scores = yield Candidates(sought["genes"], sought["n_maps"], "gap", sought["symmetry"])
        asked["gap"][unknown] = scores.values[:, _GAP]
    newcomers = asked[: len(entered)]
    archive.library["gap"][len(archive.library) - len(entered) :] = newcomers["gap"]
    successors = archive.replace(asked[len(entered) :], [member for _, member in rivals])
    archive.trim()
    work.library = archive.library
    return np.concatenate([newcomers, successors])


def _measure_solids(work: WorkingSpace) -> Generator[Candidates, Scores, None]:
    """Gaps and estimates of those born in this epoch, of whom no more was needed than that they print: all at once."""
    unmeasured = [rows[np.isnan(rows["grams"])] for rows in work.born]
    if work.archive is None or not any(map(len, unmeasured)):
        return
    designs = np.concatenate(unmeasured)
    scores = yield Candidates(designs["genes"], designs["n_maps"], "solid", designs["symmetry"])
    measured = dict(zip(designs["design_id"].tolist(), scores.values[:, _SOLID], strict=True))
    for rows in (*work.born, work.library):
        places = [k for k, identity in enumerate(rows["design_id"].tolist()) if identity in measured]
        for column, name in enumerate(SCORE_FIELDS[_SOLID]):
            rows[name][places] = [measured[identity][column] for identity in rows["design_id"][places].tolist()]


def _join(work: WorkingSpace, accepted: Designs, config: EvolutionConfig) -> Designs:
    """Accepted offspring join the library; with `keep_best` only those that are among its best afterwards."""
    if config.library.growth != "keep_best":
        return work.append(_identified(accepted, config))
    if len(work.library) >= config.library.size:
        # Those below the worst member cannot stay, and need no identity: hashing is the dear part.
        accepted = accepted[accepted["fitness"] >= work.library["fitness"].min()]
    newcomers = without_repeats(_identified(accepted, config), work.library)
    library = np.concatenate([work.library, newcomers])
    work.library = library[total_order(library)[: config.library.size]]
    return newcomers[np.isin(newcomers["design_id"], work.library["design_id"])]


def _scored(brood: Brood, scores: Scores, config: EvolutionConfig, island: int, epoch: int, generation: int) -> Designs:
    """Rows of a brood with their scores, still without identity."""
    rows = np.zeros(len(brood.slots), founding_state(config).library.dtype)
    rows["genes"] = brood.genes
    rows["n_maps"] = brood.n_maps
    rows["symmetry"] = brood.symmetries
    for column, name in enumerate(SCORE_FIELDS):
        rows[name] = scores.values[:, column]
    rows["descriptor"] = scores.descriptors
    rows["foreseen"] = brood.foreseen
    rows["parents"] = brood.parents
    rows["operator"] = brood.operators
    rows["island"] = island
    rows["epoch"] = epoch
    rows["generation"] = generation
    rows["slot"] = brood.slots
    return rows


def _identified(rows: Designs, config: EvolutionConfig) -> Designs:
    """The rows with their design ids."""
    rows["design_id"] = [genome.design_id.encode() for genome in genomes_of(rows, config.phenotype.phenotype())]
    return rows


def _statistics(
    work: WorkingSpace,
    config: EvolutionConfig,
    generation: int,
    fitness: npt.NDArray[np.float64],
    refusals: npt.NDArray[np.uint8],
    joined: int,
) -> GenerationStatistics:
    passed = fitness[(refusals == 0) & (fitness >= config.elimination)].tolist()
    best = float(work.library["fitness"].max()) if len(work.library) else 0.0
    return GenerationStatistics(
        generation,
        len(fitness),
        int((refusals != 0).sum()),
        len(passed),
        sum(value > config.qualified for value in passed),
        joined,
        sum(passed) / len(passed) if passed else 0.0,
        best,
    )
