"""The sample of reference points: exact counts for those references, and dimensions like those of all pairs."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fractal_farm.bench.truth import classic
from fractal_farm.fitness import capacity_dimension, correlation_dimension, evaluate, pair_counts
from fractal_farm.fitness.correlation import correlation_slope, new_slope_workspace
from fractal_farm.fitness.dimensions import ALL_PAIRS
from fractal_farm.fitness.pair_counting import new_pair_workspace
from fractal_farm.fitness.reference_pairs import REFERENCES, count_reference_pairs, new_reference_workspace
from tests.fitness.test_evaluation import random_genomes
from tests.fitness.test_pair_counting import cloud, in_morton_order


def counted(points):
    """Pairs of the references with all of (n, 3) float32 points in Morton order."""
    work = new_pair_workspace(len(points))
    work.points[:] = np.float32(0.5)
    work.points[:, : len(points)] = points.T
    counts = np.full(16, -1, np.int64)
    count_reference_pairs(work, len(points), new_reference_workspace(), counts)
    return counts


@pytest.mark.parametrize("n", [REFERENCES + 1, 20_001, 30_011, 40_960])
def test_counts_are_those_of_a_tree_search_from_the_same_references(n):
    # Squared distances are multiples of 2^-20, exact in float32 and in scipy's float64.
    points = in_morton_order(cloud("fine lattice", n, np.random.default_rng(n)))
    counts = counted(points)
    assert counts.sum() == REFERENCES * (n - 1)
    references = points[np.arange(REFERENCES) * n // REFERENCES].astype(np.float64)
    edges = np.sqrt(2.0 ** np.arange(-20, -5) - 2.0**-21)  # d^2 < 2^k is d^2 <= 2^k - 2^-20
    closer = cKDTree(references).count_neighbors(cKDTree(points.astype(np.float64)), edges) - REFERENCES
    assert np.cumsum(counts)[:15].tolist() == closer.tolist()


@pytest.mark.parametrize("kind", ["line", "clusters", "identical", "corners"])
def test_every_pair_of_a_degenerate_cloud_is_counted(kind):
    n = 25_000
    counts = counted(in_morton_order(cloud(kind, n, np.random.default_rng(1))))
    assert counts.sum() == REFERENCES * (n - 1)
    assert counts.min() >= 0
    if kind == "identical":
        assert counts[0] == REFERENCES * (n - 1)


@pytest.mark.parametrize("fractal", classic()[::2], ids=lambda fractal: fractal.name)
def test_the_sample_gives_the_dimension_that_all_pairs_give(fractal):
    n = ALL_PAIRS + 1
    points = fractal.points(3, n)
    all_pairs = correlation_slope(pair_counts(points), new_slope_workspace())[0]
    assert pair_counts(points).sum() == n * (n - 1) // 2
    assert correlation_dimension(points) == pytest.approx(all_pairs, abs=0.01)


@pytest.mark.parametrize("fractal", classic()[:2], ids=lambda fractal: fractal.name)
def test_large_clouds_come_closer_to_the_truth(fractal):
    points = fractal.points(4, 100_000)
    assert correlation_dimension(points) == pytest.approx(fractal.d2, abs=0.01)
    assert capacity_dimension(points) == pytest.approx(fractal.d0, abs=0.08)


def test_scores_of_200_000_points_are_near_those_of_5000():  # which are biased from dimension 2 on
    genomes = random_genomes(6, seed=4)
    small, large = evaluate(genomes, repeats=5), evaluate(genomes, 200_000)
    assert np.all(np.abs(small.d2 - large.d2) < 0.15)
    assert np.all(np.abs(small.fitness - large.fitness) < 0.1)
