"""What the farm costs: a real run on Ray with its storage, against loops that do the same work without either.

The loops are one process for each core; each takes its share of the islands through the same epochs (evaluation and
method, no migration, nothing written). They hear what the islands of the run heard, which decides how much there is to
do. The first epochs are left out on both sides: they found the libraries; and the last, in which some islands have
nothing left to do. Run and loops take turns, and the medians count: other work on the machine comes and goes.
"""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

from fractal_farm import farm
from fractal_farm.config import EvolutionConfig, RunConfig
from fractal_farm.errors import FarmError
from fractal_farm.evolution.designs import Designs
from fractal_farm.evolution.epoch import ELSEWHERE, Candidates, Scores, founding_state, state_after
from fractal_farm.evolution.hearsay import Hearsay
from fractal_farm.evolution.island import advance, drive
from fractal_farm.farm.events import Callback, EpochCompleted, Event
from fractal_farm.farm.restore import restore
from fractal_farm.farm.work import evaluate_candidates

ROUNDS = 3
FIRST, LAST, END = 1, 4, 6  # epochs: what lies between the first two is measured, the run goes on to the third
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
    """Measure the default configuration on this machine, in three or four minutes."""
    rounds = tuple(_round() for _ in range(ROUNDS))
    return Efficiency(
        rounds, median(each.farm / each.loops for each in rounds), median(each.farm / each.kernel for each in rounds)
    )


def _round() -> Round:
    config = RunConfig.from_dict({"name": "bench", "stop": {"epochs": END}, "solids": {"max": 0}})
    watch = _Watch()
    with tempfile.TemporaryDirectory(prefix="farm-bench-") as place:
        farm.submit(config, Path(place) / "run", callbacks=[watch])
        hearsay = restore(config, Path(place) / "run")[0].hearsay
        assert hearsay is not None
        heard = hearsay.until(LAST)
    (began, before), (ended, after) = watch.epochs[FIRST], watch.epochs[LAST]
    return Round((after - before) / (ended - began), *_loops(config.evolution, heard, len(os.sched_getaffinity(0))))


class _Watch(Callback):
    """When each epoch was complete, and how many candidates had been evaluated by then."""

    def __init__(self) -> None:
        self.epochs: dict[int, tuple[float, int]] = {}

    def on_event(self, event: Event) -> None:
        if isinstance(event, EpochCompleted):
            self.epochs[event.epoch] = (time.monotonic(), event.progress.evaluated)


def _loops(config: EvolutionConfig, heard: Designs, cores: int) -> tuple[float, float]:
    """Candidates a second of all loops together, and of the evaluations within them."""
    context = multiprocessing.get_context("spawn")
    start, results = context.Barrier(cores), context.Queue()
    shares = [list(range(core, config.islands, cores)) for core in range(cores)]
    processes = [context.Process(target=_loop, args=(config, heard, share, start, results)) for share in shares]
    for process in processes:
        process.start()
    found: list[tuple[float, float]] = [results.get(timeout=_PATIENCE_SECONDS) for _ in processes]
    for process in processes:
        process.join()
    if any(process.exitcode for process in processes):
        raise FarmError("a loop of the bench died; see `farm doctor`")
    looped, evaluated = zip(*found, strict=True)
    return sum(looped), sum(evaluated)


def _loop(config: EvolutionConfig, heard: Designs, islands: list[int], start: Any, results: Any) -> None:
    """Take some islands through all epochs; send scored candidates a second, of the loop and of evaluations alone."""
    scored: list[Candidates] = []

    def evaluate(candidates: Candidates) -> Scores:
        if candidates.wanted == "scores":
            scored.append(candidates)
        return evaluate_candidates(candidates, config)

    hearsay = Hearsay(heard)
    states = {island: replace(founding_state(config), elsewhere=heard[:0]) for island in islands}
    began = 0.0
    for epoch in range(LAST + 1):
        if epoch == FIRST + 1:
            start.wait(_PATIENCE_SECONDS)
            scored.clear()
            began = time.perf_counter()
        for island, state in states.items():
            news = epoch - config.migration.lag - 1
            inbox = [(ELSEWHERE, hearsay.elsewhere(island, news, news))]
            record = drive(advance(state, inbox, config, island, epoch), evaluate)
            states[island] = state_after(state, record, inbox)
    looped = time.perf_counter()
    for candidates in scored:
        evaluate_candidates(candidates, config)
    evaluated = time.perf_counter()
    count = sum(len(candidates.n_maps) for candidates in scored)
    results.put((count / (looped - began), count / (evaluated - looped)))
