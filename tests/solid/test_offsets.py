import numpy as np
import pytest

from fractal_farm.solid.offsets import close_slits, distance_to


def ball_field(centres, radius, shape):
    places = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    distances = [np.linalg.norm(places - centre, axis=-1) - radius for centre in centres]
    return np.min(distances, axis=0).astype(np.float32)


def test_distances_inside_of_a_ball_are_exact_to_a_fraction_of_a_voxel():
    field = ball_field([(20.3, 19.6, 20.1)], 12.4, (41, 41, 41))
    depth = distance_to(field, 0.0)
    assert np.all(depth[field >= 0.0] == 0.0)
    np.testing.assert_allclose(depth[field < 0.0], -field[field < 0.0], atol=0.2)


def test_a_closing_leaves_a_ball_as_it_is():
    field = ball_field([(20.3, 19.6, 20.1)], 9.4, (41, 41, 41))
    closed = field.copy()
    close_slits(closed, 4.0)
    assert np.all(closed <= field)
    near = np.abs(field) < 1.5
    np.testing.assert_allclose(closed[near], field[near], atol=0.25)


@pytest.mark.parametrize(("radius", "joined"), [(2.1, False), (3.0, True), (8.0, True)])
def test_two_balls_are_joined_where_the_closing_ball_does_not_pass(radius, joined):
    # Gap of 4 between balls of radius 8. A ball of radius R that touches both has its centre sqrt((8 + R)^2 - 10^2)
    # off the axis, and the neck reaches R less: above 0 from R = 2.25.
    field = ball_field([(20, 20, 14), (20, 20, 34)], 8.0, (41, 41, 49))
    assert field[20, 20, 24] == pytest.approx(2.0)
    close_slits(field, radius)
    neck = np.sqrt(max((8.0 + radius) ** 2 - 100.0, 0.0)) - radius
    assert (field[20, 20, 24] < 0.0) == joined
    if joined:
        across = np.flatnonzero(field[20, :, 24] < 0.0)
        assert across.max() - across.min() == pytest.approx(2.0 * neck, abs=1.6)
