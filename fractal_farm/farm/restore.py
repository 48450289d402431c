"""Where a run stands, from its committed records alone: the islands, the totals, the designs that wait for a mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.compute as pc

from fractal_farm.catalogue import Catalogue, committed_records, committed_until, last_epoch, latest_snapshot
from fractal_farm.catalogue.rows import GENOME_COLUMNS, genome_of
from fractal_farm.catalogue.steering import steering_requests
from fractal_farm.config import RunConfig
from fractal_farm.distinctness import LENGTH, DistinctSet, signatures
from fractal_farm.errors import FarmError
from fractal_farm.evolution.epoch import IslandState, founding_state, library_after
from fractal_farm.evolution.hearsay import FIND, Hearsay, are_shared, finds_of
from fractal_farm.evolution.migration import sources
from fractal_farm.farm.events import Progress
from fractal_farm.farm.mesh_queue import MeshQueue
from fractal_farm.farm.records import unpack_ledger, unpack_states
from fractal_farm.farm.schedule import Schedule
from fractal_farm.farm.steering import take_in
from fractal_farm.farm.work import MeshOrder


def restore(config: RunConfig, root: Path) -> tuple[Schedule, Progress, float]:
    """Where a run stands, from its committed records and its steering requests alone.

    Returns:
        The schedule after the last committed epoch, the totals up to it, and the seconds worked so far.

    Raises:
        FarmError: a part or a steering request is missing or damaged.
    """
    evolution = config.evolution
    empty = founding_state(evolution)
    dtype = empty.library.dtype
    states, found = dict.fromkeys(range(evolution.islands), empty), np.zeros(0, FIND)
    last = committed_until(root, config.run_id)
    lag = evolution.migration.lag
    # Emigrants of the last `lag` epochs are still under way, so the replay begins before them.
    if (snapshot := latest_snapshot(root, config.run_id, last - lag)) is not None:
        states, found = unpack_states(snapshot[1], dtype)
    start = states[0].epoch
    progress, elapsed_s = Progress(), 0.0
    outbox, finds = [], [found]
    steered = 0
    for (_, until), blob in committed_records(root, config.run_id, after=min(start, last - 1)):
        ledger = unpack_ledger(blob, dtype)
        progress, elapsed_s = ledger.progress, max(elapsed_s, ledger.elapsed_s)
        steered = max(steered, ledger.steered)
        for record in ledger.records if until > start else ():
            before = states[record.island]
            if record.epoch == before.epoch + 1:
                state = IslandState(record.epoch, library_after(before.library, record))
                states[record.island] = state
                outbox.append((record.island, record.epoch, state.library[record.emigrants]))
                finds.append(finds_of(record))
    migration = evolution.migration
    links = sources(migration.topology, evolution.islands, migration.degree, evolution.seed)
    hearsay = Hearsay(np.concatenate(finds)) if are_shared(evolution) else None
    schedule = Schedule(links, lag, states, last_epoch(root, config.run_id), hearsay)
    for island, epoch, leaving in outbox:
        if epoch > last - lag:
            schedule.remember(island, epoch, leaving)
    requests = steering_requests(root, config.run_id)
    if len(requests) < steered:
        raise FarmError(
            f"{root}: run {config.run_id} was steered {steered} times, and {len(requests)} of its requests "
            f"are there; restore runs/{config.run_id} from a copy"
        )
    take_in(schedule, requests, evolution)
    return schedule, progress, elapsed_s


def known_shapes(config: RunConfig, root: Path, until: int) -> DistinctSet:
    """The shapes that a run has found up to an epoch: those of its published designs, in the order of birth.

    What was committed beyond a lost part is born again, and must find the same shapes new.
    """
    shapes = DistinctSet(np.zeros((0, LENGTH)))
    columns = ["epoch", "island", "generation", "slot", "fitness", "d0", "d2", "descriptor"]
    designs = Catalogue.open(root).designs(columns, config.run_id)
    qualified = pc.greater(designs.column("fitness"), config.evolution.qualified)
    designs = designs.filter(pc.and_(qualified, pc.less_equal(designs.column("epoch"), until)))
    designs = designs.sort_by([(name, "ascending") for name in columns[:4]])
    if len(designs):
        descriptors = np.array(designs.column("descriptor").to_pylist(), np.float32)
        shapes.sift(signatures(descriptors, designs.column("d0").to_numpy(), designs.column("d2").to_numpy()))
    return shapes


def mesh_queue(config: RunConfig, root: Path) -> MeshQueue:
    """The designs of a run that have no solid yet."""
    settings = config.solids
    parameters = settings.parameters
    share = parameters.wall_mm / parameters.size_mm
    catalogue = Catalogue.open(root)
    made = {solid.design_id for solid in catalogue.solids() if solid.parameters_hash == parameters.hash}
    designs = catalogue.designs([*GENOME_COLUMNS, "fitness", "gap"], config.run_id)
    own = made.intersection(designs.column("design_id").to_pylist())
    queue = MeshQueue(settings.max, share, len(own))
    for identity in made:
        queue.skip(identity)
    designs = designs.filter(pc.greater(designs.column("fitness"), config.evolution.qualified))
    thickened = pc.greater(designs.column("gap"), share)
    designs = designs.append_column("thickened", thickened).sort_by(
        [("thickened", "ascending"), ("fitness", "descending"), ("design_id", "ascending")]
    )
    wanted = None if settings.max is None else 2 * settings.max
    for row in designs.slice(0, wanted).to_pylist():
        if row["design_id"] not in made:
            queue.offer(
                MeshOrder(genome_of(row), parameters, settings.formats, settings.material), row["fitness"], row["gap"]
            )
    return queue
