"""The course of a run: start what is ready, commit what is complete, stop where the limits say (DESIGN section 4).

Whole epochs of all islands are committed in order, so the content of a catalogue is a function of the configuration,
the seed and the number of epochs, whoever did the work and however often it was interrupted.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fractal_farm.catalogue.steering import bind_wishes, steering_requests
from fractal_farm.config import RunConfig
from fractal_farm.distinctness import DistinctSet, signatures
from fractal_farm.errors import FarmError, StorageFullError
from fractal_farm.evolution.designs import Designs, genomes_of
from fractal_farm.evolution.epoch import EpochRecord, IslandState
from fractal_farm.farm.events import (
    Announcer,
    Continued,
    Draining,
    EpochCompleted,
    Fault,
    MeshFinished,
    Migration,
    PartCommitted,
    Paused,
    Progress,
    Steered,
)
from fractal_farm.farm.executor import (
    ClusterLostError,
    EpochDone,
    Executor,
    Finished,
    MeshDone,
    NoRoom,
    PartDone,
    Trouble,
    WorkLost,
)
from fractal_farm.farm.limits import fraction_done, kept, patience_s, reached, totals_after
from fractal_farm.farm.mesh_queue import MeshQueue
from fractal_farm.farm.records import Ledger, pack_ledger, pack_states
from fractal_farm.farm.room import Room
from fractal_farm.farm.schedule import Schedule
from fractal_farm.farm.steering import take_in
from fractal_farm.farm.work import MeshOrder, Part, SetAside

PART_DESIGNS = 256
PART_SECONDS = 20.0
SNAPSHOT_EPOCHS = 200
_FIRST_PART_SECONDS = 1.0
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
    set_aside: list[tuple[int, int, SetAside]] = field(default_factory=list)


class Run:
    """One session of a run: from the last committed epoch to the end, or to the next interruption."""

    def __init__(
        self,
        config: RunConfig,
        root: Path,
        executor: Executor,
        schedule: Schedule,
        progress: Progress,
        shapes: DistinctSet,
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
            shapes: shapes found up to that epoch.
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
        self.progress = self._committed = progress
        self._shapes = shapes
        self._queue = queue
        self._meshes_before = queue.started
        self._announce = announce
        self._interrupted = interrupted
        self._files, self._bytes = usage
        self._elapsed_before = elapsed_before_s
        self._parameters = config.solids.parameters
        self._group = _Group(progress=progress)
        self._in_flight: tuple[Part, Progress] | None = None
        self._withheld = False
        self._set_aside: dict[int, list[tuple[int, int, SetAside]]] = {}
        self._room = Room(root, config.catalogue.min_free_gb, self._tell_of_room)
        self._snapshot_epoch = schedule.complete
        self._meshing = 0
        self.meshes = 0
        self.mesh_failures = 0
        self._losses = 0
        self._mesh_losses: dict[str, int] = {}
        self._started = self._moved = time.monotonic()
        self._evaluated_before = progress.evaluated
        self._ending: str | None = reached(config, progress)

    def evolve(self) -> str:
        """Run until a limit or an interruption, and commit what is complete.

        Returns:
            Why the evolution ended.

        Raises:
            ClusterLostError: nobody is left to work, or nothing has finished for a long time.
            FarmError: the work itself failed.
        """
        while self._ending is None or self._group.records or self._in_flight:
            if self._ending is None:
                self._ending = self._why_end()
                if self._ending is not None:
                    self._announce(Draining(self._ending))
            if self._withheld and (reason := self._interrupted()) is not None:
                self._give_up_what_has_no_room(reason)
                break
            self._start_work()
            self._hear()
        assert self._ending is not None
        return self._ending

    def mesh_the_rest(self) -> None:
        """Make solids of the best designs until the budget is spent, the designs are, or somebody interrupts."""
        while self._interrupted() is None:
            short = self._room.is_short()
            if not short or self._room.due:
                self._start_meshes(1.0)
            if not self._meshing and not (short and self._queue.left):
                return
            self._hear()

    def _hear(self) -> None:
        self._take_wishes()
        finished = self._executor.wait(_WAIT_SECONDS)
        for item in finished:
            self._take(item)
        self._check_moving(bool(finished))

    def _take_wishes(self) -> None:
        """What somebody wishes the run to breed from is bound to the first epoch that no island has begun."""
        run_id, known = self._config.run_id, len(self._schedule.steering)
        try:
            requests = bind_wishes(self._root, run_id, self._schedule.unbegun())
        except StorageFullError:  # the others wait for room; those that are bound begin in time
            requests = steering_requests(self._root, run_id)[known:]
        take_in(self._schedule, requests, self._config.evolution)
        for request in requests:
            self._announce(Steered(request.first, request.last, request.design_ids))

    @property
    def elapsed_s(self) -> float:
        """Seconds that this and all earlier sessions have worked."""
        return self._elapsed_before + time.monotonic() - self._started

    def _start_work(self) -> None:
        # The writer must keep up: nothing is started while a full part waits behind the one that is being written.
        backlog = self._in_flight is not None and self._group.designs >= _BACKLOG_DESIGNS
        short = self._room.is_short()
        if self._ending is None and not backlog and not short:
            for island, epoch in self._schedule.ready():
                self._executor.start_epoch(island, epoch, *self._schedule.start(island, epoch))
            self._start_meshes(fraction_done(self._config, self.progress, self.elapsed_s))
        if self._withheld and self._in_flight is not None and self._room.due:
            self._withheld = False
            self._executor.commit(self._in_flight[0])
        group = self._group
        if group.records and self._in_flight is None:
            full = group.designs >= PART_DESIGNS or time.monotonic() - group.opened >= self._part_seconds()
            if full or self._ending is not None:
                self._commit(group)

    def _part_seconds(self) -> float:
        """Short at first: a session that is killed young has gone some way, too."""
        age_s = time.monotonic() - self._started
        return min(PART_SECONDS, max(_FIRST_PART_SECONDS, age_s / 4))

    def _take(self, item: Finished) -> None:
        if isinstance(item, EpochDone):
            self._losses = 0
            self._take_verdicts(item)
            self._take_record(item.record)
        elif isinstance(item, PartDone):
            self._take_receipt(item)
        elif isinstance(item, NoRoom):
            self._wait_for_room(item)
        elif isinstance(item, Trouble):
            self._announce(Fault(item.where, item.cause, item.remedy))
        elif isinstance(item, MeshDone):
            self._room.accept()
            self._meshing -= 1
            self.meshes += item.failure is None
            self.mesh_failures += item.failure is not None
            identity = item.order.genome.design_id
            limit = self._config.solids.max
            done = self._meshes_before + self.meshes
            self._announce(MeshFinished(identity, item.seconds, done, limit, item.failure))
        else:
            self._start_again(item)

    def _take_verdicts(self, done: EpochDone) -> None:
        island, epoch = done.record.island, done.record.epoch
        for verdict in done.set_aside:
            self._set_aside.setdefault(epoch, []).append((island, epoch, verdict))
            self._announce(Fault(f"genome {verdict.design_id}", verdict.reason, "it is set aside, with its reason"))

    def _take_record(self, record: EpochRecord) -> None:
        if self._ending is not None:
            return  # beyond the last epoch
        if record.arrivals:
            self._announce(Migration(record.island, record.epoch, record.arrivals, record.settled))
        for complete, states in self._schedule.finish(record):
            if self._ending is not None:
                return
            records = [replace(record, born=self._with_distinct(record.born)) for record in complete]
            progress = totals_after(self._config, self.progress, records)
            self.progress = progress
            if not self._group.records:
                self._group.opened = time.monotonic()
            self._group.records += records
            self._group.set_aside += sorted(self._set_aside.pop(records[0].epoch, ()), key=lambda entry: entry[0])
            self._group.states = states
            self._group.designs += progress.designs - self._group.progress.designs
            self._group.progress = progress
            session_s = self.elapsed_s - self._elapsed_before
            rate = (progress.evaluated - self._evaluated_before) / max(session_s, 1e-9)
            self._announce(EpochCompleted(records[0].epoch, progress, self.elapsed_s, rate))
            self._ending = reached(self._config, progress)

    def _with_distinct(self, born: Designs) -> Designs:
        """The designs, with the qualified ones of new shapes marked; they are looked at in the order of their slots."""
        born = born.copy()
        order = np.lexsort((born["slot"], born["generation"]))
        qualified = order[born["fitness"][order] > self._config.evolution.qualified]
        rows = born[qualified]
        _, entered = self._shapes.sift(signatures(rows["descriptor"], rows["d0"], rows["d2"]))
        born["distinct"][qualified] = entered
        return born

    def _commit(self, group: _Group) -> None:
        rows = np.concatenate([record.born for record in group.records])
        last = group.records[-1].epoch
        snapshot = None
        if last - self._snapshot_epoch >= SNAPSHOT_EPOCHS or self._ending is not None:
            hearsay = self._schedule.hearsay
            snapshot = pack_states(group.states, None if hearsay is None else hearsay.until(last))
            self._snapshot_epoch = last
        steered = len(self._schedule.steering)
        ledger = Ledger(group.records, group.progress, self.elapsed_s, tuple(group.set_aside), steered)
        part = Part(rows, kept(self._config, rows), pack_ledger(ledger), group.records[0].epoch, last, snapshot)
        self._in_flight = (part, group.progress)
        self._group = _Group(progress=group.progress)
        self._executor.commit(part)

    def _take_receipt(self, done: PartDone) -> None:
        assert self._in_flight is not None
        part, progress = self._in_flight
        self._in_flight = None
        self._room.accept()
        self._committed = progress
        receipt = done.receipt
        self._files += receipt.files
        self._bytes += receipt.bytes
        phenotype = self._config.evolution.phenotype.phenotype()
        rows = part.rows[part.kept & (part.rows["fitness"] > self._config.evolution.qualified)]
        for row, genome in zip(rows, genomes_of(rows, phenotype), strict=True):
            order = MeshOrder(genome, self._parameters, self._config.solids.formats, self._config.solids.material)
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

    def _wait_for_room(self, refused: NoRoom) -> None:
        self._room.refuse(refused.cause)
        if isinstance(refused.what, Part):
            self._withheld = True
        else:
            self._meshing -= 1
            self._queue.again(refused.what)

    def _give_up_what_has_no_room(self, reason: str) -> None:
        """Somebody ends the run while the disk is full: it ends at its last commit, and can be resumed."""
        assert self._in_flight is not None
        self._ending = reason
        self.progress = self._committed
        self._group, self._in_flight = _Group(), None

    def _tell_of_room(self, cause: str | None) -> None:
        self._announce(Continued("there is room on the disk again") if cause is None else Paused(cause))

    def _start_again(self, lost: WorkLost) -> None:
        """What was lost to a dead process is started again, from what the run itself knows."""
        self._losses += 1
        if self._losses > _LOSSES_IN_A_ROW * self._config.evolution.islands:
            raise FarmError(f"workers died {self._losses} times in a row ({lost.cause}); see `farm doctor`")
        if isinstance(lost.what, Part):
            self._announce(Fault("writer", lost.cause, "the part is written again"))
            assert self._in_flight is not None
            self._in_flight = (replace(lost.what, again=True), self._in_flight[1])
            self._executor.commit(self._in_flight[0])
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
                self._executor.start_epoch(island, epoch, *self._schedule.start(island, epoch))

    def _why_end(self) -> str | None:
        """Reasons that depend on the clock or on somebody's wish: the run ends at its last complete epoch."""
        hours = self._config.stop.hours
        if hours is not None and self.elapsed_s >= 3600.0 * hours:
            return f"{hours:g} hours have passed"
        return self._interrupted()

    def _check_moving(self, moved: bool) -> None:
        now = time.monotonic()
        if moved or self._room.is_short():
            self._moved = now
        elif now - self._moved > patience_s(self._config, self._executor.workers):
            raise ClusterLostError(f"nothing has finished for {now - self._moved:.0f} s; see the Ray logs")
