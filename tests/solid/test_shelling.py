import numpy as np
import pytest
import trimesh
from scipy import ndimage

from fractal_farm.errors import FarmError, InputError
from fractal_farm.ifs.genome import as_genome
from fractal_farm.solid.body import make_one_body
from fractal_farm.solid.certificate import certificate
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.pipeline import make_solid
from fractal_farm.solid.shelling import hollow
from tests.ifs.attractors import UNIT_CUBE, lattice
from tests.table1 import TABLE1


def ball_field(radius, size):
    steps = np.indices((size,) * 3) - (size - 1) / 2.0 + 0.13
    return (np.sqrt((steps**2).sum(axis=0)) - radius).astype(np.float32)


def test_a_hollowed_ball_is_a_shell_with_one_round_hole():
    field = ball_field(24.0, 57)
    hollows = hollow(field, 6.0, 20.0, 6.0, 2.0, downwards=True)
    assert hollows.count == 1
    # The shell may be thicker by half a voxel, never thinner.
    hole = np.pi * 3.0**2 * 6.0 / (4 / 3 * np.pi * 24.0**3)
    assert (17.5 / 24.0) ** 3 + 0.9 * hole < hollows.share < (18.0 / 24.0) ** 3 + 1.2 * hole
    assert np.count_nonzero(field < 0.0) == pytest.approx((1.0 - hollows.share) * 4 / 3 * np.pi * 24.0**3, rel=0.01)
    # One body, one space outside: the hollow is open.
    report = make_one_body(field)
    assert (report.bodies, report.cavities) == (1, 0)
    # The drain is straight through the shell, and down is as short as any way.
    (begin, end) = hollows.axes[0]
    assert (end - begin)[2] < 0.0
    assert np.linalg.norm(end - 27.87) == pytest.approx(24.0, abs=0.75)


def test_what_is_thinner_than_the_threshold_stays_solid():
    field = ball_field(9.0, 27)
    before = field.copy()
    assert hollow(field, 4.0, 18.5, 4.0, 2.0, downwards=True).count == 0
    np.testing.assert_array_equal(field, before)


def test_the_shell_is_nowhere_thinner_than_asked_for():
    steps = np.indices((70, 50, 40)) - np.array([34.6, 24.6, 19.6])[:, None, None, None]
    halves = np.array([30.0, 20.0, 15.0])[:, None, None, None]
    beyond = np.abs(steps) - halves
    field = (np.linalg.norm(np.maximum(beyond, 0.0), axis=0) + np.minimum(beyond.max(axis=0), 0.0)).astype(np.float32)
    solid = field < 0.0
    (begin, end) = hollow(field, 5.0, 20.0, 4.0, 2.0, downwards=False).axes[0]
    depth = ndimage.distance_transform_edt(solid)
    taken = solid & (field >= 0.0)
    places = np.argwhere(taken) - begin
    axis = (end - begin) / np.linalg.norm(end - begin)
    beside = np.linalg.norm(places - np.outer(places @ axis, axis), axis=1)
    drained = (beside <= 3.0) & (places @ axis > -1.0)
    assert depth[taken][~drained].min() >= 4.5
    assert axis[2] > -0.25


def test_a_hollow_that_no_line_leaves_is_refused():
    # The ball sits in a closed box: lines that leave it meet the walls.
    field = np.minimum(ball_field(12.0, 61), np.abs(ball_field(28.0, 61)) - 1.5)
    with pytest.raises(FarmError, match="no straight way out"):
        hollow(field, 4.0, 16.0, 4.0, 2.0, downwards=True)


def rounded_cube(side, radius):
    """Volume of a cube with edges and corners rounded (Steiner's formula)."""
    core = side - 2.0 * radius
    return core**3 + 6.0 * core**2 * radius + 3.0 * np.pi * core * radius**2 + 4.0 / 3.0 * np.pi * radius**3


@pytest.mark.parametrize("base", ["none", "plate"])
def test_a_shelled_cube_weighs_what_its_shell_does_and_is_open(base):
    parameters = SolidParameters(20.0, 1.0, 60, shell_mm=2.0, shell_above_mm=6.0, base=base)
    solid = make_solid(as_genome(UNIT_CUBE), SolidParameters(20.0, 1.0, 60, base=base))
    mesh = make_solid(as_genome(UNIT_CUBE), parameters)
    facts = certificate(mesh)
    assert facts["watertight"]
    # A closed cavity would be a second surface.
    assert facts["bodies"] == 1
    assert mesh.euler_number == 2
    hollow_mm3 = solid.volume - mesh.volume
    # An inner cube of 16 mm, rounded by 1 mm, and its drain. The shell may be thicker by half a voxel.
    drain = 2.0 * np.pi
    assert rounded_cube(16.0 - 0.34, 1.0) + 0.9 * drain < hollow_mm3 < rounded_cube(16.0, 1.0) + 1.1 * drain
    assert facts["wall_measured_mm"] >= 1.9
    assert mesh.metadata["hollows"] == 1


@pytest.mark.slow
def test_the_papers_cloud_is_hollowed_to_the_shell_asked_for():
    genome = as_genome(TABLE1["06328"])
    mesh = make_solid(genome, SolidParameters(resolution=120, shell_mm=1.0))
    facts = certificate(mesh)
    assert facts["watertight"]
    assert facts["bodies"] == 1
    assert facts["wall_measured_mm"] >= 0.95
    assert mesh.volume < 0.7 * make_solid(genome, SolidParameters(resolution=120)).volume


def test_a_rod_is_not_touched_and_keeps_its_mesh():
    rod = as_genome(lattice(0.5, 1.0, axes=1))
    plain = make_solid(rod, SolidParameters(30.0, 2.0, 60))
    shelled = make_solid(rod, SolidParameters(30.0, 2.0, 60, shell_mm=2.0, shell_above_mm=6.0))
    np.testing.assert_array_equal(plain.vertices, shelled.vertices)
    assert isinstance(shelled, trimesh.Trimesh)
    assert shelled.metadata["hollows"] == 0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"shell_mm": 0.5}, r"shell_mm is 0.5; give 0 or at least wall_mm \(0.8\)"),
        ({"shell_mm": 2.0}, r"shell_above_mm >= 4.34, or shell_mm <= 1.83"),
        ({"shell_mm": 1.0, "drain_mm": 3.0}, r"drain_mm is 3; give 0.333 \(2 voxels\) to half of shell_above_mm \(2\)"),
        ({"closing_mm": 8.0}, r"closing_mm is 8; give 0 to a quarter of size_mm \(7.5\)"),
        ({"closing_mm": float("nan")}, "closing_mm is nan"),
        ({"base": "foot"}, "base is 'foot'; choose from none, plate, stand"),
        ({"bail": "hook"}, "bail is 'hook'; choose from none, ring"),
        ({"bail_hole_mm": 0.0}, "bail_hole_mm is 0; give 0.5 to 20"),
        ({"sprue": True, "base": "plate"}, "leave one out"),
    ],
)
def test_features_out_of_range_are_refused_with_what_would_pass(values, message):
    with pytest.raises(InputError, match=message):
        SolidParameters(**values)


def test_the_remedies_for_a_shell_pass():
    assert SolidParameters(shell_mm=2.0, shell_above_mm=4.34).shell_above_mm == 4.34
    assert SolidParameters(shell_mm=1.83).shell_mm == 1.83
