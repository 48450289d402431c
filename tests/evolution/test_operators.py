import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.optimize import brentq

from fractal_farm.evolution import operators
from fractal_farm.ifs.linear_algebra import largest_singular_value
from fractal_farm.random_streams import Purpose, stream


def _random(slots, seed=0, affine=False, counts=None):
    rng = stream(seed, Purpose.FOUNDERS)
    return operators.random_genes(rng, slots, 3, affine, counts or {2: 0.5, 3: 0.5})


def test_random_genomes_fill_their_ranges_evenly():
    genes, n_maps = _random(4000)
    real = np.arange(3) < n_maps[:, None]
    assert abs((n_maps == 2).mean() - 0.5) < 0.03
    assert not genes[~real].any()
    assert stats.kstest(genes[real][:, 0] / math.pi, stats.uniform(-1, 2).cdf).pvalue > 1e-3
    assert stats.kstest(genes[real][:, 3], stats.uniform(0.001, 0.998).cdf).pvalue > 1e-3
    assert stats.kstest(genes[real][:, 6], stats.uniform(-2, 4).cdf).pvalue > 1e-3


def test_random_affine_maps_contract_and_are_no_similarities():
    genes, n_maps = _random(50, affine=True, counts={3: 1.0})
    singular = np.linalg.svd(genes.reshape(50, 3, 3, 4)[..., :3], compute_uv=False)
    assert n_maps.tolist() == [3] * 50
    assert singular.max() < 1.0
    assert np.median(singular[..., 0] / singular[..., 2]) > 2.0


def test_parents_are_drawn_in_proportion_to_their_fitness():
    fitness = np.array([0.0, 0.2, 0.5, 0.3])
    counts = np.bincount(operators.proportional(fitness, np.random.default_rng(1).random(40_000)), minlength=4)
    assert counts[0] == 0
    assert stats.chisquare(counts[1:], 40_000 * fitness[1:]).pvalue > 1e-3


def test_without_any_fitness_the_draw_is_uniform():
    counts = np.bincount(operators.proportional(np.zeros(5), np.random.default_rng(1).random(10_000)))
    assert stats.chisquare(counts).pvalue > 1e-3


@given(st.integers(2, 3), st.integers(2, 3), st.floats(0, 0.999999), st.floats(0, 0.999999))
def test_crossover_exchanges_one_block_and_never_a_whole_row(first_maps, second_maps, row, column):
    first = np.full((1, 3, 7), 1.0)
    second = np.full((1, 3, 7), 2.0)
    child, crossed = operators.block_crossover(
        first, second, np.array([first_maps]), np.array([second_maps]), np.array([[0.0, row, column]]), 0.75
    )
    assert crossed.all()
    exchanged = child[0] == 2.0
    rows, columns = exchanged.any(axis=1).sum(), exchanged.any(axis=0).sum()
    assert exchanged.sum() == rows * columns
    assert exchanged[:rows, :columns].all()
    assert 1 <= rows <= min(first_maps, second_maps)
    assert 1 <= columns <= 6


def test_crossover_happens_with_its_probability_and_otherwise_copies():
    first, second = np.zeros((10_000, 3, 7)), np.ones((10_000, 3, 7))
    maps = np.full(10_000, 3)
    uniform = np.random.default_rng(3).random((10_000, 3))
    child, crossed = operators.block_crossover(first, second, maps, maps, uniform, 0.75)
    assert abs(crossed.mean() - 0.75) < 0.02
    np.testing.assert_array_equal(child.any(axis=(1, 2)), crossed)
    # Every (i, j) of 3 x 6 is equally likely.
    blocks = child[crossed].any(axis=2).sum(axis=1) * 10 + child[crossed].any(axis=1).sum(axis=1)
    assert stats.chisquare(np.unique(blocks, return_counts=True)[1]).pvalue > 1e-3
    assert len(np.unique(blocks)) == 18


def _mutated(genes, n_maps, probability=0.5, sigma=1.0, affine=False, seed=5):
    rng = np.random.default_rng(seed)
    return operators.gaussian_mutation(
        genes, n_maps, rng.random(genes.shape), rng.standard_normal(genes.shape), probability, sigma, affine
    )


def test_mutation_moves_each_allele_with_its_probability_and_keeps_the_bits_of_the_others():
    genes, n_maps = _random(3000)
    mutant, moved = _mutated(genes, n_maps)
    real = (np.arange(3) < n_maps[:, None])[:, :, None] & np.ones(7, bool)
    assert abs((mutant != genes)[real].mean() - 0.5) < 0.01
    assert not mutant[~real].any()
    assert moved.all()
    moves = (mutant - genes)[..., 4:][(mutant != genes)[..., 4:]]
    assert stats.kstest(moves, "norm").pvalue > 1e-3


def test_repair_keeps_angles_and_ratios_in_range_and_is_the_mirror_image_beyond_it():
    genes, n_maps = _random(3000)
    mutant, _ = _mutated(genes, n_maps, sigma=3.0)
    real = np.arange(3) < n_maps[:, None]
    assert np.abs(mutant[..., :3]).max() <= math.pi
    assert mutant[real][:, 3].min() >= 0.001
    assert mutant[real][:, 3].max() <= 0.999
    one = np.zeros((1, 3, 7))
    one[0, :2, 3] = 0.9, 0.1
    one[0, 0, 0] = 3.0
    shift = np.zeros_like(one)
    shift[0, 0, 3], shift[0, 1, 3], shift[0, 0, 0] = 0.2, -0.3, 1.0
    child, _ = operators.gaussian_mutation(one, np.array([2]), np.zeros_like(one), shift, 0.5, 1.0, False)
    assert child[0, 0, 3] == pytest.approx(0.999 - (1.1 - 0.999))
    assert child[0, 1, 3] == pytest.approx(0.001 + (0.001 + 0.2))
    assert child[0, 0, 0] == pytest.approx(4.0 - 2 * math.pi)


def test_mutated_affine_maps_still_contract():
    genes, n_maps = _random(100, affine=True)
    mutant, _ = _mutated(genes, n_maps, affine=True)
    norms = [
        largest_singular_value(*row.reshape(3, 4)[:, :3].ravel())
        for genome, count in zip(mutant, n_maps, strict=True)
        for row in genome[:count]
    ]
    assert max(norms) < 1.0
    assert min(norms) > 0.0


def test_the_range_of_similarity_dimensions_agrees_with_morans_equation():
    genes, n_maps = _random(500)
    inside = operators.similarity_dimension_within(genes, n_maps, (1.0, 3.0))
    for genome, count, found in zip(genes, n_maps, inside, strict=True):
        rho = genome[:count, 3]
        dimension = brentq(lambda s, rho=rho: (rho**s).sum() - 1, 0, 5000)
        assert found == (1.0 <= dimension <= 3.0)


def test_a_sequence_is_exchanged_up_to_its_point():
    rng = np.random.default_rng(3)
    first, second = np.zeros((500, 3, 7)), np.ones((500, 3, 7))
    maps = np.full(500, 3)
    children, crossed = operators.block_crossover(first, second, maps, maps, rng.random((500, 3)), 1.0, "sequence")
    assert crossed.all()
    flat = children.reshape(500, 21)
    lengths = flat.sum(axis=1).astype(int)
    assert (flat == (np.arange(21) < lengths[:, None])).all()
    assert set(lengths) == {length for length in range(1, 21) if length % 7}


def test_mutants_are_clipped_or_left_if_that_is_asked_for():
    rng = np.random.default_rng(4)
    genes, maps = operators.random_genes(rng, 400, 3, False, {3: 1.0})
    noise = rng.random(genes.shape), 2.0 * rng.standard_normal(genes.shape), 1.0, 1.0, False
    left, _ = operators.gaussian_mutation(genes, maps, *noise, "refuse")
    assert np.array_equal(left, genes + noise[1])
    clipped, _ = operators.gaussian_mutation(genes, maps, *noise, "clip")
    assert np.array_equal(clipped[..., :3], np.clip(left[..., :3], -np.pi, np.pi))
    assert np.array_equal(clipped[..., 3], np.clip(left[..., 3], *operators.RHO_RANGE))
    assert np.array_equal(clipped[..., 4:], left[..., 4:])
