import json

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from fractal_farm.errors import FarmError, InputError
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.ifs.random_iteration import system_of
from fractal_farm.solid import solidify
from fractal_farm.solid.certificate import certificate
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.pipeline import make_solid
from tests.ifs.attractors import (
    CANTOR_SQUARE,
    TETRAHEDRON,
    UNIT_CUBE,
    lattice,
    random_affine_genome,
    random_genome,
)
from tests.table1 import TABLE1


def assert_sound(mesh, wall):
    """What every solid promises."""
    facts = certificate(mesh)
    assert facts["watertight"]
    assert facts["bodies"] == 1
    assert facts["volume_mm3"] > 0
    assert max(facts["box_mm"]) == pytest.approx(mesh.metadata["size_mm"], abs=1e-3)
    assert facts["wall_measured_mm"] >= 0.95 * wall
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), 0, atol=1e-3)


@pytest.mark.parametrize("name", TABLE1)
def test_the_papers_genomes_become_sound_solids(name):
    mesh = solidify(TABLE1[name], resolution=150)
    assert_sound(mesh, 0.8)
    assert mesh.metadata["genome"] == TABLE1[name]
    assert mesh.metadata["design_id"] == Genome(np.array(TABLE1[name])).design_id


@pytest.mark.parametrize(
    "genome", [random_genome(seed) for seed in range(8)] + [random_affine_genome(seed) for seed in range(2)]
)
def test_random_designs_become_one_body_however_far_apart_their_pieces_are(genome):
    assert_sound(solidify(genome, resolution=120), 0.8)


@pytest.mark.parametrize("genome", [TETRAHEDRON, UNIT_CUBE, CANTOR_SQUARE, lattice(0.5, 1.0, axes=1)])
def test_textbook_fractals_become_sound_solids(genome):
    assert_sound(solidify(genome, 20.0, 1.0, 80), 1.0)


def test_a_line_becomes_a_rod_of_the_wall_asked_for():
    mesh = solidify(lattice(0.5, 1.0, axes=1), 30.0, 2.0)
    rod = np.pi * 1.0**2 * 28 + 4 / 3 * np.pi
    assert mesh.volume == pytest.approx(rod, rel=0.05)
    np.testing.assert_allclose(sorted(mesh.extents), [2, 2, 30], rtol=0.05)


def test_a_cube_is_filled():
    mesh = solidify(UNIT_CUBE, 20.0, 2.0, 80)
    assert mesh.euler_number == 2
    # 18 mm cube, its faces, edges and corners thickened by 1 mm (Steiner's formula).
    assert mesh.volume == pytest.approx(18**3 + 6 * 18**2 + 3 * np.pi * 18 + 4 / 3 * np.pi, rel=0.03)


def test_pieces_apart_are_refused_unless_the_wall_may_grow():
    assert gap(CANTOR_SQUARE) > 0.3
    with pytest.raises(FarmError, match=r"wall >= [\d.]+ mm, or size <= [\d.]+ mm, or thicken") as refusal:
        solidify(CANTOR_SQUARE, thicken=False)
    wall = float(str(refusal.value).split("wall >= ")[1].split()[0])
    mesh = solidify(CANTOR_SQUARE, wall_mm=wall, resolution=100, thicken=False)
    assert mesh.body_count == 1
    assert mesh.metadata["wall_used_mm"] == pytest.approx(wall)


def test_metadata_is_json_and_says_what_was_done():
    mesh = solidify(CANTOR_SQUARE, resolution=120)
    facts = json.loads(json.dumps(mesh.metadata))
    assert facts["thickened"]
    assert facts["wall_mm"] == 0.8
    assert facts["wall_used_mm"] > facts["gap_mm"] > 5
    assert facts["units"] == "mm"


def test_what_does_not_fit_into_memory_is_refused_with_a_resolution_that_fits():
    with pytest.raises(FarmError, match=r"GB.*resolution <= \d+"):
        solidify(UNIT_CUBE, resolution=1000)


def test_a_single_point_is_no_solid():
    with pytest.raises(InputError, match="single point"):
        solidify([[0.1, 0.2, 0.3, 0.5, 0, 0, 0], [1, 2, 3, 0.9, 0, 0, 0]])


def test_a_cloud_of_many_overlaps_becomes_a_solid_too():
    assert_sound(solidify(random_genome(3, (5.0, 8.0)), resolution=120), 0.8)


def test_the_same_genome_gives_the_same_mesh_in_any_order_of_its_rows():
    one, other = solidify(TABLE1["06447"], resolution=120), solidify(TABLE1["06447"][::-1], resolution=120)
    np.testing.assert_array_equal(one.vertices, other.vertices)
    np.testing.assert_array_equal(one.faces, other.faces)


@pytest.mark.parametrize("symmetry", ["rotation:5", "mirror", "dihedral:3", "helix:4"])
def test_a_symmetric_solid_is_one_body_of_the_size_asked_for_and_moved_onto_itself_by_its_symmetry(symmetry):
    genome = Genome(np.array(TABLE1["06425"]), symmetry=symmetry)
    mesh = solidify(genome, 30.0, 1.2, resolution=96)
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert mesh.extents.max() == pytest.approx(30.0)
    assert mesh.metadata["symmetry"] == symmetry
    if symmetry.startswith("helix"):
        return
    system, surface = system_of(genome), cKDTree(trimesh.sample.sample_surface(mesh, 100_000, seed=1)[0])
    for copy in system.copies[: system.n_copies[0]].reshape(-1, 3, 4):
        # Centred on its mass, which every isometry of the shape keeps where it is.
        moved = (mesh.vertices - mesh.center_mass) @ copy[:, :3].T + mesh.center_mass
        away = surface.query(moved)[0] / mesh.metadata["voxel_mm"]
        # A pinhole of a voxel may be open in one copy and closed in another, which lies otherwise in the grid.
        assert np.quantile(away, 0.999) < 2.0
        assert away.max() < 4.0


def test_lengths_that_are_whole_voxels_leave_no_sample_on_the_surface():
    # Wall, closing and shell of 8, 3 and 10 voxels: distances from samples to samples are lengths like these.
    mesh = make_solid(as_genome(TABLE1["06447"]), SolidParameters(30.0, 0.8, 300, closing_mm=0.3, shell_mm=1.0))
    assert mesh.is_watertight
    assert mesh.body_count == 1
