import itertools

import numpy as np
import pytest
import trimesh

from fractal_farm.errors import InputError
from fractal_farm.picture import mesh_picture, turntable
from tests.picture.test_cloud import ink

UPRIGHT = np.eye(3)
BALL = trimesh.creation.icosphere(subdivisions=4)


def test_a_ball_is_a_full_disc():
    picture = mesh_picture(BALL, 200, view=UPRIGHT)
    rows, columns = np.indices((200, 200)) - 99.5
    disc = np.hypot(rows, columns) < 200 * 0.44
    assert (ink(picture) == disc).mean() > 0.99


def test_light_comes_from_above_and_metals_have_their_hue():
    gold = mesh_picture(BALL, 200, "gold", view=UPRIGHT).astype(float)
    silver = mesh_picture(BALL, 200, "silver", view=UPRIGHT).astype(float)
    assert gold[30:80, 60:140].mean() > 1.3 * gold[120:170, 60:140].mean()
    warmth = (gold[..., 0] - gold[..., 2])[50:150, 50:150].mean()
    assert warmth > 4 * abs((silver[..., 0] - silver[..., 2])[50:150, 50:150].mean())


def test_what_is_in_front_hides_what_is_behind():
    front = trimesh.creation.box((1, 1, 0.1), trimesh.transformations.translation_matrix([0, 0, 1]))
    behind = trimesh.creation.box((1.2, 1.2, 0.1), trimesh.transformations.translation_matrix([0, 0, -1]))
    both = trimesh.util.concatenate([behind, front])
    alone, together = (mesh_picture(mesh, 100, view=UPRIGHT) for mesh in (behind, both))
    np.testing.assert_array_equal(ink(alone), ink(together))
    swapped = trimesh.util.concatenate([front, behind])
    np.testing.assert_array_equal(together, mesh_picture(swapped, 100, view=UPRIGHT))


def test_an_unknown_metal_is_refused():
    with pytest.raises(InputError, match=r"tin.*gold"):
        mesh_picture(BALL, 64, "tin")


def test_a_turntable_begins_with_the_still_and_goes_on_turning():
    mesh = trimesh.creation.annulus(1.0, 1.3, 1.0)
    frames = turntable(mesh, 96, "silver", 8)
    still = ink(mesh_picture(mesh, 96, "silver"))
    assert frames.shape == (8, 96, 96, 3)
    # The still fills its frame, the turn has room for all sides: the same outline, smaller.
    assert 0.5 < ink(frames[0]).sum() / still.sum() <= 1.02
    assert all((ink(a) != ink(b)).sum() > 50 for a, b in itertools.pairwise(frames))


def test_a_piece_on_a_turntable_stays_in_its_frame_at_one_scale():
    frames = turntable(trimesh.creation.capsule(4.0, 0.3), 120, "gold", 12)
    for frame in frames:
        shown = ink(frame)
        assert not shown[:3].any()
        assert not shown[-3:].any()
        assert not shown[:, :3].any()
        assert not shown[:, -3:].any()
    # A ball looks the same from everywhere.
    sizes = [ink(frame).sum() for frame in turntable(BALL, 120, "gold", 6)]
    assert max(sizes) <= 1.02 * min(sizes)


@pytest.mark.parametrize(("size", "frames"), [(8, 12), (64, 1), (64, 361)])
def test_a_turntable_out_of_range_is_refused(size, frames):
    with pytest.raises(InputError, match=r"give \d+ to \d+"):
        turntable(BALL, size, "gold", frames)


def test_marked_faces_are_red_where_they_are_seen():
    upper = BALL.triangles_center[:, 1] > 0.0
    picture = mesh_picture(BALL, 200, "silver", view=UPRIGHT, marked=upper).astype(int)
    red = picture[..., 0] - picture[..., 1] > 80
    assert red[20:95, 90:110].all()
    assert not red[105:].any()
    hidden = mesh_picture(BALL, 200, "silver", view=UPRIGHT, marked=BALL.triangles_center[:, 2] < -0.1)
    np.testing.assert_array_equal(hidden, mesh_picture(BALL, 200, "silver", view=UPRIGHT))
