"""Whole evaluations: time for a genome, for clouds of other sizes, and on several threads."""

from __future__ import annotations

import math
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from fractal_farm.bench.genomes import random_genomes
from fractal_farm.bench.stopwatch import shortest
from fractal_farm.fitness import FitnessFormula, evaluate_batch
from fractal_farm.fitness.evaluation import POINTS
from fractal_farm.ifs.genome import Phenotype

SIZES = (1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 200_000)
_POINTS_A_BATCH = 1_000_000
_MILLI = 1e3


@dataclass(frozen=True)
class Scaling:
    """Genomes a second on several threads.

    Attributes:
        threads: how many.
        a_second: genomes a second, all threads together, by the clock on the wall.
        speedup: over one thread.
    """

    threads: int
    a_second: float
    speedup: float


def milliseconds(n_points: int = POINTS, genomes: int = 200, described: bool = False) -> float:
    """Processor time for one random genome in a batch, in milliseconds; the descriptor takes some more."""
    genes, n_maps = random_genomes(genomes, seed=2)
    described_from = 0.0 if described else math.inf

    def batch() -> None:
        evaluate_batch(genes, n_maps, Phenotype(), n_points, FitnessFormula(), described_from=described_from)

    return shortest(batch, 0.5) / genomes * _MILLI


def by_size() -> dict[int, float]:
    """Milliseconds for a genome, by the number of points."""
    return {size: milliseconds(size, max(4, _POINTS_A_BATCH // size)) for size in SIZES}


def by_threads(most: int, rounds: int = 5, genomes: int = 400) -> list[Scaling]:
    """Evaluations side by side in 1 to `most` threads, in turns, the best of several rounds of each."""
    genes, n_maps = random_genomes(genomes, seed=3)

    def batch(_: int) -> None:
        evaluate_batch(genes, n_maps, Phenotype(), POINTS, FitnessFormula(), described_from=math.inf)

    batch(0)
    counts = sorted({1, *(2**k for k in range(1, most.bit_length()) if 2**k <= most), most})
    best = dict.fromkeys(counts, 0.0)
    for _ in range(rounds):
        for threads in counts:
            with ThreadPoolExecutor(threads) as pool:
                start = time.perf_counter()
                list(pool.map(batch, range(2 * threads)))
                best[threads] = max(best[threads], 2 * threads * genomes / (time.perf_counter() - start))
    return [Scaling(threads, best[threads], best[threads] / best[1]) for threads in counts]
