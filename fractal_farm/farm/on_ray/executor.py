"""`RayExecutor`: what a run asks for, as calls of `actors`, and what has become of them (DESIGN section 4).

Actors that are lost are replaced, wardens look for workers that stand still, and a cluster that is gone is told apart
from a process that is.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Any

import ray
from ray.exceptions import (
    RayError,
    RayTaskError,
)
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError, StorageFullError
from fractal_farm.evolution.epoch import Candidates, IslandState
from fractal_farm.farm.executor import (
    ClusterLostError,
    EpochDone,
    Finished,
    Inbox,
    MeshDone,
    NoRoom,
    PartDone,
    Trouble,
    WorkLost,
)
from fractal_farm.farm.memory import return_large_arrays
from fractal_farm.farm.on_ray.actors import EVALUATE, ISLAND, LOST, MESHER, WRITER
from fractal_farm.farm.on_ray.session import Cluster
from fractal_farm.farm.on_ray.wardens import Wardens
from fractal_farm.farm.work import (
    Evaluate,
    MeshOrder,
    Part,
    evaluate_candidates,
    sample_candidates,
)

_AGAIN = "it is killed, and its work done again"
_SPILLED = "the results are the same; /tmp/ray needs room"
_MESH_WORKERS = 4
_WARM_UP_SECONDS = 600.0
_WARM_UP_TRIES = 10


class RayExecutor:
    """Spreads a run over the cluster that this process is connected to."""

    name = "ray"

    def __init__(
        self,
        config: RunConfig,
        new_publisher: Callable[[], Any],
        cluster: Cluster,
        evaluate: Evaluate = evaluate_candidates,
    ) -> None:
        return_large_arrays()
        self.workers = cluster.processors
        self._cluster = cluster
        self._evaluate = evaluate
        self._config = config.evolution
        self._batch_size = config.execution.batch_size
        self._new_publisher = new_publisher
        self._here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
        self._islands: dict[int, Any] = {}
        self._memory: dict[int, int] = {}
        self._lost: set[tuple[int, int]] = set()
        self._writer: Any = None
        self._meshers: list[Any] = []
        self._pending: dict[Any, tuple[str, Any]] = {}
        self._wardens = Wardens()
        # Kernels are compiled once and cached before many workers want them at the same time; the writer does its
        # own share meanwhile.
        with self._watched():
            self._living_writer()
            self._warm_up(sample_candidates(config.evolution))

    def start_epoch(self, island: int, epoch: int, inbox: Inbox, state: IslandState) -> None:
        """Call the island's actor; the state travels only when the actor cannot have it."""
        with self._watched():
            if island not in self._islands:
                self._islands[island] = ISLAND.remote(self._evaluate, self._config, island, self._batch_size)
            known = self._memory.get(island) == epoch - 1 and epoch > 0
            lost_before = (island, epoch) in self._lost
            call = self._islands[island].advance.remote(epoch, inbox, None if known else state, lost_before)
        self._pending[call] = ("epoch", (island, epoch))

    def commit(self, part: Part) -> None:
        """Hand a part to the writer, which works in order."""
        with self._watched():
            self._pending[self._living_writer().publish.remote(part)] = ("part", part)

    def mesh(self, order: MeshOrder) -> None:
        """Give a solid to the mesh actor with the least to do."""
        busy = [what[1] for kind, what in self._pending.values() if kind == "mesh"]
        idle = [mesher for mesher in self._meshers if mesher not in busy]
        with self._watched():
            if not idle:
                idle = [MESHER.remote()]
                self._meshers += idle
            made = idle[0].make.remote(order)
            self._pending[self._living_writer().store_solid.remote(order, made)] = ("mesh", (order, idle[0]))

    @property
    def mesh_slots(self) -> int:
        """One solid for each processor, up to a few."""
        busy = sum(kind == "mesh" for kind, _ in self._pending.values())
        return max(0, min(self.workers, _MESH_WORKERS) - busy)

    def wait(self, timeout_s: float) -> list[Finished]:
        """Whatever is ready, without regard to order."""
        with self._watched():
            if troubles := self._troubles():
                return troubles
            if not self._pending:
                time.sleep(timeout_s)
                return []
            ready, _ = ray.wait(list(self._pending), num_returns=1, timeout=timeout_s)
            if ready:
                more, _ = ray.wait(list(self._pending), num_returns=len(self._pending), timeout=0)
                ready = more
            return [self._finished(call, *self._pending.pop(call)) for call in ready]

    def close(self) -> None:
        """Kill the actors; results in flight are not wanted any more."""
        self._pending.clear()
        if self._cluster.lost_now() is None:
            self._wardens.close()
            for actor in [*self._islands.values(), *self._meshers, *([self._writer] if self._writer else [])]:
                ray.kill(actor)

    def _warm_up(self, candidates: Candidates) -> None:
        deadline = time.monotonic() + _WARM_UP_SECONDS
        for _ in range(_WARM_UP_TRIES):
            call = EVALUATE.remote(self._evaluate, candidates, self._config)
            while not ray.wait([call], timeout=1.0)[0]:
                self._check_cluster()
                self._wardens.sightings()
                if time.monotonic() > deadline:
                    raise FarmError(
                        f"{self._cluster.name()}: no worker has evaluated anything for {_WARM_UP_SECONDS:.0f} s; "
                        "see `ray status` whether it has processors that are free, and `farm doctor --ray`"
                    )
            try:
                self._result(call)
            except LOST as error:
                reason = type(error).__name__
                self._cluster.lost_now()
                self._check_cluster()
            else:
                return
        raise FarmError(
            f"{self._cluster.name()}: {_WARM_UP_TRIES} workers died of a first evaluation ({reason}); see `farm doctor`"
        )

    def _check_cluster(self) -> None:
        if (reason := self._cluster.lost()) is not None:
            raise ClusterLostError(f"{self._cluster.name()} is lost: {reason}")

    @contextlib.contextmanager
    def _watched(self) -> Iterator[None]:
        """Calls to Ray: whatever they raise when the cluster is gone says no more than that."""
        self._check_cluster()
        try:
            yield
        except (RayError, OSError, RuntimeError, ValueError):
            if self._cluster.lost_now() is not None:
                self._check_cluster()
            raise

    def _living_writer(self) -> Any:
        if self._writer is None:
            self._writer = WRITER.options(scheduling_strategy=self._here).remote(self._new_publisher)
        return self._writer

    def _finished(self, call: Any, kind: str, what: Any) -> Finished:
        try:
            result = self._result(call)
        except LOST as error:
            # When a whole cluster goes, its processes go one by one.
            if self._cluster.lost_now() is not None:
                self._check_cluster()
            self._dismiss(error, kind, what)
            return WorkLost(what[0] if kind == "mesh" else what, type(error).__name__)
        except StorageFullError as error:
            return NoRoom(what[0] if kind == "mesh" else what, str(error))
        if kind == "part":
            return PartDone(result)
        if kind == "mesh":
            seconds, failure = result
            return MeshDone(what[0], seconds, failure)
        island, epoch = what
        self._memory[island] = epoch
        self._lost.discard(what)
        return EpochDone(*result)

    def _troubles(self) -> list[Finished]:
        found: list[Finished] = []
        for sighting in self._wardens.sightings():
            found += [Trouble(f"worker {title}", "it stood still", _AGAIN) for title in sighting.killed]
            if sighting.spilled:
                found.append(Trouble("object store", "it was full, and Ray wrote objects to the disk", _SPILLED))
        return found

    def _dismiss(self, error: Exception, kind: str, what: Any) -> None:
        """Forget the actor that was lost: what comes next gets a new one. It may live on, out of reach."""
        lost = None
        if kind == "epoch":
            self._lost.add(what)
            self._memory.pop(what[0], None)
            lost = self._islands.pop(what[0], None)
        elif kind == "part" or (self._writer and getattr(error, "actor_id", None) == self._writer._actor_id.hex()):
            lost, self._writer = self._writer, None
        elif what[1] in self._meshers:
            lost = what[1]
            self._meshers.remove(lost)
        if lost is not None:
            ray.kill(lost)

    @staticmethod
    def _result(call: Any) -> Any:
        try:
            return ray.get(call)
        except LOST:
            raise
        except RayTaskError as error:
            # Ray wraps what a task raised in the text of its traceback; our own messages say more.
            if isinstance(error.cause, FarmError):
                raise error.cause from None
            raise
