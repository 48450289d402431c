"""The pieces of Ray that do the work: evaluations as tasks; islands, a writer and mesh workers as actors.

Actors hold state only as a cache: every call carries its epoch, and when an actor has died a new one gets the state
from the run. None is restarted by Ray, whose restarts lose state, and wait for ever for a node that hangs. Island
actors and the writer take no processor of their own; mesh actors run at low priority, so that evaluations go first.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Sequence
from typing import Any

import ray
from ray.exceptions import NodeDiedError, ObjectLostError, OutOfMemoryError, RayActorError, WorkerCrashedError

from fractal_farm.config import EvolutionConfig
from fractal_farm.evolution.epoch import Candidates, EpochRecord, IslandState, Scores, state_after
from fractal_farm.evolution.island import advance, drive
from fractal_farm.farm.executor import Inbox
from fractal_farm.farm.memory import return_large_arrays
from fractal_farm.farm.on_ray.orphans import Nodes
from fractal_farm.farm.trials import Death, bounded, evaluate_with_care, trial
from fractal_farm.farm.work import QUICK, Evaluate, MeshOrder, Part, PartReceipt, SetAside, make_solid, split, warm_up

LOST = (RayActorError, WorkerCrashedError, OutOfMemoryError, NodeDiedError, ObjectLostError)
"""What says that a process, a node or its memory is gone, and not that the work itself is at fault."""

_MESH_NICENESS = 10


def evaluate_batch(evaluate: Evaluate, candidates: Candidates, config: EvolutionConfig) -> Scores:
    """RIA and fitness of one batch; a worker that takes far longer than it can take dies of it."""
    if config not in _warm:
        _take_long_turns()
        warm_up(evaluate, config)
        _warm.append(config)
    with bounded(len(candidates.n_maps), config):
        return evaluate(candidates, config)


_warm: list[EvolutionConfig] = []
"""Configurations whose kernels this worker has compiled, or loaded."""


class Island:
    """One island; its library is a cache of what the run knows."""

    def __init__(self, evaluate: Evaluate, config: EvolutionConfig, island: int, batch_size: int | None) -> None:
        _take_long_turns()
        return_large_arrays()
        self._evaluate = evaluate
        self._config = config
        self._island = island
        self._batch_size = batch_size
        self._state: IslandState | None = None
        self._nodes = Nodes()

    def advance(
        self, epoch: int, inbox: Inbox, state: IslandState | None, with_care: bool = False
    ) -> tuple[EpochRecord, tuple[SetAside, ...]]:
        """The record of an epoch, from the state before it, or from memory if that is None.

        With care nothing is evaluated in this process: another one died in this epoch, perhaps of a genome.
        """
        before = state if state is not None else self._state
        assert before is not None
        assert before.epoch == epoch - 1
        set_aside: list[SetAside] = []

        def scores_of(candidates: Candidates) -> Scores:
            if candidates.wanted in QUICK and not with_care:
                return self._evaluate(candidates, self._config)
            batches = split(candidates, self._batch_size)
            scores, verdicts = evaluate_with_care(batches, self._evaluate_all, self._try_alone, self._config)
            set_aside.extend(verdicts)
            return scores

        record = drive(advance(before, inbox, self._config, self._island, epoch), scores_of)
        self._state = state_after(before, record, inbox)
        return record, tuple(set_aside)

    def _evaluate_all(self, batches: Sequence[Candidates]) -> list[Scores | None]:
        calls = [EVALUATE.remote(self._evaluate, batch, self._config) for batch in batches]
        results: list[Scores | None] = []
        self._await(calls)
        for call in calls:
            try:
                results.append(ray.get(call))
            except LOST:
                results.append(None)
        return results

    def _try_alone(self, single: Candidates) -> Scores | Death:
        call = TRIAL.remote(self._evaluate, single, self._config)
        self._await([call])
        outcome: Scores | Death = ray.get(call)
        return outcome

    def _await(self, calls: list[Any]) -> None:
        """Until all are there; an orphan ends, and the run goes on with a new actor."""
        if not self._nodes.outlived(calls):
            ray.actor.exit_actor()


class Writer:
    """Makes parts durable, on the driver's node."""

    def __init__(self, new_publisher: Callable[[], Any]) -> None:
        self._publisher = new_publisher()
        self._publisher.warm()

    def publish(self, part: Part) -> PartReceipt:
        """Commit one part."""
        receipt: PartReceipt = self._publisher.publish(part)
        return receipt

    def store_solid(
        self, order: MeshOrder, made: tuple[dict[str, bytes], str | None, float]
    ) -> tuple[float, str | None]:
        """Store what a mesh actor made; its files go straight from that actor to this one."""
        files, failure, seconds = made
        if failure is None:
            self._publisher.store_solid(order, files)
        return seconds, failure


class Mesher:
    """Makes solids at low priority."""

    def __init__(self) -> None:
        os.nice(_MESH_NICENESS)

    def make(self, order: MeshOrder) -> tuple[dict[str, bytes], str | None, float]:
        """The files of one solid, or why there is none, and the seconds it took."""
        started = time.monotonic()
        files, failure = make_solid(order)
        return files, failure, time.monotonic() - started


def _take_long_turns() -> None:
    """Ask the system not to wake others in the middle of our work: a tenth less time on a full machine."""
    with contextlib.suppress(AttributeError, OSError):  # not on every system, nor in every container
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


# Remote forms; Ray's decorators hide the types of what they wrap.
EVALUATE: Any = ray.remote(num_cpus=1, max_retries=0)(evaluate_batch)
TRIAL: Any = ray.remote(num_cpus=1, max_retries=-1)(trial)
ISLAND: Any = ray.remote(num_cpus=0, max_restarts=0)(Island)
WRITER: Any = ray.remote(num_cpus=0, max_restarts=0)(Writer)
MESHER: Any = ray.remote(num_cpus=0, max_restarts=0)(Mesher)
