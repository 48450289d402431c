"""What is promised of every solid, on Table 1's genomes and 100 random qualified designs, some of them heavy clouds."""

import re

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from fractal_farm.errors import FarmError
from fractal_farm.ifs.cell_search import cells_of, search_cells
from fractal_farm.ifs.cover import attractor_cover, enclosure_of
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.random_iteration import attractor_points, system_of
from fractal_farm.ifs.support import longest_side
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.pipeline import make_solid
from fractal_farm.solid.skeleton import covering_points
from tests.ifs.attractors import random_genome
from tests.solid.exactness import examine, qualified_designs
from tests.table1 import TABLE1

pytestmark = pytest.mark.slow
SOLID = SolidParameters(size_mm=30.0, wall_mm=0.8, resolution=200)


@pytest.mark.parametrize("name", TABLE1)
def test_the_papers_genomes_keep_every_promise(name):
    assert examine(Genome(np.array(TABLE1[name])), SOLID).faults == []


def test_a_hundred_qualified_designs_keep_every_promise():
    reports = [examine(genome, SOLID) for genome in qualified_designs(100, seed=7)]
    made = [report for report in reports if report.method != "refused"]
    assert len(made) >= 98
    assert [report for report in reports if report.faults] == []
    # Sheets that nearly touch leave pits of a voxel: one of 100 (a contraction of 0.999) needs them filled.
    assert sum(report.pits > 0.0 for report in made) <= 2
    assert max(report.farthest - 1.2 * report.pits for report in made) <= 0.75
    assert max(report.uncovered for report in made) <= 0.5


def test_pits_between_sheets_that_nearly_touch_are_filled():
    """Similarity dimension 2.8 with a ratio of .999: rays found a wall of 0.3 mm where 0.8 was asked for."""
    rows = [
        [-3.01781462, -1.2837444, 2.26410878, 0.12095913, 0.51182026, -0.13052283, 0.44023473],
        [2.45817589, 1.15090529, 1.55751588, 0.99905026, 1.61082698, -0.44625697, 0.3471333],
    ]
    report = examine(Genome(np.array(rows)), SOLID)
    assert report.pits == 0.5
    assert report.wall >= 0.95
    assert report.faults == []


def test_what_is_not_made_says_what_would_pass_and_that_passes():
    refused = 0
    for genome in qualified_designs(12, seed=3, heavy_share=0.0):
        try:
            make_solid(genome, SolidParameters(resolution=150, thicken=False))
        except FarmError as refusal:
            refused += 1
            wall = float(re.search(r"wall >= ([\d.]+) mm", str(refusal)).group(1))
            if wall < 10.0:  # a third of the size: thicker ones are no parameters
                mesh = make_solid(genome, SolidParameters(wall_mm=wall, resolution=150, thicken=False))
                assert mesh.body_count == 1
    assert refused > 0


def bodies(points, radius, spacing):
    """Separate bodies of the balls about points, joined through faces, edges and corners."""
    low = points.min(axis=0) - radius - 2 * spacing
    shape = np.ceil((points.max(axis=0) + radius + 2 * spacing - low) / spacing).astype(int)
    samples = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), -1).reshape(-1, 3) * spacing + low
    away = cKDTree(points).query(samples, distance_upper_bound=radius * 1.01)[0]
    return int(ndimage.label((away <= radius).reshape(shape), np.ones((3, 3, 3)))[1])


def test_the_gap_tells_one_body_from_several():
    """A little more than the gap makes one body; a little less, more than one, where the grid can tell a slit."""
    right = decided = 0
    for seed in range(100):
        genome = Genome(random_genome(seed))
        share = gap(genome)
        side = float(longest_side(enclosure_of(genome, 1e-3, 0.0).attained))
        spacing = side / 110
        if share * side < 6.0 * spacing:  # less: slits close by corners, and the question is the grid's
            continue
        decided += 1
        points = attractor_cover(genome, 0.25 * spacing)
        points = points[np.unique(np.floor(points / (0.5 * spacing)).astype(int), axis=0, return_index=True)[1]]
        one = bodies(points, 0.5 * 1.12 * share * side, spacing) == 1
        right += one and bodies(points, 0.5 * (share * side - 2.5 * spacing), spacing) > 1
    assert decided >= 50
    assert right >= 0.98 * decided


@pytest.mark.parametrize("k", range(4))
def test_a_search_over_cells_is_as_complete_as_it_says(k):
    """Proven is `error`; tested, on long orbits and a search of half the cells, is a diagonal, and mostly a voxel."""
    genome = qualified_designs(4, seed=11, heavy_share=1.0)[k]
    enclosure = enclosure_of(genome, 1e-3, 0.0)
    voxel = float(longest_side(enclosure.attained)) / 100
    cover = covering_points(genome, enclosure, voxel)
    cells = cells_of(system_of(genome).maps, genome.n_maps, enclosure)
    assert cover.method == "cell search"
    assert cover.error == pytest.approx(voxel / cells.spacing)
    assert cover.error < 4.0 * voxel
    finer = search_cells(cells, enclosure, 0.5 * voxel, 20_000_000)
    others = np.concatenate([attractor_points(genome, 200_000), finer[:: max(1, len(finer) // 500_000)]])
    away = cKDTree(cover.points).query(others)[0] / voxel
    assert away.max() <= np.sqrt(3.0)
    assert np.mean(away <= 1.0) >= 0.99
