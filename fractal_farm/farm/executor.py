"""What a run asks of whoever does its work, and what comes back.

An executor starts work and reports what has finished, in any order; the run decides everything else. `SerialExecutor`
does the work in this process, one piece at a time; `farm.on_ray` spreads it over a cluster.
"""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError, StorageFullError
from fractal_farm.evolution.designs import Designs
from fractal_farm.evolution.epoch import Candidates, EpochRecord, IslandState, Scores
from fractal_farm.evolution.island import advance, drive
from fractal_farm.farm.journal import Journal
from fractal_farm.farm.trials import evaluate_apart
from fractal_farm.farm.work import Evaluate, MeshOrder, Part, PartReceipt, SetAside, evaluate_candidates, make_solid

if TYPE_CHECKING:
    from fractal_farm.farm.publisher import Publisher

Inbox = list[tuple[int, Designs]]


class ClusterLostError(FarmError):
    """Those who worked are gone all together; what is committed is not."""


@dataclass(frozen=True)
class EpochDone:
    """An island has finished an epoch; `set_aside` are genomes that nobody could evaluate."""

    record: EpochRecord
    set_aside: tuple[SetAside, ...] = ()


@dataclass(frozen=True)
class PartDone:
    """A part is durable."""

    receipt: PartReceipt


@dataclass(frozen=True)
class MeshDone:
    """A solid is stored, or `failure` says why there is none."""

    order: MeshOrder
    seconds: float
    failure: str | None


@dataclass(frozen=True)
class WorkLost:
    """The process that did a piece of work died; it must be started again.

    Attributes:
        what: (island, epoch), the part, or the mesh order.
        cause: why, for the log.
    """

    what: tuple[int, int] | Part | MeshOrder
    cause: str


@dataclass(frozen=True)
class NoRoom:
    """A piece of work is done but cannot be stored until there is room; `cause` is one line about it."""

    what: Part | MeshOrder
    cause: str


@dataclass(frozen=True)
class Trouble:
    """Something went wrong beside the work, and was handled.

    Attributes:
        where: what it concerns.
        cause: what happened.
        remedy: what was done about it.
    """

    where: str
    cause: str
    remedy: str


Finished = EpochDone | PartDone | MeshDone | WorkLost | NoRoom | Trouble


class Executor(Protocol):
    """Starts pieces of work and reports what has finished.

    Every method may raise `ClusterLostError`.

    Attributes:
        name: "serial" or "ray".
        workers: evaluations that can run at the same time.
    """

    name: str
    workers: int

    def start_epoch(self, island: int, epoch: int, inbox: Inbox, state: IslandState) -> None:
        """Start an epoch of an island from the state before it."""

    def commit(self, part: Part) -> None:
        """Start making a part durable; one at a time."""

    def mesh(self, order: MeshOrder) -> None:
        """Start making a solid; evaluations go first."""

    @property
    def mesh_slots(self) -> int:
        """How many more solids could be started now."""

    def wait(self, timeout_s: float) -> list[Finished]:
        """What has finished since the last call; waits for something, at most for so long."""

    def close(self) -> None:
        """Drop all work in flight and free the workers."""


class SerialExecutor:
    """Everything in this process: parts first, then epochs, solids when nothing else is left.

    Genomes that an earlier session died of are evaluated in processes of their own.
    """

    name = "serial"
    workers = 1

    def __init__(
        self,
        config: RunConfig,
        new_publisher: Callable[[], Publisher],
        journal: Journal,
        evaluate: Evaluate = evaluate_candidates,
    ) -> None:
        self._config = config
        self._journal = journal
        self._evaluate = evaluate
        self._publisher = new_publisher()
        self._epochs: deque[tuple[int, int, Inbox, IslandState]] = deque()
        self._parts: deque[Part] = deque()
        self._meshes: deque[MeshOrder] = deque()

    def start_epoch(self, island: int, epoch: int, inbox: Inbox, state: IslandState) -> None:
        """Queue an epoch."""
        self._epochs.append((island, epoch, inbox, state))

    def commit(self, part: Part) -> None:
        """Queue a part."""
        self._parts.append(part)

    def mesh(self, order: MeshOrder) -> None:
        """Queue a solid."""
        self._meshes.append(order)

    @property
    def mesh_slots(self) -> int:
        """One solid at a time."""
        return 0 if self._meshes else 1

    def wait(self, timeout_s: float) -> list[Finished]:  # noqa: ARG002 - there is nothing to wait for
        """Do the next piece of work."""
        if self._parts:
            part = self._parts.popleft()
            try:
                return [PartDone(self._publisher.publish(part))]
            except StorageFullError as error:
                return [NoRoom(part, str(error))]
        if self._epochs:
            return [self._advanced(*self._epochs.popleft())]
        if self._meshes:
            order = self._meshes.popleft()
            started = time.monotonic()
            files, failure = make_solid(order)
            if failure is None:
                try:
                    self._publisher.store_solid(order, files)
                except StorageFullError as error:
                    return [NoRoom(order, str(error))]
            return [MeshDone(order, time.monotonic() - started, failure)]
        return []

    def close(self) -> None:
        """Forget what is queued."""
        self._epochs.clear()
        self._parts.clear()
        self._meshes.clear()
        self._journal.close()

    def _advanced(self, island: int, epoch: int, inbox: Inbox, state: IslandState) -> EpochDone:
        config = self._config.evolution
        blocks = itertools.count()
        set_aside: list[SetAside] = []

        def scores_of(block: Candidates) -> Scores:
            place = (island, epoch, next(blocks))
            self._journal.enter(place)
            if place not in self._journal.suspects:
                return self._evaluate(block, config)
            scores, verdicts = evaluate_apart(self._evaluate, block, config)
            set_aside.extend(verdicts)
            if not verdicts:
                self._journal.clear(place)
            return scores

        record = drive(advance(state, inbox, config, island, epoch), scores_of)
        return EpochDone(record, tuple(set_aside))
