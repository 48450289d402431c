"""Workers that stand still: stopped by a signal, or caught in a call to the system that does not return.

Ray notices processes that die and machines that do not answer, but waits for ever for a process that does nothing. A
warden on every node looks at the workers of its node. Who stands still while it should work is killed, and the rest
is what follows every death: the work is done again. Time is counted in looks and in the worker's own processor time,
not by a clock, so that a slow, loaded or suspended machine is no reason to kill anybody. Wardens also tell when objects
of their node were spilled to the disk, which Ray does in silence.
"""

from __future__ import annotations

import contextlib
import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import ray
from ray.exceptions import RayError
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

LOOK_SECONDS = 5.0
LOOKS = 6
_UNANSWERED_SECONDS = 30.0
# Ray's titles of processes that work for the farm, or are about to. Only an evaluation computes all the time.
_OURS = ("evaluate_batch", "trial", "Island", "Writer", "Mesher", "IDLE")
_COMPUTES = "evaluate_batch"
_SPILLS = re.compile(r"cumulative spill requests: (\d+)")


@dataclass(frozen=True)
class Sighting:
    """What a warden has seen at one look.

    Attributes:
        killed: titles of processes that stood still and were killed.
        spilled: objects were spilled to the disk since the last look.
        nodes: ids of the cluster's living nodes.
    """

    killed: list[str]
    spilled: bool
    nodes: list[str]


class Warden:
    """Looks at the workers beside it, which have the same parent: the node's raylet."""

    def __init__(self, looks: int) -> None:
        self._looks = looks
        self._seen: dict[psutil.Process, tuple[Any, int]] = {}
        self._spills = _spills()

    def look(self) -> Sighting:
        """One look."""
        killed = []
        seen = {}
        for process in psutil.Process().parent().children():
            try:
                title = _title(process)
                sign = _standing_still(process, title)
                before, looks = self._seen.get(process, (None, 0))
                looks = looks + 1 if sign is not None and sign == before else 0
                if looks >= self._looks:
                    process.kill()
                    killed.append(title)
                seen[process] = sign, looks
            except psutil.Error:
                continue  # it has ended meanwhile
        self._seen = seen
        before, self._spills = self._spills, _spills()
        nodes = [entry["NodeID"] for entry in ray.nodes() if entry["Alive"]]
        return Sighting(killed, self._spills > before, nodes)


def _title(process: psutil.Process) -> str:
    """What a worker does, without Ray's prefix and the name of the method; "" for other processes."""
    prefix, mark, title = (process.cmdline() or [""])[0].partition("::")
    return title.partition(".")[0] if (prefix, mark) == ("ray", "::") else ""


def _standing_still(process: psutil.Process, title: str) -> Any:
    """What does not change while a worker stands still; None for one that moves, or has a right to wait."""
    if title not in _OURS:
        return None
    if process.status() == psutil.STATUS_STOPPED:
        return psutil.STATUS_STOPPED
    if title == _COMPUTES:
        return next(thread for thread in process.threads() if thread.id == process.pid)  # Ray's own threads never rest
    return None


def _spills() -> int:
    """How often this node's object store has spilled; the raylet writes it down every ten seconds."""
    node: Any = ray._private.worker._global_node
    with contextlib.suppress(OSError, AttributeError):
        state = Path(node.get_logs_dir_path()) / "debug_state.txt"
        return sum(map(int, _SPILLS.findall(state.read_text())))
    return 0


_WARDEN: Any = ray.remote(num_cpus=0, max_restarts=0)(Warden)


@dataclass
class _Post:
    """A warden, what it was asked, and when."""

    actor: Any
    answer: Any = None
    asked: float = 0.0


class Wardens:
    """One warden on every node of the cluster, asked again and again."""

    def __init__(self) -> None:
        self._here = ray.get_runtime_context().get_node_id()
        self._posts: dict[str, _Post] = {}
        self._nodes = [self._here]
        self._next = 0.0

    def sightings(self) -> list[Sighting]:
        """What they have seen since the last call; it does not wait."""
        now = time.monotonic()
        if now < self._next:
            return []
        self._next = now + LOOK_SECONDS
        found: list[Sighting] = []
        for node in self._nodes:
            post = self._posts.get(node)
            if post is None or (post.answer is not None and now - post.asked > _UNANSWERED_SECONDS):
                # One that stands still itself is replaced, and ended by Ray when its handle is gone.
                place = NodeAffinitySchedulingStrategy(node, soft=False)
                post = self._posts[node] = _Post(_WARDEN.options(scheduling_strategy=place).remote(LOOKS))
            found += self._heard(node, post)
            if node in self._posts and post.answer is None:
                post.answer, post.asked = post.actor.look.remote(), now
        return found

    def close(self) -> None:
        """Send them away."""
        for post in self._posts.values():
            ray.kill(post.actor)
        self._posts.clear()

    def _heard(self, node: str, post: _Post) -> list[Sighting]:
        if post.answer is None or not ray.wait([post.answer], timeout=0)[0]:
            return []
        try:
            sighting: Sighting = ray.get(post.answer)
        except RayError:  # it died, or its node
            del self._posts[node]
            return []
        post.answer = None
        if node == self._here:
            self._nodes = sighting.nodes
        return [sighting]
