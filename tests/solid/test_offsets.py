import numpy as np
import pytest

from fractal_farm.solid.offsets import close_slits, distance_to, opened


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


@pytest.mark.parametrize(("hole", "stays"), [(3.9, False), (1.0, True)])
def test_a_hole_is_closed_by_what_is_as_thick_as_the_wall_or_not_at_all(hole, stays):
    # A ball of radius 6 upon a ring with a tube of radius 6 has its centre sqrt(12^2 - (6 + hole)^2) above the middle;
    # what it leaves there is thinner by its radius: 0.8 voxels to either side, or 3.7.
    steps = np.indices((45, 45, 25)) - np.array([22.1, 22.2, 12.1])[:, None, None, None]
    field = (np.hypot(np.hypot(steps[0], steps[1]) - (6.0 + hole), steps[2]) - 6.0).astype(np.float32)
    thickness = np.sqrt(144.0 - (6.0 + hole) ** 2) - 6.0
    film = field.copy()
    close_slits(film, 6.0)
    assert film[22, 22, 12] == pytest.approx(-thickness, abs=0.5)
    closed = field.copy()
    close_slits(closed, 6.0, 3.0)
    assert (closed[22, 22, 12] < 0.0) == stays
    assert np.all(closed <= field)
    assert np.all(closed >= film)


def test_an_opening_takes_what_is_too_thin_and_leaves_the_rest():
    ball = ball_field([(20.3, 19.6, 20.1)], 9.4, (41, 41, 41))
    wire = ball_field([(20.3, 19.6, z) for z in np.arange(4.0, 37.0, 0.25)], 2.0, (41, 41, 41))
    trimmed = opened(np.minimum(ball, wire), 3.0)
    near = np.abs(ball) < 1.5
    away = near & (wire > 3.0)
    np.testing.assert_allclose(trimmed[away], ball[away], atol=0.3)
    assert trimmed[20, 20, 35] > 0.0
