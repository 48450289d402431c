"""Pair counts are exact: pruned = brute force = extended precision = scipy, to the last pair."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial import cKDTree

from fractal_farm.fitness import pair_counts
from fractal_farm.fitness.morton import new_morton_workspace, sort_by_key
from fractal_farm.fitness.pair_counting import count_pairs, new_pair_workspace
from fractal_farm.ifs.random_iteration import attractor_points
from tests.table1 import TABLE1


def counted(points: np.ndarray, prune: bool, capacity: int | None = None) -> np.ndarray:
    """Counts of (n, 3) float32 points in the unit cube, as they are."""
    work = new_pair_workspace(capacity or len(points))
    work.points[:] = np.float32(0.5)  # what a larger cloud left behind
    work.points[:, : len(points)] = points.T
    counts = np.full(16, -1, np.int64)
    count_pairs(work, len(points), prune, counts)
    return counts


def in_morton_order(points: np.ndarray) -> np.ndarray:
    frame = np.ascontiguousarray(points.T)
    work = new_morton_workspace(len(points))
    sort_by_key(frame, len(points), np.float32(1), work)
    return points[(work.keys & np.uint64(0xFFFFFFFF)).astype(np.int64)]


def reference(points: np.ndarray) -> np.ndarray:
    """fma(x, x, fma(y, y, z z)) of float32 differences, each rounded once from 64-bit mantissas; then its exponent."""
    counts = np.zeros(16, np.int64)
    for i in range(len(points) - 1):
        x, y, z = (points[i + 1 :] - points[i]).T
        inner = (z * z).astype(np.longdouble) + y.astype(np.longdouble) ** 2
        squared = (inner.astype(np.float32).astype(np.longdouble) + x.astype(np.longdouble) ** 2).astype(np.float32)
        exponent = np.clip(np.frexp(squared)[1] - 1, -21, -6)  # floor(log2)
        exponent[squared == 0] = -21
        counts += np.bincount(exponent + 21, minlength=16)
    return counts


def cloud(kind: str, n: int, generator: np.random.Generator) -> np.ndarray:
    uniform = generator.random((n, 3))
    match kind:
        case "uniform":
            points = uniform
        case "corners":  # distances near all powers of two, coordinates of exactly 0 and 1
            offset = np.ldexp(1.0, -generator.integers(1, 24, (n, 3)))
            points = np.abs(generator.integers(0, 2, (n, 3)) - offset * generator.integers(0, 2, (n, 3)))
        case "lattice":  # many distances lie exactly on the edge of a bin
            points = generator.integers(0, 65, (n, 3)) / 64
        case "fine lattice":
            points = generator.integers(0, 1025, (n, 3)) / 1024
        case "line":
            points = uniform[:, :1] * np.array([1.0, 0.5, 0.25])
        case "clusters":
            points = generator.integers(0, 3, (n, 1)) / 2 + uniform * 10.0 ** -generator.integers(2, 8, (n, 1))
            points = np.clip(points, 0, 1)
        case "identical":
            points = np.full((n, 3), 0.75)
        case _:
            raise AssertionError(kind)
    return points.astype(np.float32)


KINDS = ("uniform", "corners", "lattice", "fine lattice", "line", "clusters", "identical")
SIZES = (2, 3, 4, 5, 31, 32, 33, 63, 64, 65, 66, 95, 96, 97, 127, 128, 129, 500, 1000, 1023, 1025, 2111)


@pytest.mark.parametrize("kind", KINDS)
def test_pruned_and_brute_force_counts_are_the_same_for_all_sizes_in_any_order(kind):
    generator = np.random.default_rng(3)
    for n, ordered in itertools.product(SIZES, (True, False)):
        points = cloud(kind, n, generator)
        points = in_morton_order(points) if ordered else points
        pruned = counted(points, prune=True)
        assert pruned.sum() == n * (n - 1) // 2
        assert pruned.tolist() == counted(points, prune=False).tolist()


@pytest.mark.parametrize("kind", KINDS)
def test_counts_are_those_of_extended_precision(kind):
    generator = np.random.default_rng(4)
    for n in (2, 7, 64, 130, 700):
        points = in_morton_order(cloud(kind, n, generator))
        assert counted(points, prune=True).tolist() == reference(points).tolist()


@given(
    hnp.arrays(
        np.float32,
        st.tuples(st.integers(2, 150), st.just(3)),
        elements=st.floats(0, 1, width=32, allow_subnormal=True)
        | st.sampled_from([0.0, 1.0, 0.5, 2.0**-10, 1 - 2.0**-24, 2.0**-3, 2.0**-120]),
    )
)
def test_counts_of_any_cloud_are_those_of_extended_precision(points):
    expected = reference(points).tolist()
    assert counted(points, prune=True).tolist() == expected
    assert counted(points, prune=False).tolist() == expected


def test_counts_on_a_lattice_are_those_of_a_tree_search():
    # Squared distances are multiples of 2^-20, exact in float32 and in scipy's float64.
    points = in_morton_order(cloud("fine lattice", 3000, np.random.default_rng(5)))
    tree = cKDTree(points.astype(np.float64))
    edges = np.sqrt(2.0 ** np.arange(-20, -5) - 2.0**-21)  # d^2 < 2^k is d^2 <= 2^k - 2^-20
    closer = (tree.count_neighbors(tree, edges) - len(points)) // 2
    assert np.cumsum(counted(points, prune=True))[:15].tolist() == closer.tolist()


def test_a_workspace_serves_smaller_clouds_after_larger_ones():
    points = cloud("uniform", 300, np.random.default_rng(6))
    for n in (300, 2, 65, 31, 128):
        assert counted(points[:n], True, capacity=5000).tolist() == reference(points[:n]).tolist()


@pytest.mark.parametrize("name", TABLE1)
def test_counts_of_a_fitness_cloud_hold_every_pair_once_and_ignore_the_order_of_the_points(name):
    points = attractor_points(TABLE1[name], 5000)
    counts = pair_counts(points)
    assert counts.shape == (16,)
    assert counts.dtype == np.int64
    assert counts.sum() == 5000 * 4999 // 2
    shuffled = pair_counts(np.random.default_rng(0).permutation(points))
    assert np.abs(np.cumsum(shuffled) - np.cumsum(counts)).max() <= 12  # the axes' last bits depend on the order


def test_long_lists_of_rows_do_not_overflow_the_byte_counters():
    # One bin takes all pairs: 20,000 points in a ball smaller than the smallest radius, and far from it.
    points = (0.5 + np.random.default_rng(7).random((20_000, 3)) * 2.0**-12).astype(np.float32)
    expected = [20_000 * 19_999 // 2, *[0] * 15]
    assert counted(points, prune=True).tolist() == expected
    assert counted(points, prune=False).tolist() == expected
