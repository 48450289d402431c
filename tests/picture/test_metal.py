import numpy as np
import pytest
import trimesh

from fractal_farm.errors import InputError
from fractal_farm.picture import mesh_picture
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
