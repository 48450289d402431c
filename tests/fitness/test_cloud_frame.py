import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from fractal_farm.fitness.cloud_frame import TURN, fit_frame, moments, new_frame_workspace, principal_axes
from fractal_farm.ifs.random_iteration import attractor_points
from tests.table1 import TABLE1


def frame_of(points):
    """(n, 3) float32 coordinates in the cloud's own frame, or None if it is a single point."""
    frame = np.empty((3, len(points)), np.float32)
    found = fit_frame(np.array(points, float).T.copy(), new_frame_workspace(), frame)
    return frame.T if found else None


def six(matrix):
    return tuple(float(matrix[i]) for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))


@given(hnp.arrays(np.float64, (3, 3), elements=st.floats(-1e6, 1e6) | st.sampled_from([0.0, 1.0, 1e-30])))
def test_axes_are_orthonormal_eigenvectors_of_any_symmetric_matrix(matrix):
    matrix = matrix @ matrix.T
    work = new_frame_workspace()
    principal_axes(six(matrix), work)
    scale = max(np.abs(matrix).max(), 1e-300)
    assert np.allclose(work.axes @ work.axes.T, np.eye(3), atol=1e-14)
    assert np.allclose(work.axes @ matrix @ work.axes.T, np.diag(work.variances), atol=1e-13 * scale)
    assert np.allclose(work.variances, np.linalg.eigvalsh(matrix)[::-1], atol=1e-13 * scale)
    assert np.all(np.diff(work.variances) <= 0)


def test_moments_are_those_of_numpy_far_from_the_origin_too():
    generator = np.random.default_rng(2)
    points = generator.gamma(2.0, size=(1000, 3)) @ np.array([[2, 0.5, 0], [0, 1, 0.3], [0.1, 0, 0.5]])
    for offset in (0.0, 1e6):
        extent, magnitude, centre, covariance, lopsided = moments(np.ascontiguousarray((points + offset).T))
        inside = points - points.mean(axis=0)
        assert extent == pytest.approx(np.ptp(points, axis=0).max())
        assert magnitude >= np.abs(points + offset).max()
        assert np.allclose(centre, points.mean(axis=0) + offset, rtol=1e-12)
        assert np.allclose(covariance, six(np.cov(points.T, bias=True)), rtol=1e-7)
        assert np.allclose(lopsided, (inside * np.sum(inside**2, axis=1)[:, None]).mean(axis=0), rtol=1e-6)


def test_the_fixed_turn_is_a_rotation_that_leaves_no_axis_parallel_to_the_grid():
    turn = np.array(TURN)
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1)
    assert np.abs(turn).max() < 0.8
    assert np.abs(turn).min() > 0.3


@pytest.mark.parametrize("name", TABLE1)
def test_coordinates_fill_the_unit_cube_and_keep_the_shape(name):
    points = attractor_points(TABLE1[name], 2000)
    frame = frame_of(points).astype(float)
    assert frame.min() == 0.0
    assert np.all(frame.min(axis=0) == 0.0)
    assert frame.max() == 1.0
    assert np.all(frame * 2**23 == np.rint(frame * 2**23))
    first = np.linalg.norm(points - points[0], axis=1)
    inside = np.linalg.norm(frame - frame[0], axis=1)
    assert np.allclose(first / first.max(), inside / inside.max(), atol=1e-6)


@pytest.mark.parametrize("name", TABLE1)
@pytest.mark.parametrize("mirror", [1, -1])
def test_a_moved_turned_mirrored_and_scaled_cloud_has_the_same_coordinates(name, mirror):
    points = attractor_points(TABLE1[name], 2000)
    turned = points @ Rotation.random(random_state=5).as_matrix().T * [mirror, 1, 1]
    assert np.abs(frame_of(turned * 17.3 + [5, -3, 100]) - frame_of(points)).max() < 1e-5


def test_scaling_by_powers_of_two_changes_no_bit():
    points = attractor_points(TABLE1["06425"], 2000)
    expected = frame_of(points)
    for factor in (2.0**-40, 0.5, 4.0, 2.0**60):
        assert np.array_equal(frame_of(points * factor), expected)


@pytest.mark.parametrize(
    "points",
    [
        np.full((10, 3), 3.25),
        np.zeros((2, 3)),
        1e9 + np.random.default_rng(0).random((50, 3)) * 1e-3,
        -7.0 + np.arange(30).reshape(10, 3) * 1e-12,
    ],
    ids=["equal", "origin", "far away", "tiny"],
)
def test_a_cloud_that_is_one_point_to_the_precision_of_its_coordinates_is_reported(points):
    assert frame_of(points) is None


@pytest.mark.parametrize("factor", [1e-160, 1e-299, 1e160, 1e300])
def test_extreme_sizes_still_give_coordinates_in_the_unit_cube(factor):
    frame = frame_of(np.random.default_rng(0).random((100, 3)) * factor)
    assert np.all((frame >= 0) & (frame <= 1))
    assert frame.max() == 1.0
