import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome
from fractal_farm.picture import cloud_picture, design_sheet, dual_tone, linear_gradient, render_genome
from fractal_farm.picture.cloud import GROUND, best_view
from tests.table1 import TABLE1

GROUND_BYTES = np.array([int(255 * value) for value in GROUND])
UPRIGHT = np.eye(3)


def ink(picture):
    """Where something is drawn."""
    return np.abs(picture.astype(int) - GROUND_BYTES).max(axis=2) > 3


def test_the_linear_gradient_is_position_over_range():
    points = np.array([[0.0, 10, -1], [2, 20, -1], [1, 15, -1]])
    np.testing.assert_allclose(linear_gradient(points), [[0, 0, 0], [1, 1, 0], [0.5, 0.5, 0]])


def test_dual_tone_is_the_first_colour_minus_the_second_times_the_gradient():
    points = np.random.default_rng(0).normal(size=(50, 3))
    expected = np.clip([0.9, 0.8, 0.7] - np.array([0.5, 1.0, 0.2]) * linear_gradient(points), 0, 1)
    np.testing.assert_allclose(dual_tone(points, (0.9, 0.8, 0.7), (0.5, 1.0, 0.2)), expected)


def test_points_are_drawn_where_they_are():
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [-1, 1, 0], [0.5, 0.25, 0]])
    picture = cloud_picture(corners, 200, np.ones((4, 3)), UPRIGHT)
    labels, count = ndimage.label(ink(picture))
    assert count == 4
    centres = np.array(ndimage.center_of_mass(labels > 0, labels, range(1, 5)))
    drawn = np.stack([centres[:, 1] - 99.5, 99.5 - centres[:, 0]], axis=1)
    scale = np.ptp(drawn[:, 0]) / 2
    expected = corners[:, :2] * scale
    assert all(np.linalg.norm(drawn - point, axis=1).min() < 2.0 for point in expected)


def test_the_nearest_point_hides_the_others():
    frame = np.array([[-1.0, -1, 0], [1, 1, 0]])
    points = np.concatenate([frame, [[0, 0, -1], [0, 0, 1.0]]])
    colours = np.array([[1.0, 1, 1], [1, 1, 1], [1, 0, 0], [0, 1, 0]])
    picture = cloud_picture(points, 101, colours, UPRIGHT).astype(int)
    middle = picture[49:53, 49:53].reshape(-1, 3)
    assert (middle[:, 1] > middle[:, 0]).sum() > 4


@pytest.mark.parametrize("name", TABLE1)
def test_designs_fill_their_pictures_in_many_colours(name):
    picture = np.asarray(render_genome(TABLE1[name], 256))
    drawn = ink(picture)
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    assert max(np.ptp(rows), np.ptp(columns)) > 0.8 * 256
    assert 0.01 < drawn.mean() < 0.8
    assert len(np.unique(picture[drawn] // 16, axis=0)) > 60


def test_the_same_genome_gives_the_same_picture_and_colourings_differ():
    one = np.asarray(render_genome(TABLE1["06425"], 128))
    np.testing.assert_array_equal(one, np.asarray(render_genome(TABLE1["06425"], 128)))
    dual = np.asarray(render_genome(TABLE1["06425"], 128, colouring="dual"))
    np.testing.assert_array_equal(ink(one), ink(dual))
    assert np.abs(one.astype(int) - dual).max() > 50


@given(st.integers(0, 1000))
def test_the_best_view_is_a_rotation(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3)) @ rng.normal(size=(3, 3))
    view = best_view(points)
    np.testing.assert_allclose(view @ view.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(view) == pytest.approx(1.0)


@pytest.mark.parametrize("points", [np.zeros((5, 3)), np.array([[1.0, 2, 3]]), np.outer(np.arange(9.0), [1, 0, 0])])
def test_degenerate_clouds_are_drawn_too(points):
    assert ink(cloud_picture(points, 64)).any()


@pytest.mark.parametrize(
    ("points", "size"), [(np.zeros((0, 3)), 64), (np.zeros((5, 2)), 64), ([[np.nan, 0, 0]], 64), (np.zeros((5, 3)), 4)]
)
def test_what_cannot_be_drawn_is_refused(points, size):
    with pytest.raises(InputError):
        cloud_picture(points, size)


def test_a_sheet_has_a_tile_and_a_caption_for_each_design():
    designs = [(Genome(np.array(genes)), name) for name, genes in TABLE1.items()]
    sheet = np.asarray(design_sheet(designs, columns=3, tile=96))
    drawn = ink(sheet)
    assert sheet.shape == (2 * (96 + 26 + 12) + 12, 3 * (96 + 12) + 12, 3)
    for index in range(4):
        left, top = 12 + index % 3 * 108, 12 + index // 3 * 134
        assert drawn[top : top + 96, left : left + 96].mean() > 0.005
        assert drawn[top + 96 : top + 122, left : left + 96].any()
    assert not drawn[12 + 134 :, 12 + 108 :].any()
    with pytest.raises(InputError):
        design_sheet([])
