import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import stats

from fractal_farm.fitness.box_counts import chao1, count_boxes
from fractal_farm.fitness.line_fit import fit_slope
from fractal_farm.fitness.morton import new_morton_workspace, sort_by_key
from fractal_farm.ifs.random_iteration import attractor_points
from tests.table1 import TABLE1


def sorted_keys(points, cube=1.0):
    """(keys, order) of (n, 3) float32 points in the unit cube."""
    work = new_morton_workspace(len(points))
    sort_by_key(np.ascontiguousarray(points.T), len(points), np.float32(cube), work)
    return work.keys >> np.uint64(32), (work.keys & np.uint64(0xFFFFFFFF)).astype(np.int64), work.keys


def digits(points, cube):
    scale = np.float32(1024) / np.float32(cube)
    return np.minimum((points * scale).astype(np.int64), 1023)


def interleaved(x, y, z):
    return sum(((int(v) >> b) & 1) << (3 * b + axis) for b in range(10) for axis, v in enumerate((x, y, z)))


def boxes_by_unique(points, cube):
    """(3, 11) occupied, single and double boxes by np.unique."""
    table = np.zeros((3, 11), np.int64)
    for level in range(11):
        _, counts = np.unique(digits(points, cube) >> (10 - level), axis=0, return_counts=True)
        table[:, level] = len(counts), np.sum(counts == 1), np.sum(counts == 2)
    return table


def boxes_by_sorting(points, cube):
    table = np.empty((3, 12), np.int64)
    count_boxes(sorted_keys(points, cube)[2], len(points), np.empty(len(points) + 1, np.int64), table)
    return table[:, :11]


def unit_cloud(name):
    points = attractor_points(TABLE1[name], 5000)
    points -= points.min(axis=0)
    return (points / points.max()).astype(np.float32)


clouds = hnp.arrays(
    np.float32,
    st.tuples(st.integers(1, 120), st.just(3)),
    elements=st.floats(0, 1, width=32) | st.sampled_from([0.0, 1.0, 0.5, 0.25, 1 - 2.0**-24]),
)


@given(clouds, st.sampled_from([1.0, 2.0**0.5]))
def test_box_counts_of_any_cloud_are_those_of_unique(points, cube):
    assert boxes_by_sorting(points, cube).tolist() == boxes_by_unique(points, cube).tolist()


@pytest.mark.parametrize("name", TABLE1)
def test_box_counts_of_a_fitness_cloud_are_those_of_unique(name):
    points = unit_cloud(name)
    for cube in (1.0, 2.0**0.5):
        assert boxes_by_sorting(points, cube).tolist() == boxes_by_unique(points, cube).tolist()


@given(clouds)
def test_keys_interleave_the_bits_of_the_coordinates_and_equal_keys_keep_their_order(points):
    keys, order, _ = sorted_keys(points)
    expected = [interleaved(*row) for row in digits(points, 1.0)]
    assert order.tolist() == sorted(range(len(points)), key=lambda i: (expected[i], i))
    assert keys.tolist() == sorted(expected)


def test_chao_adds_nothing_where_no_box_was_hit_once_and_follows_its_formula_elsewhere():
    assert chao1(10, 0, 3) == 10
    assert chao1(10, 1, 0) == 10
    assert chao1(100, 30, 14) == pytest.approx(100 + 30 * 29 / (2 * 15))


def test_chao_finds_the_boxes_that_uniform_sampling_has_missed():
    generator = np.random.default_rng(8)
    estimates, seen = [], []
    for _ in range(200):
        counts = np.bincount(generator.integers(0, 1000, 1500), minlength=1000)
        seen.append(np.sum(counts > 0))
        estimates.append(chao1(np.sum(counts > 0), np.sum(counts == 1), np.sum(counts == 2)))
    assert np.mean(seen) < 790
    assert np.mean(estimates) == pytest.approx(1000, rel=0.01)


@given(st.integers(3, 15), st.integers(0, 2**32 - 1), st.booleans())
def test_the_line_and_its_standard_error_are_those_of_least_squares(n, seed, weighted):
    generator = np.random.default_rng(seed)
    x, y = generator.normal(size=(2, n))
    weights = generator.uniform(0.1, 3, n) if weighted else np.ones(n)
    padded_x, padded_y, padded_weights = np.full((3, 20), 1e9)
    padded_x[:n], padded_y[:n], padded_weights[:n] = x, y, weights
    slope, error = fit_slope(padded_x, padded_y, padded_weights, n)
    if weighted:
        line, covariance = np.polyfit(x, y, 1, w=np.sqrt(weights), cov=True)
        expected, deviation = line[0], np.sqrt(covariance[0, 0])
    else:
        truth = stats.linregress(x, y)
        expected, deviation = truth.slope, truth.stderr
    assert slope == pytest.approx(expected, rel=1e-8, abs=1e-11)
    assert error == pytest.approx(deviation, rel=1e-6, abs=1e-11)


def test_a_line_through_too_few_points_has_slope_zero_or_no_error():
    x, y, weights = np.array([1.0, 2.0, 2.0]), np.array([5.0, 7.0, 9.0]), np.ones(3)
    for n in (0, 1):
        assert fit_slope(x, y, weights, n)[0] == 0.0
    assert fit_slope(x, y, weights, 2)[0] == 2.0
    assert np.isnan(fit_slope(x, y, weights, 2)[1])
    assert fit_slope(x[1:], y[1:], weights, 2)[0] == 0.0
