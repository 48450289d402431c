"""Estimates of solids: known bodies, the meshes of the pipeline, and what cannot be told."""

import math

import numpy as np
import pytest

from fractal_farm.errors import InputError
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome
from fractal_farm.solid.estimate import SILVER, STANDARD, estimate_solid, estimates
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.pipeline import make_solid
from tests.ifs.attractors import TETRAHEDRON, UNIT_CUBE, random_genome
from tests.table1 import TABLE1


def bar(x, y, z):
    """A straight segment in some direction."""
    return Genome(np.array([[0, 0, 0, 0.5, x, y, z], [0, 0, 0, 0.5, -x, -y, -z]]))


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, -0.7, 0.4)])
def test_a_smooth_bar_has_the_volume_of_a_capsule_or_up_to_a_half_more(direction):
    found = estimate_solid(bar(*direction), 0.0)
    r, length = 0.4, 29.2 * np.linalg.norm(direction)  # the longest side is 1
    # What is added for rough shapes, a quarter of r, is too much for a smooth one.
    assert 1.0 <= found.volume_mm3 / (math.pi * r * r * length + 4 / 3 * math.pi * r**3) <= 1.5
    assert found.sides_mm == pytest.approx(sorted((29.2 * abs(v) + 0.8 for v in direction), reverse=True), abs=0.01)
    assert found.grams == found.volume_mm3 * SILVER


def test_a_cube_has_the_volume_of_a_cube_with_round_edges():
    found = estimate_solid(Genome(UNIT_CUBE), 0.0)
    r, side = 0.4, 29.2
    exact = side**3 + 6 * side**2 * r + 3 * math.pi * side * r * r + 4 / 3 * math.pi * r**3
    assert found.volume_mm3 == pytest.approx(exact, rel=0.05)
    assert found.sides_mm == pytest.approx((30.0,) * 3, abs=0.01)


@pytest.mark.parametrize("parameters", [STANDARD, SolidParameters(20.0, 1.2)], ids=["standard", "small and thick"])
@pytest.mark.parametrize(
    "rows", [TETRAHEDRON, TABLE1["06582"], TABLE1["06328"], random_genome(3, (1.2, 2.0)), random_genome(8, (1.2, 2.0))]
)
def test_volume_and_sides_are_those_of_the_mesh(rows, parameters):
    genome = Genome(np.array(rows))
    found, mesh = estimate_solid(genome, gap(genome), parameters), make_solid(genome, parameters)
    assert found.volume_mm3 == pytest.approx(mesh.volume, rel=0.15)
    assert found.sides_mm == pytest.approx(sorted(mesh.extents, reverse=True), rel=0.04, abs=0.1)


@pytest.mark.parametrize("symmetry", ["rotation:3", "mirror", "helix:4"])
def test_copies_count(symmetry):
    genome = Genome(np.array(TABLE1["06582"]), symmetry=symmetry)
    found, mesh = estimate_solid(genome, gap(genome)), make_solid(genome, STANDARD)
    assert found.volume_mm3 == pytest.approx(mesh.volume, rel=0.15)
    assert found.sides_mm == pytest.approx(sorted(mesh.extents, reverse=True), rel=0.04, abs=0.1)


def test_columns_are_of_the_standard_solid_and_empty_where_nothing_is_asked():
    genome = Genome(TETRAHEDRON)
    found = estimate_solid(genome, 0.0)
    columns = estimates([genome, bar(1, 0, 0)], [0.0, None])
    assert columns == {
        "grams": [found.grams, None],
        "width_mm": [found.sides_mm[1], None],
        "depth_mm": [found.sides_mm[2], None],
    }


def test_a_single_point_has_no_solid():
    point = Genome(np.array([[0.1, 0.2, 0.3, 0.5, 0, 0, 0], [0.3, 0.2, 0.1, 0.6, 0, 0, 0]]))
    with pytest.raises(InputError, match="single point"):
        estimate_solid(point, 0.0)
    assert estimates([point], [0.0])["grams"] == [None]
