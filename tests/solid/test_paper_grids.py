import numpy as np
import pytest

from fractal_farm.errors import InputError
from fractal_farm.solid import solidify
from fractal_farm.solid.paper_grids import PAPER_GRIDS, PAPER_RESOLUTION, grid_resolution, paper_resolution
from tests.table1 import TABLE1


@pytest.mark.parametrize("jewel", PAPER_GRIDS)
def test_a_solid_has_as_many_voxels_along_its_longest_side_as_the_papers_grid(jewel):
    mesh = solidify(TABLE1["06447"], resolution=paper_resolution(jewel))
    voxels = mesh.extents / mesh.metadata["voxel_mm"]
    assert np.round(voxels.max()) == max(PAPER_GRIDS[jewel])
    assert max(paper_resolution(each) for each in PAPER_GRIDS) == PAPER_RESOLUTION


def test_a_jewel_that_the_paper_does_not_have_is_refused():
    with pytest.raises(InputError, match="J0698 and J0619"):
        paper_resolution("J1")


@pytest.mark.parametrize(
    ("grid", "resolution"), [("85x199x144", 199), ("200 X 156 X 126", 200), ("paper", 200), ("J0698", 199)]
)
def test_a_grid_is_as_fine_as_its_longest_side(grid, resolution):
    assert grid_resolution(grid) == resolution


@pytest.mark.parametrize("grid", ["", "85x199", "85x199x", "0x199x144", "9x9x9", "1x2x1001", "-85x199x144", "j1"])
def test_what_is_no_grid_is_refused_in_one_line(grid):
    with pytest.raises(InputError, match=r"such as 85x199x144") as refusal:
        grid_resolution(grid)
    assert "\n" not in str(refusal.value)
