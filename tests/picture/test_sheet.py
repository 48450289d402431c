import numpy as np
import pytest

from fractal_farm.errors import InputError
from fractal_farm.ifs.cover import attractor_bounds, attractor_cover
from fractal_farm.ifs.genome import Genome
from fractal_farm.picture import design_sheet, render_genome
from fractal_farm.picture.points import display_points
from tests.picture.test_cloud import ink
from tests.table1 import TABLE1


@pytest.mark.parametrize("name", TABLE1)
def test_designs_fill_their_pictures_in_many_colours(name):
    picture = np.asarray(render_genome(TABLE1[name], 256))
    drawn = ink(picture)
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    assert max(np.ptp(rows), np.ptp(columns)) > 0.8 * 256
    assert 0.01 < drawn.mean() < 0.8
    assert len(np.unique(picture[drawn] // 16, axis=0)) > 60


@pytest.mark.parametrize("name", ["06425", "06447", "06582"])
def test_a_picture_shows_the_whole_attractor_even_where_random_iteration_never_comes(name):
    points, _ = display_points(Genome(np.array(TABLE1[name])), 20_000)
    lower, upper = attractor_bounds(TABLE1[name], 1e-2)
    side = (upper - lower).max()
    assert np.abs(points.min(axis=0) - lower).max() < 0.02 * side
    assert np.abs(points.max(axis=0) - upper).max() < 0.02 * side
    for place in attractor_cover(TABLE1[name], 0.02 * side):
        assert np.linalg.norm(points - place, axis=1).min() < 0.03 * side


def test_the_same_genome_gives_the_same_picture_and_colourings_differ():
    one = np.asarray(render_genome(TABLE1["06425"], 128))
    np.testing.assert_array_equal(one, np.asarray(render_genome(TABLE1["06425"], 128)))
    dual = np.asarray(render_genome(TABLE1["06425"], 128, colouring="dual"))
    assert (ink(one) == ink(dual)).mean() > 0.99
    assert np.abs(one.astype(int) - dual).max() > 50


def test_a_sheet_has_a_tile_and_a_caption_for_each_design():
    designs = [(Genome(np.array(genes)), name) for name, genes in TABLE1.items()]
    sheet = np.asarray(design_sheet(designs, columns=3, tile=96)).astype(int)
    assert sheet.shape == (2 * (96 + 28 + 10) + 10, 3 * (96 + 10) + 10, 3)
    for index in range(4):
        left, top = 10 + index % 3 * 106, 10 + index // 3 * 134
        assert ink(sheet[top : top + 96, left : left + 96]).mean() > 0.005
        assert np.ptp(sheet[top + 96 : top + 124, left : left + 96]) > 80
    assert np.ptp(sheet[144:, 10 + 106 :].reshape(-1, 3), axis=0).max() == 0


@pytest.mark.parametrize("arguments", [{"designs": []}, {"columns": 0}, {"colouring": "rainbow"}, {"tile": 4}])
def test_a_sheet_that_cannot_be_drawn_is_refused(arguments):
    designs = [(Genome(np.array(TABLE1["06582"])), "a")]
    with pytest.raises(InputError):
        design_sheet(**{"designs": designs, **arguments})
