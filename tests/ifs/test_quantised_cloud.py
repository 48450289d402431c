import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.quantised_cloud import quantise, quantise_clouds, quantised_attractors
from fractal_farm.ifs.random_iteration import attractor_points
from tests.table1 import TABLE1

coordinates = st.one_of(st.floats(-10, 10), st.floats(-1e30, 1e30), st.floats(-1e-35, 1e-35), st.integers(-3, 3))
clouds = npst.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=coordinates)


def morton_key(q):
    """Bits of x, y, z interleaved, x lowest, by way of text."""
    return int("".join(z + y + x for x, y, z in zip(*(f"{int(value):016b}" for value in q), strict=True)), 2)


@given(clouds)
def test_points_are_rounded_to_the_nearest_of_65536_steps_and_sorted_along_the_morton_curve(points):
    cloud = quantise(points)
    origin, scale = cloud.origin.astype(float), float(cloud.scale)
    steps = np.floor((points - origin) / scale * 65535 + 0.5) if scale else np.zeros(points.shape)
    assert 0 <= steps.min() <= steps.max() <= 65535
    assert cloud.points.tolist() == sorted(steps.astype(int).tolist(), key=morton_key)


@given(clouds)
def test_the_box_holds_all_points_and_is_exact_in_float32(points):
    cloud = quantise(points)
    assert cloud.origin.dtype == np.float32
    assert np.asarray(cloud.scale).dtype == np.float32
    low, high = points.min(axis=0), points.max(axis=0)
    assert np.all(cloud.origin <= low)
    assert np.all(np.nextafter(cloud.origin, np.float32(np.inf)) > low)
    assert np.all(high - cloud.origin <= cloud.scale)


@given(clouds)
def test_coordinates_come_back_within_half_a_step(points):
    cloud = quantise(points)
    half_a_step = float(cloud.scale) / 65535 / 2
    back = cloud.dequantise()
    rounding = 1e-14 * np.abs(points).max()
    for axis in range(3):
        error = np.abs(np.sort(back[:, axis]) - np.sort(points[:, axis]))
        assert error.max() <= half_a_step + rounding


@given(clouds, st.randoms(use_true_random=False))
def test_the_order_of_points_does_not_matter(points, random):
    shuffled = np.array(random.sample(points.tolist(), len(points)))
    one, other = quantise(points), quantise(shuffled)
    np.testing.assert_array_equal(one.points, other.points)
    np.testing.assert_array_equal(one.origin, other.origin)
    assert one.scale == other.scale


def test_a_cloud_of_equal_points_has_no_extent():
    cloud = quantise(np.full((7, 3), 0.5))
    assert cloud.scale == 0
    assert not cloud.points.any()
    np.testing.assert_array_equal(cloud.dequantise(), np.full((7, 3), 0.5))


def test_equal_points_between_two_float32_numbers_come_back_too():
    points = np.full((5, 3), 1 / 3)
    np.testing.assert_allclose(quantise(points).dequantise(), points, rtol=1e-12)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e39, -1e39])
def test_points_beyond_float32_are_refused_with_the_number_of_their_cloud(value):
    points = np.zeros((3, 4, 3))
    points[1, 2, 0] = value
    with pytest.raises(InputError, match="cloud 1"):
        quantise_clouds(points)


@pytest.mark.parametrize("shape", [(4,), (4, 2), (0, 3), (2, 4, 3)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(InputError, match="a cloud is"):
        quantise(np.zeros(shape))


def test_a_batch_holds_what_its_clouds_give_one_by_one():
    points = np.random.default_rng(1).normal(size=(5, 300, 3)) * np.arange(1, 6)[:, np.newaxis, np.newaxis]
    batch = quantise_clouds(points)
    for i in range(5):
        single = quantise(points[i])
        np.testing.assert_array_equal(batch[i].points, single.points)
        np.testing.assert_array_equal(batch[i].origin, single.origin)
        assert batch[i].scale == single.scale


def test_clouds_grown_in_a_batch_are_the_quantised_attractor_points():
    genomes = [Genome(rows) for rows in TABLE1.values()]
    genomes.insert(1, Genome(TABLE1["06582"], Phenotype(map_form="rho R x + d"), probabilities=(0.25, 0.75)))
    genomes.insert(
        3,
        Genome(
            np.hstack([np.eye(3) * 0.5, np.ones((3, 1))]).reshape(1, 12).repeat(2, 0) * [[1], [-1]],
            Phenotype(family="affine"),
        ),
    )
    for purpose in ("fitness", "display"):
        batch = quantised_attractors(genomes, 400, purpose)
        for i, genome in enumerate(genomes):
            single = quantise(attractor_points(genome, 400, purpose))
            np.testing.assert_array_equal(batch[i].points, single.points)
            np.testing.assert_array_equal(batch[i].origin, single.origin)
            assert batch[i].scale == single.scale


def test_a_genome_without_a_cloud_is_named():
    bad = Genome(np.array(TABLE1["06582"]) * [1, 1, 1, 10, 1, 1, 1])
    with pytest.raises(InputError, match=bad.design_id):
        quantised_attractors([Genome(TABLE1["06425"]), bad], 10)
