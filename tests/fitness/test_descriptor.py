import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from fractal_farm.bench.truth import classic, separated
from fractal_farm.errors import InputError
from fractal_farm.fitness import shape_descriptor
from fractal_farm.ifs.random_iteration import attractor_points
from tests.table1 import TABLE1

SHAPES = [*classic(), *separated("natural")[::5]]


def by_all_pairs(points):
    """The descriptor from every pair, by numpy and scipy."""
    distances = np.sort(pdist(points))
    means = [part.mean() for part in np.array_split(distances, 12)]
    variances = np.maximum(np.linalg.eigvalsh(np.cov(points.T)), 0)
    ratios = np.sqrt(variances[:2] / variances[2])
    return np.array([*(means / np.sqrt(np.mean(distances**2))), *ratios])


@pytest.mark.parametrize("fractal", SHAPES, ids=lambda fractal: fractal.name)
def test_two_pairs_a_point_tell_what_all_pairs_tell(fractal):
    points = fractal.points(1)
    descriptor = shape_descriptor(points)
    assert descriptor.shape == (14,)
    assert descriptor.dtype == np.float32
    assert np.all(np.diff(descriptor[:12]) >= 0)
    assert np.linalg.norm(descriptor - by_all_pairs(points)) < 0.03


@pytest.mark.parametrize("name", TABLE1)
def test_place_orientation_handedness_size_and_order_hardly_change_it(name):
    points = attractor_points(TABLE1[name], 5000)
    descriptor = shape_descriptor(points)
    for seed in range(4):
        generator = np.random.default_rng(seed)
        moved = generator.permutation(points) @ Rotation.random(random_state=seed).as_matrix().T
        moved = moved * [(-1) ** seed, 1, 1] * 7.7 + generator.normal(size=3)
        assert np.linalg.norm(shape_descriptor(moved) - descriptor) < 0.002
    assert np.array_equal(shape_descriptor(points * 2.0**-20), descriptor)


def test_another_sample_of_one_shape_is_nearer_than_any_other_shape():
    first = [shape_descriptor(fractal.points(1)) for fractal in SHAPES]
    second = [shape_descriptor(fractal.points(2)) for fractal in SHAPES]
    distances = np.linalg.norm(np.array(first)[:, None] - np.array(second)[None], axis=2)
    assert distances.argmin(axis=1).tolist() == list(range(len(SHAPES)))
    assert np.median(np.diag(distances)) < 0.02
    others = distances[~np.eye(len(SHAPES), dtype=bool)]
    assert np.median(others) > 20 * np.median(np.diag(distances))


def test_a_ball_and_a_segment_have_the_ratios_that_geometry_gives():
    generator = np.random.default_rng(0)
    directions = generator.normal(size=(20_000, 3))
    ball = directions / np.linalg.norm(directions, axis=1, keepdims=True) * generator.random((20_000, 1)) ** (1 / 3)
    assert np.allclose(shape_descriptor(ball)[12:], 1, atol=0.03)
    segment = generator.random((20_000, 1)) * [1.0, 2.0, 3.0]
    rest = 1 - np.arange(13) / 12  # |u - v| has the quantiles 1 - sqrt(1 - q), and the mean square 1 / 6
    means = 1 + 8 * np.diff(rest**1.5)
    assert np.allclose(shape_descriptor(segment)[:12], means * np.sqrt(6), atol=0.02)
    assert np.all(shape_descriptor(segment)[12:] < 1e-6)


@pytest.mark.parametrize("n", [2, 3, 4, 7, 64, 65, 499])
def test_clouds_of_any_size_have_a_descriptor(n):
    descriptor = shape_descriptor(np.random.default_rng(n).random((n, 3)))
    assert np.all(np.isfinite(descriptor))
    assert np.all(np.diff(descriptor[:12]) >= 0)
    assert np.all((descriptor[12:] >= 0) & (descriptor[12:] <= 1))


def test_two_points_have_only_one_distance():
    assert np.allclose(shape_descriptor([[0, 0, 0], [1, 2, 3]]), [*[1] * 12, 0, 0], atol=1e-6)


def test_a_single_point_has_the_zero_descriptor():
    assert not np.any(shape_descriptor(np.full((100, 3), 4.0)))


def test_what_is_not_a_cloud_is_refused():
    with pytest.raises(InputError, match="row 1"):
        shape_descriptor([[0, 0, 0], [np.nan, 0, 0]])
