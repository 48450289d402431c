import numpy as np
import pytest
from scipy.spatial import cKDTree

from fractal_farm.errors import FarmError, InputError
from fractal_farm.ifs.cell_search import cells_of, search_cells
from fractal_farm.ifs.cover import attractor_bounds, attractor_cover, enclosure_of
from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.ifs.random_iteration import attractor_points, system_of
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from tests.ifs.attractors import (
    CANTOR_SET,
    TETRAHEDRON,
    UNIT_CUBE,
    lattice,
    random_affine_genome,
    random_genome,
)
from tests.table1 import TABLE1

RANDOM = [random_genome(seed) for seed in range(6)] + [random_affine_genome(seed) for seed in range(3)]
CLOUD = np.array([[0.1, 0.2, 0.3, 0.987, 1, 0, 0], [1, 2, 3, 0.98, 0, 1, 1], [3, 1, 2, 0.97, -1, 2, 0.5]])


def side_of(genome):
    return np.ptp(attractor_points(genome, 20_000), axis=0).max()


def farthest(points, from_points):
    """The longest way from one of `points` to the nearest of `from_points`."""
    return cKDTree(from_points).query(points)[0].max()


@pytest.mark.parametrize(
    ("genome", "lower", "upper"),
    [
        (UNIT_CUBE, [0, 0, 0], [1, 1, 1]),
        (CANTOR_SET, [0, 0, 0], [1, 0, 0]),
        (lattice(0.4, 3.0), [0, 0, 0], [2, 2, 2]),
        (TETRAHEDRON, [-1, -1, -1], [1, 1, 1]),
    ],
)
def test_boxes_that_are_known(genome, lower, upper):
    box = attractor_bounds(genome, 1e-3)
    assert (box[0] <= lower).all()
    assert (box[1] >= upper).all()
    np.testing.assert_allclose(box, [lower, upper], atol=1e-3)


@pytest.mark.parametrize("genome", [*TABLE1.values(), *RANDOM])
def test_the_box_holds_the_attractor_and_every_side_is_reached(genome):
    side = side_of(genome)
    box = attractor_bounds(genome, 1e-3 * side)
    orbit = attractor_points(genome, 100_000)
    assert (orbit >= box[0] - 1e-9 * side).all()
    assert (orbit <= box[1] + 1e-9 * side).all()
    points = attractor_cover(genome, 0.02 * side)
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], box, atol=0.022 * side)


@pytest.mark.parametrize("genome", [*TABLE1.values(), *RANDOM])
def test_every_point_of_the_attractor_has_a_covering_point_within_the_radius(genome):
    radius = 0.015 * side_of(genome)
    points = attractor_cover(genome, radius)
    assert farthest(attractor_points(genome, 50_000), points) <= radius * (1 + 1e-9)


@pytest.mark.parametrize("name", ["06425", "06447", "06582"])
def test_covering_points_lie_on_the_attractor_and_a_coarse_cover_covers_a_fine_one(name):
    side = side_of(TABLE1[name])
    coarse, fine = attractor_cover(TABLE1[name], 0.02 * side), attractor_cover(TABLE1[name], 0.005 * side)
    assert farthest(fine, coarse) <= 0.02 * side
    assert farthest(coarse, fine) <= 0.005 * side


def test_the_cover_reaches_what_random_iteration_misses():
    points = attractor_cover(TABLE1["06447"], 0.1)
    away, _ = cKDTree(attractor_points(TABLE1["06447"], 5000)).query(points)
    assert (away > 0.5).mean() > 0.1


def test_where_words_are_too_many_a_search_over_cells_keeps_the_promise():
    genome = TABLE1["06328"]
    assert similarity_dimension(genome) > 3
    radius = 0.05 * side_of(genome)
    points = attractor_cover(genome, radius, max_points=200_000)
    assert len(points) <= 200_000
    assert farthest(attractor_points(genome, 50_000), points) <= radius


@pytest.mark.parametrize("name", ["06425", "06582"])
def test_the_search_over_cells_loses_less_than_two_diagonals(name):
    genome = as_genome(TABLE1[name])
    enclosure = enclosure_of(genome, 1e-3, 0.0)
    cells = cells_of(system_of(genome).maps, genome.n_maps, enclosure)
    cell = 0.01 * side_of(genome)
    points = search_cells(cells, enclosure, cell, 10**6)
    places = np.floor((points[1:] - enclosure.box[0]) / cell).astype(int)
    assert len(np.unique(places, axis=0)) == len(places)
    assert farthest(attractor_points(genome, 50_000), points) < 2 * np.sqrt(3) * cell


def test_the_cover_does_not_depend_on_the_order_of_the_rows():
    genome = np.array(TABLE1["06425"])
    np.testing.assert_array_equal(attractor_cover(genome, 0.1), attractor_cover(genome[::-1], 0.1))


def test_one_point_covers_an_attractor_smaller_than_the_radius():
    assert len(attractor_cover(UNIT_CUBE, 5.0)) == 1


def test_a_cover_that_would_be_too_large_is_refused_with_a_remedy():
    with pytest.raises(FarmError, match="more than 1000 points; ask for a larger radius"):
        attractor_cover(UNIT_CUBE, 1e-3, max_points=1000)


def test_a_box_that_cannot_be_known_well_enough_is_refused_with_a_tolerance_that_passes():
    with pytest.raises(FarmError, match="similarity dimension") as refusal:
        attractor_bounds(CLOUD, 1e-6)
    attractor_bounds(CLOUD, float(str(refusal.value).split("tolerance of ")[1].split()[0]))


@pytest.mark.parametrize(
    "call",
    [
        lambda: attractor_cover(UNIT_CUBE, 0.0),
        lambda: attractor_cover(UNIT_CUBE, float("nan")),
        lambda: attractor_cover(UNIT_CUBE, 0.1, max_points=0),
        lambda: attractor_bounds(UNIT_CUBE, -1.0),
        lambda: attractor_bounds(Genome(np.ones((2, 7))), 0.1),
    ],
)
def test_bad_arguments_are_refused(call):
    with pytest.raises(InputError):
        call()
