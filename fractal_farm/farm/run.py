"""The course of a run: start what is ready, commit what is complete, stop where the limits say (DESIGN section 4).

Whole epochs of all islands are committed in order, so the content of a catalogue is a function of the configuration,
the seed and the number of epochs, whoever did the work and however often it was interrupted.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError
from fractal_farm.evolution.designs import Designs
from fractal_farm.evolution.island import EpochRecord, IslandState
from fractal_farm.farm.events import (
    Announcer,
    Draining,
    EpochCompleted,
    Fault,
    MeshFinished,
    Migration,
    PartCommitted,
    Progress,
)
from fractal_farm.farm.executor import EpochDone, Executor, Finished, MeshDone, PartDone, WorkLost
from fractal_farm.farm.mesh_queue import MeshQueue
from fractal_farm.farm.records import Ledger, pack_ledger, pack_states
from fractal_farm.farm.schedule import Schedule
from fractal_farm.farm.work import MeshOrder, Part
from fractal_farm.ifs.genome import Genome
from fractal_farm.solid import SolidParameters

PART_DESIGNS = 256
PART_SECONDS = 20.0
SNAPSHOT_EPOCHS = 200
STALL_SECONDS = 600.0
_SECONDS_A_POINT = 4e-7  # a slow evaluation: 2 ms for 5,000 points
_SLOTS_FOR_ONE = 4  # slots that one accepted offspring costs, at most, as a rule
_WAIT_SECONDS = 0.25
_LOSSES_IN_A_ROW = 20
_MESH_TRIES = 3
_BACKLOG_DESIGNS = 8 * PART_DESIGNS


@dataclass
class _Group:
    """Complete epochs that wait to be committed together."""

    records: list[EpochRecord] = field(default_factory=list)
    states: dict[int, IslandState] = field(default_factory=dict)
    progress: Progress = field(default_factory=Progress)
    designs: int = 0
    opened: float = 0.0


class Run:
    """One session of a run: from the last committed epoch to the end, or to the next interruption."""

    def __init__(
        self,
        config: RunConfig,
        root: Path,
        executor: Executor,
        schedule: Schedule,
        progress: Progress,
        queue: MeshQueue,
        announce: Announcer,
        interrupted: Callable[[], str | None],
        usage: tuple[int, int],
        elapsed_before_s: float = 0.0,
    ) -> None:
        """Put the parts of a run together.

        Args:
            config: the run's configuration.
            root: the catalogue.
            executor: who works.
            schedule: where the islands stand.
            progress: totals up to the last committed epoch.
            queue: designs that wait for a mesh.
            announce: hears the events.
            interrupted: why the run should end now, or None.
            usage: files and bytes in the catalogue.
            elapsed_before_s: seconds that earlier sessions have worked.
        """
        self._config = config
        self._root = root
        self._executor = executor
        self._schedule = schedule
        self.progress = progress
        self._queue = queue
        self._meshes_before = queue.started
        self._announce = announce
        self._interrupted = interrupted
        self._files, self._bytes = usage
        self._elapsed_before = elapsed_before_s
        self._parameters = SolidParameters(size_mm=config.solids.size_mm, wall_mm=config.solids.wall_mm)
        self._group = _Group(progress=progress)
        self._in_flight: tuple[Part, Progress] | None = None
        self._snapshot_epoch = schedule.complete
        self._meshing = 0
        self.meshes = 0
        self.mesh_failures = 0
        self._losses = 0
        self._mesh_losses: dict[str, int] = {}
        self._started = self._moved = time.monotonic()
        self._evaluated_before = progress.evaluated
        self._ending: str | None = self._reached(progress)

    def evolve(self) -> str:
        """Run until a limit or an interruption, and commit what is complete.

        Returns:
            Why the evolution ended.

        Raises:
            FarmError: no progress for a long time, or the work itself failed.
        """
        while self._ending is None or self._group.records or self._in_flight:
            if self._ending is None:
                self._ending = self._why_end()
                if self._ending is not None:
                    self._announce(Draining(self._ending))
            self._start_work()
            finished = self._executor.wait(_WAIT_SECONDS)
            for item in finished:
                self._take(item)
            self._check_moving(bool(finished))
        return self._ending

    def mesh_the_rest(self) -> None:
        """Make solids of the best designs until the budget is spent, the designs are, or somebody interrupts."""
        while self._must_stop() is None:
            self._start_meshes(1.0)
            if not self._meshing:
                return
            finished = self._executor.wait(_WAIT_SECONDS)
            for item in finished:
                self._take(item)
            self._check_moving(bool(finished))

    @property
    def elapsed_s(self) -> float:
        """Seconds that this and all earlier sessions have worked."""
        return self._elapsed_before + time.monotonic() - self._started

    def _start_work(self) -> None:
        # The writer must keep up: nothing is started while a full part waits behind the one that is being written.
        backlog = self._in_flight is not None and self._group.designs >= _BACKLOG_DESIGNS
        if self._ending is None and not backlog:
            for island, epoch in self._schedule.ready():
                state = self._schedule.state[island]
                self._executor.start_epoch(island, epoch, self._schedule.start(island, epoch), state)
            self._start_meshes(self._fraction_done())
        group = self._group
        if group.records and self._in_flight is None:
            full = group.designs >= PART_DESIGNS or time.monotonic() - group.opened >= PART_SECONDS
            if full or self._ending is not None:
                self._commit(group)

    def _take(self, item: Finished) -> None:
        if isinstance(item, EpochDone):
            self._losses = 0
            self._take_record(item.record)
        elif isinstance(item, PartDone):
            self._take_receipt(item)
        elif isinstance(item, MeshDone):
            self._meshing -= 1
            self.meshes += item.failure is None
            self.mesh_failures += item.failure is not None
            identity = item.order.genome.design_id
            limit = self._config.solids.max
            done = self._meshes_before + self.meshes
            self._announce(MeshFinished(identity, item.seconds, done, limit, item.failure))
        else:
            self._start_again(item)

    def _take_record(self, record: EpochRecord) -> None:
        if self._ending is not None:
            return  # beyond the last epoch
        if record.arrivals:
            self._announce(Migration(record.island, record.epoch, record.arrivals, record.settled))
        for records, states in self._schedule.finish(record):
            if self._ending is not None:
                return
            progress = self._totals(records)
            self.progress = progress
            if not self._group.records:
                self._group.opened = time.monotonic()
            self._group.records += records
            self._group.states = states
            self._group.designs += progress.designs - self._group.progress.designs
            self._group.progress = progress
            session_s = self.elapsed_s - self._elapsed_before
            rate = (progress.evaluated - self._evaluated_before) / max(session_s, 1e-9)
            self._announce(EpochCompleted(records[0].epoch, progress, self.elapsed_s, rate))
            self._ending = self._reached(progress)

    def _totals(self, records: list[EpochRecord]) -> Progress:
        """The totals after one more epoch of all islands."""
        entries = [entry for record in records for entry in record.statistics]
        kept = sum(int(self._kept(record.born).sum()) for record in records)
        qualified = sum(int((record.born["fitness"] > self._config.evolution.qualified).sum()) for record in records)
        last = [record.statistics[-1] for record in records]
        accepted = sum(entry.accepted for entry in last)
        before = self.progress
        return Progress(
            epochs=before.epochs + 1,
            evaluated=before.evaluated + sum(entry.evaluated for entry in entries),
            accepted=before.accepted + sum(entry.accepted for entry in entries),
            qualified=before.qualified + sum(entry.qualified for entry in entries),
            designs=before.designs + kept,
            kept_qualified=before.kept_qualified + qualified,
            best_fitness=max(entry.best for entry in last),
            mean_accepted=sum(entry.mean_accepted * entry.accepted for entry in last) / max(accepted, 1),
            settled=before.settled + sum(record.settled for record in records),
        )

    def _kept(self, rows: Designs) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        evolution = self._config.evolution
        if self._config.catalogue.keep == "accepted":
            return np.asarray(rows["fitness"] >= evolution.elimination)
        return np.asarray(rows["fitness"] > evolution.qualified)

    def _commit(self, group: _Group) -> None:
        rows = np.concatenate([record.born for record in group.records])
        last = group.records[-1].epoch
        snapshot = None
        if last - self._snapshot_epoch >= SNAPSHOT_EPOCHS or self._ending is not None:
            snapshot = pack_states(group.states)
            self._snapshot_epoch = last
        ledger = Ledger(group.records, group.progress, self.elapsed_s)
        part = Part(rows, self._kept(rows), pack_ledger(ledger), group.records[0].epoch, last, snapshot)
        self._in_flight = (part, group.progress)
        self._group = _Group(progress=group.progress)
        self._executor.commit(part)

    def _take_receipt(self, done: PartDone) -> None:
        assert self._in_flight is not None
        part, progress = self._in_flight
        self._in_flight = None
        receipt = done.receipt
        self._files += receipt.files
        self._bytes += receipt.bytes
        phenotype = self._config.evolution.phenotype.phenotype()
        for row in part.rows[part.kept & (part.rows["fitness"] > self._config.evolution.qualified)]:
            genome = Genome(row["genes"][: int(row["n_maps"])], phenotype)
            order = MeshOrder(genome, self._parameters, self._config.solids.formats)
            self._queue.offer(order, float(row["fitness"]), receipt.gaps[genome.design_id])
        self._announce(
            PartCommitted(
                receipt.first_epoch,
                receipt.last_epoch,
                receipt.designs,
                receipt.files,
                receipt.bytes,
                self._files,
                self._bytes,
                progress.designs,
                progress.epochs,
                self.elapsed_s,
            )
        )

    def _start_meshes(self, fraction: float) -> None:
        while self._executor.mesh_slots > 0:
            order = self._queue.take(fraction)
            if order is None:
                return
            self._meshing += 1
            self._executor.mesh(order)

    def _start_again(self, lost: WorkLost) -> None:
        """What was lost to a dead process is started again, from what the run itself knows."""
        self._losses += 1
        if self._losses > _LOSSES_IN_A_ROW * self._config.evolution.islands:
            raise FarmError(f"workers died {self._losses} times in a row ({lost.cause}); see `farm doctor`")
        if isinstance(lost.what, Part):
            self._announce(Fault("writer", lost.cause, "the part is written again"))
            self._executor.commit(lost.what)
        elif isinstance(lost.what, MeshOrder):
            identity = lost.what.genome.design_id
            self._mesh_losses[identity] = self._mesh_losses.get(identity, 0) + 1
            if self._mesh_losses[identity] >= _MESH_TRIES:
                failure = f"its worker died {_MESH_TRIES} times ({lost.cause}); try a lower resolution with farm mesh"
                self._take(MeshDone(lost.what, 0.0, failure))
                return
            self._announce(Fault("mesh worker", lost.cause, "the design goes back into the queue"))
            self._meshing -= 1
            self._queue.again(lost.what)
        else:
            island, epoch = lost.what
            self._announce(Fault(f"island {island}", lost.cause, f"epoch {epoch} starts again"))
            if self._ending is None:
                inbox = self._schedule.start(island, epoch)
                self._executor.start_epoch(island, epoch, inbox, self._schedule.state[island])

    def _why_end(self) -> str | None:
        """Reasons that depend on the clock, the user or the disk: the run ends at its last complete epoch."""
        hours = self._config.stop.hours
        if hours is not None and self.elapsed_s >= 3600.0 * hours:
            return f"{hours:g} hours have passed"
        return self._must_stop()

    def _must_stop(self) -> str | None:
        """Reasons that end the making of solids too."""
        if (reason := self._interrupted()) is not None:
            return reason
        free = shutil.disk_usage(self._root).free
        if free < self._config.catalogue.min_free_gb * 1e9:
            return f"only {free / 1e9:.1f} GB of disk are free"
        return None

    def _reached(self, progress: Progress) -> str | None:
        """Counting limits, tested on complete epochs alone: the same epoch for any order of work."""
        stop = self._config.stop
        limits = (
            ("epochs", stop.epochs, progress.epochs),
            ("evaluations", stop.evaluations, progress.evaluated),
            ("qualified designs", stop.qualified, progress.kept_qualified),
        )
        for name, limit, value in limits:
            if limit is not None and value >= limit:
                return f"{value} {name}"
        return None

    def _fraction_done(self) -> float:
        """How far the run is on its way to the nearest limit; 1 if there is none."""
        stop = self._config.stop
        shares = [
            value / limit
            for limit, value in (
                (stop.epochs, self.progress.epochs),
                (stop.evaluations, self.progress.evaluated),
                (stop.qualified, self.progress.kept_qualified),
                (stop.hours, self.elapsed_s / 3600.0),
            )
            if limit is not None
        ]
        return max(shares) if shares else 1.0

    def _check_moving(self, moved: bool) -> None:
        now = time.monotonic()
        if moved:
            self._moved = now
        elif now - self._moved > self._patience_s():
            raise FarmError(
                f"nothing has finished for {now - self._moved:.0f} s; see the Ray logs, then `farm resume {self._root}`"
            )

    def _patience_s(self) -> float:
        """How long nothing may finish: many times what an epoch of all islands can take."""
        evolution = self._config.evolution
        generation = evolution.offspring or _SLOTS_FOR_ONE * (evolution.accepted or 1)
        genomes = evolution.islands * (evolution.library.size + evolution.generations_per_epoch * generation)
        epoch_s = genomes * _SECONDS_A_POINT * evolution.phenotype.points / self._executor.workers
        return max(STALL_SECONDS, 10.0 * epoch_s)
