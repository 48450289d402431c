import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from fractal_farm.errors import InputError
from fractal_farm.ifs.copies import copied, joints
from fractal_farm.ifs.cover import attractor_bounds, attractor_cover
from fractal_farm.ifs.gap import TOLERANCE, gap, gaps_within
from fractal_farm.ifs.genome import Genome, Phenotype, as_genome
from fractal_farm.ifs.quantised_cloud import quantised_attractors
from fractal_farm.ifs.random_iteration import attractor_points, system_of
from fractal_farm.ifs.symmetry import SYMMETRIES
from tests.ifs.attractors import CANTOR_SET, random_affine_genome, random_genome
from tests.table1 import TABLE1

NAMES = [symmetry.name for symmetry in SYMMETRIES]
GROUPS = [name for name in NAMES if not name.startswith("helix")]
# Pieces of .3 and .4 of a segment from (0, 0, 0) to (1, 0, 0); the smaller map's fixed point is the origin.
UNEVEN = Genome(np.array([[0, 0, 0, 0.3, 0, 0, 0], [0, 0, 0, 0.4, 1.5, 0, 0]]))


def with_symmetry(genes, symmetry):
    genome = as_genome(genes)
    return Genome(genome.genes, genome.phenotype, genome.probabilities, symmetry)


def isometries(genome):
    system = system_of(genome)
    return system.copies[: system.n_copies[0]].reshape(-1, 3, 4)


def farthest(one, other):
    """Hausdorff distance of two sets of points."""
    return max(cKDTree(one).query(other)[0].max(), cKDTree(other).query(one)[0].max())


def test_codes_stand_in_records_and_never_change():
    assert NAMES[0] == "none"
    assert [NAMES.index(name) for name in ("rotation:2", "rotation:12", "mirror", "dihedral:2", "dihedral:6")] == [
        *(1, 11, 12, 13, 17)
    ]
    assert (NAMES.index("helix:2"), NAMES.index("helix:8"), len(NAMES)) == (18, 24, 25)


def test_a_symmetry_makes_another_design_and_none_the_same_as_ever():
    genes = np.array(TABLE1["06582"])
    assert Genome(genes, symmetry="none").design_id == Genome(genes).design_id == Genome(genes, Phenotype()).design_id
    assert len({Genome(genes, symmetry=name).design_id for name in NAMES}) == len(NAMES)


@pytest.mark.parametrize("name", ["rotation", "rotation:1", "rotation:13", "mirror:2", "", None, 6, "None", ["none"]])
def test_an_unknown_symmetry_is_refused_with_what_is_allowed(name):
    with pytest.raises(InputError, match=r"genome: symmetry is .*; allowed: none, rotation:2 to rotation:12, mirror"):
        as_genome(Genome(np.array(TABLE1["06582"]), symmetry=name))


@given(st.integers(0, 2**32 - 1), st.sampled_from(GROUPS))
def test_every_copy_moves_the_shape_onto_itself(seed, name):
    genome = with_symmetry(random_genome(seed), name)
    points = attractor_points(genome.genes, 300)
    shape = copied(points, system_of(genome))
    size = np.ptp(shape, axis=0).max()
    for copy in isometries(genome):
        np.testing.assert_allclose(copy[:, :3] @ copy[:, :3].T, np.eye(3), atol=1e-12)
        assert farthest(shape @ copy[:, :3].T + copy[:, 3], shape) < 1e-9 * max(size, np.abs(shape).max())


@given(st.integers(0, 2**32 - 1), st.integers(2, 8))
def test_each_copy_of_a_helix_begins_where_the_one_before_it_ends(seed, count):
    genome = with_symmetry(random_genome(seed), f"helix:{count}")
    ends = joints(system_of(genome), genome.n_maps).reshape(count, 2, 3)
    np.testing.assert_allclose(ends[:-1, 1], ends[1:, 0], atol=1e-9 * np.abs(ends).max())


@pytest.mark.parametrize("genes", [random_affine_genome(2), random_genome(3, (1.0, 2.0)), UNEVEN, CANTOR_SET])
@pytest.mark.parametrize("name", ["rotation:5", "mirror", "dihedral:3", "helix:4"])
def test_balls_of_half_the_gap_make_one_body_of_all_copies(genes, name):
    genome = with_symmetry(genes, name)
    lower, upper = attractor_bounds(genome, 1e-3)
    side = (upper - lower).max()
    radius = 0.01 * side
    points = attractor_cover(genome, radius)
    reach = gap(genome) * side + 2 * radius
    pieces, _ = csgraph.connected_components(cKDTree(points).sparse_distance_matrix(cKDTree(points), reach))
    assert pieces == 1
    assert gap(genome) <= gap(genes) + 1.3 * TOLERANCE


@pytest.mark.parametrize(
    ("name", "expected"),
    [("none", 0.3), ("rotation:2", 0.15), ("rotation:4", 0.15), ("rotation:3", 0.3 / np.sqrt(3)), ("helix:2", 0.2)],
)
def test_the_gap_of_a_segment_and_its_copies_is_known(name, expected):
    genome = with_symmetry(UNEVEN, name)
    assert expected - 1e-9 <= gap(genome) <= expected + 1.3 * TOLERANCE
    assert gaps_within([genome], expected + 2 * TOLERANCE).tolist() == [True]
    assert gaps_within([genome], expected - TOLERANCE).tolist() == [False]


@given(st.integers(0, 2**32 - 1), st.sampled_from(NAMES))
def test_the_box_holds_all_points_and_touches_them(seed, name):
    genome = with_symmetry(random_genome(seed, (1.0, 2.0)), name)
    cloud = attractor_points(genome, 2000)
    side = np.ptp(cloud, axis=0).max()
    lower, upper = attractor_bounds(genome, 1e-3 * side)
    assert (cloud >= lower - 1e-9 * side).all()
    assert (cloud <= upper + 1e-9 * side).all()
    cover = attractor_cover(genome, 0.02 * side)
    np.testing.assert_allclose([cover.min(axis=0), cover.max(axis=0)], [lower, upper], atol=0.022 * side)


@pytest.mark.parametrize("name", ["rotation:6", "mirror", "helix:8"])
def test_points_are_those_of_the_attractor_spread_evenly_over_the_copies(name):
    genes = np.array(TABLE1["06425"])
    genome = with_symmetry(genes, name)
    copies = isometries(genome)
    orbit, cloud = attractor_points(genes, 6000), attractor_points(genome, 6000)
    images = np.einsum("kij,tj->tki", copies[:, :, :3], orbit) + copies[:, :, 3]
    distance = np.linalg.norm(images - cloud[:, None], axis=2)
    assert distance.min(axis=1).max() < 1e-12 * np.abs(cloud).max()
    counts = np.bincount(distance.argmin(axis=1), minlength=len(copies))
    assert stats.chisquare(counts).pvalue > 1e-4
    np.testing.assert_array_equal(attractor_points(genome, 100), cloud[:100])
    np.testing.assert_array_equal(attractor_points(with_symmetry(genes[[2, 0, 1]], name), 6000), cloud)


def test_stored_clouds_of_a_batch_of_symmetries_are_those_of_each_alone():
    genomes = [with_symmetry(TABLE1["06582"], name) for name in NAMES]
    together = quantised_attractors(genomes, 500)
    for index, genome in enumerate(genomes):
        np.testing.assert_array_equal(together.points[index], quantised_attractors([genome], 500).points[0])
        one_step = together.scale[index] / 65535
        assert farthest(together[index].dequantise(), attractor_points(genome, 500)) < one_step
