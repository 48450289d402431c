"""The same work done by other libraries, timed in the same run on the same clouds.

scipy's tree and distances count the same pairs at the same fifteen radii; the tree is built beforehand, as our points
are sorted beforehand, and its counts are checked against ours. nolds counts at 55 radii, with all distances in memory;
it is timed once against our pair counts and once against all that we do from raw points to D2. For box counts, numpy
finds the occupied boxes of ten levels.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from fractal_farm.bench.genomes import random_genomes
from fractal_farm.bench.stages import SEED, sorted_cloud
from fractal_farm.bench.stopwatch import shortest
from fractal_farm.errors import FarmError
from fractal_farm.fitness import correlation_dimension
from fractal_farm.fitness.box_counts import count_boxes
from fractal_farm.fitness.correlation import N_RADII
from fractal_farm.fitness.dimensions import CloudWorkspace
from fractal_farm.fitness.evaluation import POINTS
from fractal_farm.fitness.morton import LEVELS, sort_by_key
from fractal_farm.fitness.pair_counting import count_pairs
from fractal_farm.ifs.random_iteration import attractor_points

MISSING = "nolds is not installed: pip install -c constraints.txt '.[bench]'"
_ROUNDING = 1e-4  # share of the pairs that float32 may put on the other side of a radius
_MILLI = 1e3


@dataclass(frozen=True)
class Peer:
    """Another library at the same work; medians over clouds.

    Attributes:
        work: what is done.
        peer: by whom.
        milliseconds: for one cloud.
        ours: milliseconds that this package takes for the same.
        ratio: median of the quotients.
    """

    work: str
    peer: str
    milliseconds: float
    ours: float
    ratio: float


def compare(clouds: int = 16) -> Iterator[Peer]:
    """Time all peers that are installed, one after the other, on clouds of random genomes."""
    genes, n_maps = random_genomes(clouds, SEED)
    points = [attractor_points(table[:n], POINTS) for table, n in zip(genes, n_maps, strict=True)]
    ordered = [sorted_cloud(np.ascontiguousarray(cloud.T)) for cloud in points]
    cubes = [np.ascontiguousarray(work.pairs.points[:, :POINTS].T, dtype=np.float64) for work in ordered]
    pairs = [shortest(lambda work=work: _count(work)) for work in ordered]  # type: ignore[misc]
    boxes = [shortest(lambda work=work: _boxes(work)) for work in ordered]  # type: ignore[misc]
    trees = [_Tree(cube, work.counts) for cube, work in zip(cubes, ordered, strict=True)]
    yield _peer("pair counts", "scipy cKDTree.count_neighbors", trees, pairs)
    yield _peer("pair counts", "scipy pdist and numpy histogram", [_Distances(cube) for cube in cubes], pairs)
    if has_nolds():
        theirs = [_Nolds(cube) for cube in cubes[:2]]
        whole = [shortest(lambda cube=cube: correlation_dimension(cube)) for cube in cubes[:2]]  # type: ignore[misc]
        yield _peer("pair counts", "nolds corr_dim", theirs, pairs[:2])
        yield _peer("points to D0 and D2", "nolds corr_dim", theirs, whole)
    yield _peer("box counts", "numpy unique of packed keys", [_PackedBoxes(cube) for cube in cubes], boxes)
    yield _peer("box counts", "numpy unique of rows", [_RowBoxes(cube) for cube in cubes], boxes)


def has_nolds() -> bool:
    """Whether the `bench` extra is installed."""
    try:
        importlib.import_module("nolds")
    except ImportError:
        return False
    return True


def _peer(work: str, name: str, theirs: list[Any], ours: list[float]) -> Peer:
    times = [shortest(function, 0.1, 1) for function in theirs]
    ratios = [a / b for a, b in zip(times, ours, strict=True)]
    return Peer(work, name, _median(times) * _MILLI, _median(ours) * _MILLI, _median(ratios))


def _median(values: list[float]) -> float:
    return float(np.median(values))


def _count(work: CloudWorkspace) -> None:
    count_pairs(work.pairs, POINTS, True, work.counts)


def _boxes(work: CloudWorkspace) -> None:
    sort_by_key(work.coordinates, POINTS, np.float32(1.0), work.boxes.morton)
    count_boxes(work.boxes.morton.keys, POINTS, work.boxes.parting, work.boxes.boxes)


_RADII = 2.0 ** (-10.0 + 0.5 * np.arange(N_RADII))


class _Tree:
    """Pairs within each radius by a search of two trees; checks that they are ours."""

    def __init__(self, cube: np.ndarray, counts: np.ndarray) -> None:
        self._tree = cKDTree(cube)
        difference = np.abs((self() - POINTS) // 2 - np.cumsum(counts)[:N_RADII]).max()
        if difference > _ROUNDING * counts.sum():
            raise FarmError(f"scipy counts {difference} pairs more or less than we; report this as a defect")

    def __call__(self) -> np.ndarray:
        return np.asarray(self._tree.count_neighbors(self._tree, _RADII))


class _Distances:
    def __init__(self, cube: np.ndarray) -> None:
        self._cube = cube
        self._edges = np.array([0.0, *_RADII, np.inf])

    def __call__(self) -> np.ndarray:
        return np.histogram(pdist(self._cube), self._edges)[0]


class _Nolds:
    def __init__(self, cube: np.ndarray) -> None:
        self._cube = cube
        self._corr_dim: Callable[..., float] = importlib.import_module("nolds").corr_dim

    def __call__(self) -> float:
        def distances(rows: np.ndarray, row: np.ndarray) -> np.ndarray:
            offsets = rows[:, 0] - row[0]
            return np.asarray(np.sqrt(np.einsum("ij,ij->i", offsets, offsets)))

        return self._corr_dim(self._cube, 1, dist=distances, fit="poly")


class _PackedBoxes:
    """Occupied boxes of each level, by numpy's sort of one integer a point."""

    def __init__(self, cube: np.ndarray) -> None:
        self._cube = cube

    def __call__(self) -> list[int]:
        counts = []
        for level in range(1, LEVELS + 1):
            i, j, k = np.minimum((self._cube * 2**level).astype(np.int64), 2**level - 1).T
            counts.append(len(np.unique((i << 2 * level) | (j << level) | k)))
        return counts


class _RowBoxes:
    """The same as most people write it."""

    def __init__(self, cube: np.ndarray) -> None:
        self._cube = cube

    def __call__(self) -> list[int]:
        return [len(np.unique((self._cube * 2**level).astype(np.int64), axis=0)) for level in range(1, LEVELS + 1)]
