from dataclasses import replace

import manifold3d
import numpy as np
import pytest
import trimesh
from PIL import Image, ImageDraw, ImageFont, ImageOps
from scipy.spatial import cKDTree

from fractal_farm.errors import FarmError, InputError
from fractal_farm.ifs.genome import as_genome
from fractal_farm.solid.attachments import ring_hole, with_attachments
from fractal_farm.solid.certificate import certify, measured_wall
from fractal_farm.solid.materials import material
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.pipeline import make_solid
from fractal_farm.solid.surface import Surface
from tests.ifs.attractors import CANTOR_SQUARE, TETRAHEDRON, UNIT_CUBE, random_genome
from tests.table1 import TABLE1

CODE = "FF-0E3E-RK8M-94CX-9"
GENOMES = [TABLE1["06447"], TABLE1["06582"], TETRAHEDRON, random_genome(3)]


def surface_of(mesh):
    return Surface(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32), 0)


def attached(mesh, parameters):
    surface = with_attachments(surface_of(mesh), parameters, CODE)
    return trimesh.Trimesh(surface.vertices, surface.faces, process=False)


def assert_one_body(mesh):
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert mesh.volume > 0.0


@pytest.fixture(scope="module", params=range(len(GENOMES)))
def body(request):
    return make_solid(as_genome(GENOMES[request.param]), SolidParameters(resolution=120))


def test_nothing_asked_for_changes_nothing(body):
    surface = surface_of(body)
    assert with_attachments(surface, SolidParameters(resolution=120), CODE) is surface


@pytest.mark.parametrize("hole", [1.5, 4.0])
def test_a_pin_as_wide_as_the_hole_passes_the_bail_and_a_wider_one_does_not(body, hole):
    parameters = SolidParameters(resolution=120, bail="ring", bail_hole_mm=hole)
    mesh = attached(body, parameters)
    assert_one_body(mesh)
    centre, axis = ring_hole(body.vertices.astype(np.float32), parameters)
    turns = np.linspace(0.0, 2.0 * np.pi, 73)
    side = np.cross(axis, [0.0, 0.0, 1.0])
    around = np.outer(np.cos(turns), side) + np.outer(np.sin(turns), [0.0, 0.0, 1.0])
    along = axis * np.linspace(-20.0, 20.0, 401)[:, None]
    for radius, inside in ((0.0, False), (0.499 * hole, False), (0.5 * hole + 0.1, True)):
        pin = (centre + radius * around[:, None] + along[None]).reshape(-1, 3)
        assert mesh.contains(pin).any() == inside
    # The ring goes all the way around, as thick as it should be.
    wire = 1.25 * parameters.wall_mm
    assert np.all(mesh.contains(centre + (0.5 * hole + 0.5 * wire) * around))
    # It is above the piece, that hangs from it.
    assert centre[2] - 0.5 * hole > body.bounds[1, 2]
    assert mesh.bounds[0, 2] == pytest.approx(body.bounds[0, 2], abs=1e-4)


def test_the_bail_is_joined_as_thick_as_the_wall(body):
    parameters = SolidParameters(resolution=120, bail="ring")
    mesh = attached(body, parameters)
    # Horizontal cuts from the hole down into the body.
    top = body.bounds[1, 2]
    surface = surface_of(mesh)
    solid = manifold3d.Manifold(manifold3d.Mesh(surface.vertices, surface.faces.astype(np.uint32)))
    for depth in (0.1, 0.3, 0.5, 0.7):
        assert max(part.area() for part in solid.slice(top - depth).decompose()) >= np.pi * 0.38**2


@pytest.mark.parametrize("base", ["plate", "stand"])
def test_a_base_is_flat_below_and_the_piece_stands_on_it(body, base):
    parameters = SolidParameters(resolution=120, base=base)
    mesh = attached(body, parameters)
    assert_one_body(mesh)
    bottom = mesh.bounds[0, 2]
    flat = np.all(np.abs(mesh.triangles[:, :, 2] - bottom) < 1e-3, axis=1)
    width = max(body.extents[:2])
    assert mesh.area_faces[flat].sum() >= 0.99 * np.pi * (0.35 * width) ** 2
    foot = mesh.triangles[flat].reshape(-1, 3)[:, :2]
    middle = 0.5 * (foot.min(axis=0) + foot.max(axis=0))
    radius = 0.5 * np.ptp(foot, axis=0).max()
    # It does not fall: the centre of mass is above the foot, far from its rim.
    assert np.linalg.norm(mesh.center_mass[:2] - middle) < 0.5 * radius
    assert (bottom < body.bounds[0, 2] - 1.0) == (base == "stand")
    assert mesh.bounds[1, 2] == pytest.approx(body.bounds[1, 2], abs=1e-4)


def seen_from_below(mesh, height):
    """Grooves of the underside as a picture, a pixel 0.05 mm: where there is no material at a height, x to the left."""
    bottom = mesh.bounds[0, 2]
    foot = mesh.vertices[mesh.vertices[:, 2] < bottom + 1e-3, :2]
    low, high = foot.min(axis=0), foot.max(axis=0)
    middle, radius = 0.5 * (low + high), 0.5 * np.ptp(foot, axis=0).max()
    x, y = np.meshgrid(np.arange(high[0], low[0], -0.05), np.arange(high[1], low[1], -0.05))
    places = np.stack([x, y, np.full_like(x, bottom + height)], axis=-1)
    on_disc = np.hypot(x - middle[0], y - middle[1]) < radius - 0.1
    empty = on_disc & ~mesh.contains(places.reshape(-1, 3)).reshape(x.shape)
    return Image.fromarray(empty)


def likeness(picture, text):
    """Share of pixels that are as in a picture of the text in three lines."""
    image = Image.new("1", (100, 60))
    font = ImageFont.load_default_imagefont()
    ImageDraw.Draw(image).multiline_text((5, 5), text, 1, font, align="center", spacing=0)
    wanted = image.crop(image.getbbox()).resize(picture.size, Image.Resampling.NEAREST)
    return np.mean(np.asarray(wanted) == np.asarray(picture))


@pytest.mark.parametrize("base", ["plate", "stand"])
def test_the_code_is_read_on_the_underside(body, base):
    parameters = SolidParameters(resolution=120, base=base, engrave=True)
    mesh = attached(body, parameters)
    assert_one_body(mesh)
    picture = seen_from_below(mesh, 0.2 * parameters.wall_mm)
    picture = picture.crop(picture.getbbox())
    right = likeness(picture, "FF-0E3E\nRK8M\n94CX-9")
    assert right > 0.95
    for wrong in ("FF-0E3E\nRK8M\n94CX-8", "FF-0E3E\nRK8N\n94CX-9", "FF-DE3E\nRK8M\n94CX-9"):
        assert likeness(picture, wrong) < right
    assert likeness(ImageOps.mirror(picture), "FF-0E3E\nRK8M\n94CX-9") < 0.9
    assert seen_from_below(mesh, 0.39 * parameters.wall_mm).getbbox() is not None
    assert seen_from_below(mesh, 0.41 * parameters.wall_mm).getbbox() is None


def test_a_base_that_is_engraved_has_room_for_the_strokes():
    small = SolidParameters(12.0, 0.6, 60, base="plate", engrave=True)
    mesh = make_solid(as_genome(TABLE1["06447"]), small)
    assert_one_body(mesh)
    letters = seen_from_below(mesh, 0.2 * small.wall_mm).getbbox()
    # 51 strokes of 0.25 mm from corner to corner of the writing.
    assert 0.05 * np.hypot(letters[2] - letters[0], letters[3] - letters[1]) == pytest.approx(51 * 0.25, rel=0.05)


def test_the_sides_of_letters_are_no_walls():
    plain = SolidParameters(40.0, 1.0, 160, base="stand")
    bare, engraved = (make_solid(as_genome(TABLE1["06447"]), each) for each in (plain, replace(plain, engrave=True)))
    assert certify(bare, material("nylon")).passes
    assert certify(engraved, material("nylon")).passes
    assert engraved.metadata["wall_measured_mm"] == pytest.approx(bare.metadata["wall_measured_mm"], rel=0.05)
    # As they would be if nobody had said what they are.
    del engraved.metadata["engraved_mm"]
    assert not certify(engraved, material("nylon")).passes


def test_an_engraving_without_a_base_is_refused():
    with pytest.raises(InputError, match="engrave is True, and there is no base to engrave; give a base"):
        SolidParameters(engrave=True)


def test_a_sprue_feeds_the_lowest_point(body):
    parameters = SolidParameters(resolution=120, sprue=True)
    mesh = attached(body, parameters)
    assert_one_body(mesh)
    # A disc of 2.5 walls, and a frustum of radii 2.5 and 1; at most the narrow end is inside of the body.
    length, wide, narrow = 0.2 * 30.0, 2.5 * 0.8, 0.8
    cone = np.pi * wide**2 * 0.8 + np.pi / 3.0 * length * (wide**2 + wide * narrow + narrow**2)
    assert 0.85 * cone < mesh.volume - body.volume < cone
    assert mesh.bounds[0, 2] == pytest.approx(body.bounds[0, 2] - 6.0, abs=1e-3)


@pytest.mark.parametrize("added", [{"bail": "ring"}, {"sprue": True}, {"base": "plate"}, {"base": "stand"}])
def test_what_is_built_on_is_no_thinner_than_the_wall(body, added):
    parameters = SolidParameters(resolution=120, **added)
    assert measured_wall(attached(body, parameters)) >= 0.95 * min(measured_wall(body), parameters.wall_mm)


def test_a_base_that_would_close_a_drain_is_refused():
    parameters = SolidParameters(20.0, 1.0, 60, shell_mm=2.0, shell_above_mm=6.0)
    mesh = make_solid(as_genome(UNIT_CUBE), parameters)
    with pytest.raises(FarmError, match=r"closes a hollow of \d+\.\d mm3; leave out the base, or shell_mm"):
        attached(mesh, replace(parameters, base="plate"))


def test_the_size_is_that_of_the_body_without_what_is_built_onto_it():
    plain = make_solid(as_genome(CANTOR_SQUARE), SolidParameters(resolution=120, bridges=True))
    mesh = make_solid(as_genome(CANTOR_SQUARE), SolidParameters(resolution=120, bridges=True, bail="ring", sprue=True))
    assert_one_body(mesh)
    # The body stays where and as large as it was: nearly all of its vertices are still there.
    distances, _ = cKDTree(mesh.vertices).query(plain.vertices)
    assert (distances < 1e-4).mean() > 0.9
    assert plain.extents.max() == pytest.approx(30.0, abs=1e-3)
    assert mesh.extents[2] > plain.extents[2] + 8.0
    assert mesh.metadata["parameters"]["bail"] == "ring"
    assert mesh.metadata["parameters"]["sprue"] is True


@pytest.mark.slow
def test_everything_at_once_is_one_body():
    parameters = SolidParameters(
        30.0, 0.8, 120, bridges=True, closing_mm=0.4, shell_mm=1.0, base="stand", bail="ring", bail_hole_mm=2.0
    )
    assert_one_body(make_solid(as_genome(TABLE1["06328"]), parameters))
