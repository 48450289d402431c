import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from fractal_farm.errors import InputError
from fractal_farm.fitness import capacity_dimension, correlation_dimension, pair_counts, shape_descriptor
from fractal_farm.fitness.dimensions import measured
from fractal_farm.ifs.random_iteration import attractor_points
from tests.table1 import TABLE1


@pytest.mark.parametrize("name", TABLE1)
def test_dimensions_do_not_depend_on_place_orientation_handedness_or_size(name):
    points = attractor_points(TABLE1[name], 5000)
    d0, d2, _, _ = measured(points)
    for seed in range(4):
        turned = points @ Rotation.random(random_state=seed).as_matrix().T * [(-1) ** seed, 1, 1]
        moved = measured(turned * 0.01 + [1, 2, 3])
        assert moved[0] == pytest.approx(d0, abs=0.01)
        assert moved[1] == pytest.approx(d2, abs=0.003)


def test_scaling_by_powers_of_two_changes_no_bit_of_a_dimension():
    points = attractor_points(TABLE1["06582"], 3000)
    points -= points.mean(axis=0)
    for exponent in (-1000, -540, -340, -30, 1, 50, 340, 540, 1016, 1020):
        scaled = np.ldexp(points, exponent)
        assert measured(scaled) == measured(points)
        assert pair_counts(scaled).tolist() == pair_counts(points).tolist()
        assert np.array_equal(shape_descriptor(scaled), shape_descriptor(points))


@pytest.mark.parametrize("points", [np.full((100, 3), 2.5), np.zeros((2, 3)), 1e9 + np.eye(3) * 1e-4])
def test_a_single_point_has_dimension_zero_and_all_pairs_in_the_first_bin(points):
    n = len(points)
    assert measured(points) == (0.0, 0.0, 0.0, 0.0)
    assert pair_counts(points).tolist() == [n * (n - 1) // 2, *[0] * 15]


def test_two_points_have_dimension_zero():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    assert capacity_dimension(points) == 0.0
    assert correlation_dimension(points) == 0.0
    assert pair_counts(points).tolist() == [*[0] * 15, 1]
    assert measured(np.repeat(points, 2500, axis=0))[:2] == (0.0, 0.0)


def test_a_cloud_far_from_the_origin_keeps_its_dimensions():
    points = attractor_points(TABLE1["06328"], 5000)
    d0, d2, _, _ = measured(points)
    far = measured(points + np.array([1e9, -1e9, 1e9]))
    assert far[0] == pytest.approx(d0, abs=0.03)
    assert far[1] == pytest.approx(d2, abs=0.01)


def test_a_line_is_one_dimensional_whatever_its_direction():
    t = np.random.default_rng(0).random((5000, 1))
    for direction in ([1, 0, 0], [0, 0, 3], [1, 1, 1], [1e-5, 1, -2]):
        d0, d2, d0_error, d2_error = measured(t * np.array(direction))
        assert d0 == pytest.approx(1, abs=0.03)
        assert d2 == pytest.approx(1, abs=0.015)
        assert 0 < d0_error < 0.02
        assert 0 < d2_error < 0.01


@given(
    hnp.arrays(
        np.float64,
        st.tuples(st.integers(2, 200), st.just(3)),
        elements=st.floats(-1e12, 1e12) | st.floats(-1, 1) | st.sampled_from([0.0, 1e-300, 1e150]),
    )
)
def test_any_finite_cloud_has_dimensions_between_zero_and_three(points):
    d0, d2, _, _ = measured(points)
    assert 0 <= d0 <= 3
    assert 0 <= d2 <= 3
    assert pair_counts(points).sum() == len(points) * (len(points) - 1) // 2


@pytest.mark.parametrize("dtype", [np.float32, np.float16, np.int64])
def test_points_of_any_real_type_and_layout_are_taken_and_left_alone(dtype):
    points = (attractor_points(TABLE1["06425"], 1000) * 50).astype(dtype)
    for view in (points, np.asfortranarray(points), points[::-1], points.tolist()):
        before = np.array(view)
        assert 0 < correlation_dimension(view) < 3
        assert np.array_equal(before, view)
    points.setflags(write=False)
    assert 0 < capacity_dimension(points) < 3


@pytest.mark.parametrize(
    ("points", "complaint"),
    [
        (np.zeros((5, 2)), r"shape \(5, 2\)"),
        (np.zeros(3), r"shape \(3,\)"),
        (np.zeros((1, 3)), "at least 2 points"),
        ([[0, 0, 0], [1, np.nan, 0]], "row 1 is"),
        ([[0, 0, 0], [1, 0, np.inf]], "finite"),
        ([["a", 0, 0], [1, 0, 0]], "not a table of numbers"),
    ],
)
@pytest.mark.parametrize("function", [capacity_dimension, correlation_dimension, pair_counts])
def test_what_is_not_a_cloud_is_refused_with_the_reason(function, points, complaint):
    with pytest.raises(InputError, match=complaint):
        function(points)
