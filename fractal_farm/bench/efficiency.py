"""What the farm costs: a real run on Ray with its storage, against loops that do the same work without either.

A run is grown first, since a night is not spent with founding libraries. Then run and loops go on from the same state,
in turn; the medians count, because other work on a machine comes and goes. The loops are one process for each core;
each takes its share of the islands through the same epochs, with the migrants and the news that they had in the run:
what they do is the same to the bit, without Ray and without writing anything.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

from fractal_farm import farm
from fractal_farm.catalogue import committed_records
from fractal_farm.config import EvolutionConfig, RunConfig
from fractal_farm.errors import FarmError
from fractal_farm.evolution.designs import Designs
from fractal_farm.evolution.epoch import (
    ELSEWHERE,
    Candidates,
    IslandState,
    Scores,
    founding_state,
    library_after,
    state_after,
)
from fractal_farm.evolution.island import advance, drive
from fractal_farm.farm.events import Callback, EpochCompleted, Event
from fractal_farm.farm.executor import Inbox
from fractal_farm.farm.records import unpack_ledger
from fractal_farm.farm.restore import restore
from fractal_farm.farm.work import evaluate_candidates

ROUNDS = 3
GROWN = 12  # epochs before anything is measured
SPAN = 3  # epochs that are measured, after one that warms up
_REST = 2  # epochs more that the run is given, so that no island is idle while it is measured
_PATIENCE_SECONDS = 600.0


@dataclass(frozen=True)
class Round:
    """Candidates evaluated in a second, on all cores together.

    Attributes:
        farm: by a run on Ray, committed to disk.
        loops: by one serial loop for each core.
        kernel: by the compiled evaluation alone, of the same candidates.
    """

    farm: float
    loops: float
    kernel: float


@dataclass(frozen=True)
class Efficiency:
    """What a run reaches, in rounds one after the other.

    Attributes:
        rounds: all that was measured.
        of_loops: median of farm over loops.
        of_kernel: median of farm over kernel.
    """

    rounds: tuple[Round, ...]
    of_loops: float
    of_kernel: float


def measure_efficiency() -> Efficiency:
    """Measure the default configuration on this machine, in about four minutes."""
    with tempfile.TemporaryDirectory(prefix="farm-bench-") as place:
        grown = Path(place) / "grown"
        config = RunConfig.from_dict({"name": "bench", "stop": {"epochs": GROWN}, "solids": {"max": 0}})
        farm.submit(config, grown)
        rounds = tuple(_round(config, grown, Path(place) / f"round{number}") for number in range(ROUNDS))
    return Efficiency(
        rounds, median(each.farm / each.loops for each in rounds), median(each.farm / each.kernel for each in rounds)
    )


def _round(config: RunConfig, grown: Path, root: Path) -> Round:
    shutil.copytree(grown, root)
    watch = _Watch()
    farm.resume(root, overrides=[f"stop.epochs={GROWN + 1 + SPAN + _REST}"], callbacks=[watch])
    (began, before), (ended, after) = watch.epochs[GROWN], watch.epochs[GROWN + SPAN]
    count, loops, kernel = _loops(config.evolution, *_tasks(config, grown, root))
    if count != after - before:
        raise FarmError(f"the loops evaluated {count} candidates and the run {after - before}; they compare no more")
    return Round(count / (ended - began), loops, kernel)


def _tasks(config: RunConfig, grown: Path, root: Path) -> tuple[dict[int, IslandState], dict[tuple[int, int], Inbox]]:
    """The state of every island before the first epoch of a round, and what arrived in each (island, epoch) of it."""
    begun, heard = restore(config, grown)[0], restore(config, root)[0].hearsay
    assert heard is not None
    states = dict.fromkeys(begun.state, founding_state(config.evolution))
    dtype = states[0].library.dtype
    sent: dict[tuple[int, int], Designs] = {}
    for _, blob in committed_records(root, config.run_id, after=-1):
        for record in unpack_ledger(blob, dtype).records:
            state = IslandState(record.epoch, library_after(states[record.island].library, record))
            states[record.island] = state
            sent[record.island, record.epoch] = state.library[record.emigrants]
    inboxes: dict[tuple[int, int], Inbox] = {}
    for epoch in range(GROWN, GROWN + 1 + SPAN):
        left, told = epoch - begun.lag, epoch - begun.lag - 1
        for island, sources in enumerate(begun.sources):
            news = heard.elsewhere(island, told, told)
            inboxes[island, epoch] = [*((source, sent[source, left]) for source in sources), (ELSEWHERE, news)]
    told = GROWN - begun.lag - 2
    return {
        island: replace(state, elsewhere=heard.elsewhere(island, -1, told)) for island, state in begun.state.items()
    }, inboxes


class _Watch(Callback):
    """When each epoch was complete, and how many candidates had been evaluated by then."""

    def __init__(self) -> None:
        self.epochs: dict[int, tuple[float, int]] = {}

    def on_event(self, event: Event) -> None:
        if isinstance(event, EpochCompleted):
            self.epochs[event.epoch] = (time.monotonic(), event.progress.evaluated)


def _loops(
    config: EvolutionConfig, states: dict[int, IslandState], inboxes: dict[tuple[int, int], Inbox]
) -> tuple[int, float, float]:
    """Candidates of all loops, how many of them in a second, and in a second of the evaluations within them."""
    cores = len(os.sched_getaffinity(0))
    context = multiprocessing.get_context("spawn")
    start, results = context.Barrier(cores), context.Queue()
    shares = [{island: states[island] for island in range(core, config.islands, cores)} for core in range(cores)]
    processes = [context.Process(target=_loop, args=(config, share, inboxes, start, results)) for share in shares]
    for process in processes:
        process.start()
    found: list[tuple[int, float, float]] = [results.get(timeout=_PATIENCE_SECONDS) for _ in processes]
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        raise FarmError("a loop of the bench died; see `farm doctor`")
    counts, looped, evaluated = zip(*found, strict=True)
    return sum(counts), sum(looped), sum(evaluated)


def _loop(
    config: EvolutionConfig,
    states: dict[int, IslandState],
    inboxes: dict[tuple[int, int], Inbox],
    start: Any,
    results: Any,
) -> None:
    """Take some islands through all epochs; send candidates scored, in all, a second, and by evaluations a second."""
    scored: list[Candidates] = []

    def evaluate(candidates: Candidates) -> Scores:
        if candidates.wanted == "scores":
            scored.append(candidates)
        return evaluate_candidates(candidates, config)

    began = 0.0
    for epoch in range(GROWN, GROWN + 1 + SPAN):
        if epoch == GROWN + 1:
            start.wait(_PATIENCE_SECONDS)
            scored.clear()
            began = time.perf_counter()
        for island, state in states.items():
            inbox = inboxes[island, epoch]
            record = drive(advance(state, inbox, config, island, epoch), evaluate)
            states[island] = state_after(state, record, inbox)
    looped = time.perf_counter()
    for candidates in scored:
        evaluate_candidates(candidates, config)
    evaluated = time.perf_counter()
    count = sum(len(candidates.n_maps) for candidates in scored)
    results.put((count, count / (looped - began), count / (evaluated - looped)))
