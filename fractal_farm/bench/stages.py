"""The stages of one evaluation, each timed alone and held against its limit.

A floor counts only what the stage cannot do without: the bytes that it moves, at the speed of a plain copy within the
cache; the latency of a chain that cannot be cut; the vector instructions of the pairs within the largest radius, each
looked at once. It is not what the stage spends its time on (sorting scatters, the axes are sums in fixed order, the
descriptor takes roots), but below it no code on this machine could come.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fractal_farm.bench.ceilings import Ceilings
from fractal_farm.bench.genomes import random_genomes
from fractal_farm.bench.stopwatch import shortest
from fractal_farm.fitness.capacity import box_dimension
from fractal_farm.fitness.cloud_frame import fit_frame
from fractal_farm.fitness.correlation import correlation_slope
from fractal_farm.fitness.descriptor import describe, new_descriptor_workspace
from fractal_farm.fitness.dimensions import CloudWorkspace, new_cloud_workspace
from fractal_farm.fitness.evaluation import POINTS
from fractal_farm.fitness.lyapunov import similarity_exponent
from fractal_farm.fitness.morton import gather, sort_by_key
from fractal_farm.fitness.pair_counting import count_pairs
from fractal_farm.fitness.simd import instruction_set
from fractal_farm.ifs.genome import Phenotype
from fractal_farm.ifs.random_iteration import iterate, stream_keys, stream_number
from fractal_farm.ifs.system import build_system, new_system, reading_of

SEED = 1  # of the genomes
_BUDGET = 0.02  # seconds for each stage of each genome
_MICRO = 1e6

# Vector instructions for sixteen pairs. AVX-512: 3 subtractions, 1 product, 2 fused ones, shift, maximum, rotation, 2
# for the adder, 1.5 for the counters. Half as wide: twice that, and for each half 3 more for the adder's carry, which
# is one instruction there, and 1 for the rotation. Four start in a cycle, as on Zen 5; fewer do on other processors,
# whose ratios come out larger.
_INSTRUCTIONS = {"AVX-512": 12.5, "AVX2": 33.0}
_INSTRUCTIONS_A_CYCLE = 4.0

# Bytes read and written for each point.
_FRAME_BYTES = 24 + 48 + 24 + 36  # moments, turn, limits, float32 coordinates
_SORT_BYTES = 20 + 8 + 3 * 16  # keys, histogram, three passes
_BOX_BYTES = 2 * (_SORT_BYTES + 24)  # twice: sort, levels of parting, histogram
_GATHER_BYTES = 3 * 8 + 24
_DESCRIPTOR_BYTES = 2 * (24 + 4 + 4)


@dataclass(frozen=True)
class Stage:
    """One stage, as the median over genomes.

    Attributes:
        name: what it does.
        microseconds: for one genome.
        floor: microseconds that it takes at least on this machine, nan if that is not counted.
        counted: what the floor counts.
    """

    name: str
    microseconds: float
    floor: float
    counted: str

    @property
    def ratio(self) -> float:
        """Time over floor."""
        return self.microseconds / self.floor


def measure_stages(ceilings: Ceilings, count: int = 16) -> list[Stage]:
    """Time every stage on `count` random genomes of 5,000 points."""
    genes, n_maps = random_genomes(count, SEED)
    tables = [_stage_times(genes[b], int(n_maps[b])) for b in range(count)]
    medians = {name: float(np.median([table[0][name] for table in tables])) * _MICRO for name in tables[0][0]}
    near = float(np.median([table[1] for table in tables]))
    pairs = POINTS * (POINTS - 1) / 2
    instructions = _INSTRUCTIONS.get(instruction_set(), np.nan) / 16.0
    seconds_a_pair = instructions / _INSTRUCTIONS_A_CYCLE / ceilings.clock
    seconds_a_byte = POINTS / ceilings.bandwidth
    floors = {
        "maps and probabilities": (np.nan, "-"),
        "random iteration": (POINTS * ceilings.recurrence, "the recurrence alone"),
        "principal axes": (_FRAME_BYTES * seconds_a_byte, "bytes moved"),
        "box counts, two grids": (_BOX_BYTES * seconds_a_byte, "bytes moved"),
        "points in Morton order": (_GATHER_BYTES * seconds_a_byte, "bytes moved"),
        "pair counts": (near * seconds_a_pair, "instructions of the near pairs"),
        "line fit, exponent": (np.nan, "-"),
        "descriptor": (_DESCRIPTOR_BYTES * seconds_a_byte, "bytes moved"),
        "pair counts by brute force": (pairs * seconds_a_pair, "instructions of all pairs"),
    }
    return [Stage(name, medians[name], floor * _MICRO, counted) for name, (floor, counted) in floors.items()]


def _stage_times(genes: np.ndarray, n_maps: int) -> tuple[dict[str, float], int]:
    """Seconds of every stage of one genome, and its number of pairs within the largest radius."""
    reading, none = reading_of(Phenotype()), np.array([-1.0])
    system, cloud = new_system(), np.empty((3, POINTS))
    work = new_cloud_workspace(POINTS)
    descriptor, target = new_descriptor_workspace(POINTS), np.zeros(14, np.float32)
    build_system(genes, n_maps, reading, none, system)
    first, second = stream_keys(system.keys, stream_number("fitness"))

    def walk() -> None:
        iterate(system.maps, system.thresholds, n_maps, system.start, first, second, cloud)

    walk()
    orbit = cloud.copy()
    times = {
        "maps and probabilities": _time(lambda: build_system(genes, n_maps, reading, none, system)),
        "random iteration": _time(walk),
        "principal axes": _time(lambda: fit_frame(cloud, work.frame, work.coordinates)),
    }
    fit_frame(orbit, work.frame, work.coordinates)
    times["box counts, two grids"] = _time(lambda: box_dimension(work.coordinates, POINTS, work.boxes))
    times["points in Morton order"] = _time(lambda: _order(work))
    times["pair counts"] = _time(lambda: count_pairs(work.pairs, POINTS, True, work.counts))
    times["line fit, exponent"] = _time(
        lambda: (correlation_slope(work.counts, work.slope), similarity_exponent(system, n_maps))
    )
    times["descriptor"] = _time(lambda: describe(work.pairs.points, POINTS, work.frame.variances, descriptor, target))
    times["pair counts by brute force"] = _time(lambda: count_pairs(work.pairs, POINTS, False, work.counts))
    return times, int(work.counts[:-1].sum())


def sorted_cloud(cloud: np.ndarray) -> CloudWorkspace:
    """The workspace of a (3, n) float64 cloud, its points in the unit cube and in Morton order in `pairs.points`."""
    n = cloud.shape[1]
    work = new_cloud_workspace(n)
    fit_frame(cloud, work.frame, work.coordinates)
    sort_by_key(work.coordinates, n, np.float32(1.0), work.boxes.morton)
    _order(work)
    return work


def _order(work: CloudWorkspace) -> None:
    n = work.coordinates.shape[1]
    gather(work.coordinates, work.boxes.morton.keys, n, work.pairs.points)


def _time(function: Callable[[], object]) -> float:
    return shortest(function, _BUDGET)
