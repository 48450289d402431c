import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.picture import choose_view


@given(st.integers(0, 1000))
def test_a_view_is_a_rotation(seed):
    rng = np.random.default_rng(seed)
    view = choose_view(rng.normal(size=(200, 3)) @ rng.normal(size=(3, 3)))
    np.testing.assert_allclose(view @ view.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(view) == pytest.approx(1.0)


@given(st.integers(0, 1000))
def test_the_axis_of_least_variance_points_almost_at_the_viewer(seed):
    rng = np.random.default_rng(seed)
    thin, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points = rng.normal(size=(500, 3)) * (3.0, 2.0, 0.1) @ thin.T
    assert abs(choose_view(points)[2] @ thin[:, 2]) > np.cos(np.radians(20))


def test_a_long_shape_lies_in_the_diagonal_where_there_is_most_room():
    points = np.outer(np.linspace(-1, 1, 100), [0.3, 0.5, -0.8])
    right, up = (points @ choose_view(points)[:2].T).T
    assert np.ptp(right) == pytest.approx(np.ptp(up), rel=0.05)
