import math

import numpy as np
import pytest
from PIL import Image

from fractal_farm.errors import InputError
from fractal_farm.ifs.corresponding import corresponding_points
from fractal_farm.ifs.cover import attractor_cover
from fractal_farm.picture.cloud import cloud_picture
from fractal_farm.picture.colours import coloured, legible
from fractal_farm.picture.sweep import paper_sweeps, step_of, sweep_pictures, sweep_sheet, swept
from tests.constructed import conch, star
from tests.table1 import TABLE1 as GENOMES

DESIGN = GENOMES["06582"]


def test_the_middle_of_a_sweep_is_the_picture_of_the_original():
    row = swept(DESIGN, 2, "roll", step_of("pi/60"), 5)
    assert row.genomes[2].design_id == swept(DESIGN, 1, "pitch", step_of("0"), 3).genomes[0].design_id
    pictures = [np.asarray(each) for each in sweep_pictures(row, 96)]
    still = [np.asarray(each) for each in sweep_pictures(swept(DESIGN, 1, "d1", step_of("0"), 3), 96)]
    points = corresponding_points([row.genomes[2]], 10_000)[0]
    alone = cloud_picture(points, 96, legible(coloured(points, "gradient")))
    for each in still:
        np.testing.assert_array_equal(each, alone)
    together = sweep_pictures(row, 96)[2]
    extent = 2 * np.ptp(points, axis=0).max()
    assert together.size == (96, 96)
    assert not np.array_equal(pictures[0], pictures[4])
    # One scale for the whole row: the middle is the original at that scale, pixel for pixel.
    from fractal_farm.picture.view import choose_view

    clouds = corresponding_points(row.genomes, 10_000)
    view = choose_view(clouds[2])
    extents = [np.ptp(view[:2] @ cloud.T, axis=1).max() for cloud in clouds]
    common = min(max(extents), 2 * extents[2])
    expected = cloud_picture(clouds[2], 96, legible(coloured(clouds[2], "gradient")), view=view, extent=common)
    np.testing.assert_array_equal(pictures[2], expected)
    assert common <= extent


def test_a_sweep_over_a_whole_turn_returns():
    row = swept(DESIGN, 1, "yaw", step_of("2pi/4"), 5)
    assert row.values[2] == GENOMES["06582"][0][1]
    assert row.values[0] == pytest.approx(row.values[4])
    first, *_, last = corresponding_points(row.genomes, 2_000)
    np.testing.assert_allclose(first, last, atol=1e-9)
    assert all(-math.pi <= value <= math.pi for value in row.values)


def test_points_correspond_and_move_with_the_gene():
    row = swept(DESIGN, 1, "d1", step_of("1e-5"), 3)
    clouds = corresponding_points(row.genomes, 3_000)
    assert {len(cloud) for cloud in clouds} == {len(clouds[0])}
    assert 2_700 <= len(clouds[0]) <= 3_000
    moved = np.linalg.norm(clouds[2] - clouds[0], axis=1)
    assert 0 < moved.max() < 1e-3


def test_corresponding_points_lie_on_the_attractor_and_cover_it():
    from scipy.spatial import cKDTree

    genome = conch()
    points = corresponding_points([genome, star_like(genome)], 20_000)[0]
    cover = attractor_cover(genome, 0.01)
    assert cKDTree(cover).query(points)[0].max() <= 0.0101
    assert cKDTree(points).query(cover)[0].max() <= 0.05


def star_like(genome):
    """Another genome of as many maps, so that words are chosen for both."""
    return type(genome)(star(5).genes[: genome.n_maps])


def test_steps_are_read_as_people_write_them():
    assert step_of("pi/60").amount == pytest.approx(math.pi / 60)
    assert step_of("-2*pi/9").amount == pytest.approx(-2 * math.pi / 9)
    assert step_of("0.25").amount == 0.25
    assert (step_of("3%").amount, step_of("3%").share) == (0.03, True)
    for wrong in ("", "pi/0", "much", "nan", "-100%", "1e999"):
        with pytest.raises(InputError, match="step is"):
            step_of(wrong)


def test_shares_multiply():
    row = swept(DESIGN, 1, "rho", step_of("3%"), 5)
    assert np.diff(np.log(row.values)) == pytest.approx([math.log(1.03)] * 4)


def test_the_paper_s_rows_have_the_paper_s_steps():
    rows = paper_sweeps(DESIGN)
    assert [len(row.genomes) for row in rows] == [9] * 5
    for row, step in zip(rows[:4], [math.pi / 60] * 3 + [0.25], strict=True):
        assert np.remainder(np.diff(row.values), 2 * math.pi) == pytest.approx([step] * 8)
    assert np.diff(np.log(rows[4].values)) == pytest.approx([math.log(1.03)] * 8)
    sheet = sweep_sheet(rows, 48, n_points=500)
    assert isinstance(sheet, Image.Image)
    assert sheet.width == 9 * 58 + 10


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ((3, "pitch", "0.1", 9), "map is 3; the design has maps 1 to 2"),
        ((0, "pitch", "0.1", 9), "map is 0"),
        ((1, "size", "0.1", 9), "choose one of pitch"),
        ((1, "pitch", "0.1", 4), "odd"),
        ((2, "rho", "3%", 9), "fewer or smaller steps"),
    ],
)
def test_what_cannot_be_swept_is_refused(arguments, reason):
    number, gene, step, steps = arguments
    with pytest.raises(InputError, match=reason):
        swept(DESIGN, number, gene, step_of(step), steps)
