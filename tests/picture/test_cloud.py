import numpy as np
import pytest
from scipy import ndimage

from fractal_farm.errors import InputError
from fractal_farm.picture import cloud_picture, dual_tone, linear_gradient
from fractal_farm.picture.cloud import to_bytes
from fractal_farm.picture.ground import backdrop

UPRIGHT = np.eye(3)
BLACK = (0.0, 0.0, 0.0)


def ink(picture):
    """Where something is drawn on the default ground."""
    return np.abs(picture.astype(int) - to_bytes(backdrop(len(picture)))).max(axis=2) > 3


def drawn_places(picture):
    """Centres of separate marks, (k, 2), x to the right and y up from the middle, pixels."""
    labels, count = ndimage.label(ink(picture))
    centres = np.array(ndimage.center_of_mass(labels > 0, labels, range(1, count + 1)))
    middle = 0.5 * (len(picture) - 1)
    return np.stack([centres[:, 1] - middle, middle - centres[:, 0]], axis=1)


def test_points_are_drawn_where_they_are():
    points = np.array([[-1.0, -1, 0], [1, -1, 0], [-1, 1, 0], [0.5, 0.25, 0]])
    drawn = drawn_places(cloud_picture(points, 200, np.ones((4, 3)), view=UPRIGHT, point_radius=0.02))
    assert len(drawn) == 4
    expected = points[:, :2] * np.ptp(drawn[:, 0]) / 2
    assert all(np.linalg.norm(drawn - point, axis=1).min() < 1.5 for point in expected)


def test_the_nearest_point_hides_the_others():
    frame = np.array([[-1.0, -1, 0], [1, 1, 0]])
    points = np.concatenate([frame, [[0, 0, -1], [0, 0, 1.0]]])
    colours = np.array([[1.0, 1, 1], [1, 1, 1], [1, 0, 0], [0, 1, 0]])
    picture = cloud_picture(points, 101, colours, view=UPRIGHT, ground=BLACK)
    middle = picture[48:54, 48:54].reshape(-1, 3).astype(int)
    assert middle[:, 1].max() > 200
    assert middle[:, 0].max() == 0


@pytest.mark.parametrize(("name", "formula"), [("gradient", linear_gradient), ("dual", dual_tone)])
def test_a_flat_cloud_shows_exactly_the_colours_of_the_formula(name, formula):
    steps = np.linspace(0, 1, 5)
    points = np.array([[x, y, 0.0] for x in steps for y in steps])
    picture = cloud_picture(points, 200, name, view=UPRIGHT, ground=BLACK, point_radius=0.03)
    margin, inner = 200 * 0.06, 200 * 0.88
    for place, colour in zip(points, formula(points), strict=True):
        pixel = picture[int(200 - margin - inner * place[1]), int(margin + inner * place[0])]
        np.testing.assert_allclose(pixel, 255 * colour, atol=1)


def test_what_lies_deeper_is_darker_and_what_is_far_fades():
    rng = np.random.default_rng(0)
    near, far = rng.uniform(-1, 1, (2, 20_000, 2))
    far = far[np.hypot(*far.T) < 0.3]
    near = near[np.hypot(*near.T) > 0.3]
    points = np.concatenate([np.c_[near, np.full(len(near), 0.5)], np.c_[far, np.full(len(far), -0.5)]])
    picture = cloud_picture(points, 128, np.ones_like(points), view=UPRIGHT, ground=BLACK).mean(axis=2)
    pit, plain = picture[60:68, 60:68].mean(), picture[20:28, 60:68].mean()
    assert 10 < pit < 0.8 * plain


@pytest.mark.parametrize("points", [np.zeros((5, 3)), np.array([[1.0, 2, 3]]), np.outer(np.arange(9.0), [1, 0, 0])])
def test_degenerate_clouds_are_drawn_too(points):
    assert ink(cloud_picture(points, 64)).any()


def test_the_points_given_are_not_changed():
    points = np.random.default_rng(1).normal(size=(100, 3))
    before = points.copy()
    cloud_picture(points, 64)
    np.testing.assert_array_equal(points, before)


@pytest.mark.parametrize(
    ("points", "size", "colours"),
    [
        (np.zeros((0, 3)), 64, "gradient"),
        (np.zeros((5, 2)), 64, "gradient"),
        ([[np.nan, 0, 0]], 64, "gradient"),
        (np.zeros((5, 3)), 4, "gradient"),
        (np.zeros((5, 3)), 64, "rainbow"),
        (np.zeros((5, 3)), 64, np.zeros((4, 3))),
    ],
)
def test_what_cannot_be_drawn_is_refused(points, size, colours):
    with pytest.raises(InputError):
        cloud_picture(points, size, colours)
