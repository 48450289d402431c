"""Certificates of shapes whose truth is known, and of shapes that are wrong in a known way."""

import json

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from fractal_farm.cli import main
from fractal_farm.errors import InputError
from fractal_farm.solid.certificate import certify
from fractal_farm.solid.findings import WALL_TOLERANCE
from fractal_farm.solid.materials import material

SILVER = material("silver")
BALL = trimesh.creation.icosphere(subdivisions=4, radius=5.0)


def box(sides, middle=(0.0, 0.0, 0.0)):
    return trimesh.creation.box(sides, trimesh.transformations.translation_matrix(middle))


def inverted(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def together(*meshes):
    return trimesh.util.concatenate(meshes)


def shell(outer, wall):
    """A spherical shell; its hollow is a closed cavity."""
    spheres = [trimesh.creation.icosphere(subdivisions=4, radius=radius) for radius in (outer, outer - wall)]
    return together(spheres[0], inverted(spheres[1]))


def found(certificate, severity="failure"):
    return [finding.what for finding in certificate.findings if finding.severity == severity]


def test_a_sound_box_passes_with_the_figures_of_a_box():
    sound = certify(box((10.0, 8.0, 3.0)), SILVER)
    assert sound.passes
    assert sound.findings == ()
    assert (sound.n_bodies, sound.n_cavities, sound.genus, sound.manifold) == (1, 0, 0, "NoError")
    assert sound.volume_mm3 == pytest.approx(240.0)
    assert sound.area_mm2 == pytest.approx(268.0)
    assert sound.grams == pytest.approx(0.240 * SILVER.density)
    assert sound.grams_polished == pytest.approx(0.9 * sound.grams)
    assert sound.wall_mm == pytest.approx(3.0, abs=1e-3)
    assert sound.thickest.diameter_mm == pytest.approx(3.0, abs=sound.thickest.error_mm)
    assert sound.overhang_share == 0.0


def test_the_thickest_ball_in_a_ball_is_the_ball_and_it_should_be_shelled():
    massive = certify(BALL, SILVER)
    assert massive.passes
    assert massive.thickest.diameter_mm == pytest.approx(10.0, rel=0.005)
    assert massive.thickest.diameter_mm <= 10.0
    np.testing.assert_allclose(massive.thickest.place_mm, 0.0, atol=0.02)
    (warning,) = massive.findings
    assert (warning.severity, warning.what) == ("warning", "is massive")
    assert warning.remedy.startswith("shell it, or scale to a longest side of <= 4")
    # What lies within 45 degrees of straight down is a cap of (1 - cos 45) / 2 of a sphere.
    assert massive.overhang_share == pytest.approx((1.0 - np.sqrt(0.5)) / 2.0, abs=0.01)


def test_a_ring_has_a_handle_and_is_as_thick_as_its_tube():
    ring = certify(trimesh.creation.torus(8.0, 1.0, 64, 64), SILVER)
    assert ring.passes
    assert ring.genus == 1
    assert ring.wall_mm == pytest.approx(2.0, rel=0.01)
    assert ring.thickest.diameter_mm == pytest.approx(2.0, rel=0.01)
    assert np.hypot(*ring.thickest.place_mm[:2]) == pytest.approx(8.0, abs=0.05)


@pytest.mark.parametrize(("wall", "passes"), [(1.0, True), (0.78, True), (0.7, False)])
def test_the_wall_of_a_shell_passes_from_95_percent_of_the_materials(wall, passes):
    hollow = certify(shell(10.0, wall), SILVER)
    assert hollow.wall_mm == pytest.approx(wall, rel=0.02)
    assert hollow.wall_limit_mm == pytest.approx(WALL_TOLERANCE * 0.8) == pytest.approx(0.76)
    assert hollow.passes == passes
    assert hollow.thickest.diameter_mm == pytest.approx(wall, rel=0.02)


def test_the_hollow_of_a_shell_is_a_cavity_and_no_body():
    hollow = certify(shell(10.0, 1.0), SILVER)
    assert (hollow.n_bodies, hollow.n_cavities) == (1, 1)
    (cavity,) = hollow.cavities
    assert cavity.volume_mm3 == pytest.approx(4.0 / 3.0 * np.pi * 9.0**3, rel=0.01)
    assert found(hollow, "warning") == ["has 1 closed cavity"]
    assert "drain hole" in hollow.findings[0].remedy


def test_a_thin_plate_is_refused_with_the_place_and_what_would_pass():
    thin = certify(box((30.0, 20.0, 0.2), (100.0, 0.0, 7.0)), SILVER)
    assert found(thin) == ["is too thin", "is too flat"]
    assert thin.wall_mm == pytest.approx(0.2, abs=1e-3)
    (place,) = thin.thin_places
    np.testing.assert_allclose(place.place_mm, (100.0, 0.0, 7.0), atol=1.0)
    np.testing.assert_allclose(place.box_mm, (30.0, 20.0, 0.0), atol=0.5)
    assert place.thickness_mm == pytest.approx(0.2, abs=1e-3)
    assert thin.thickest.diameter_mm == pytest.approx(0.2, abs=1e-3)
    remedy = thin.findings[0].remedy
    assert remedy == "thicken by 0.56 mm, or scale to a longest side of >= 114 mm"
    scaled = certify(box(np.array((30.0, 20.0, 0.2)) * 114.0 / 30.0), SILVER)
    assert found(scaled) == ["is too flat"]


def test_only_the_thin_part_of_a_piece_is_named():
    flag = trimesh.boolean.union([box((10.0, 10.0, 3.0)), box((12.0, 10.0, 0.3), (8.0, 0.0, 0.0))])
    (place,) = certify(flag, SILVER).thin_places
    assert 5.0 < place.place_mm[0] < 14.0
    np.testing.assert_allclose(place.box_mm, (9.0, 10.0, 0.0), atol=0.3)


def test_two_bodies_are_counted_and_the_small_one_is_placed():
    both = certify(together(box((2.0, 2.0, 3.0), (11.0, 1.0, 2.0)), box((10.0, 10.0, 4.0))), SILVER)
    assert found(both) == ["falls into 2 bodies"]
    (finding,) = both.findings
    assert finding.where == (pytest.approx((11.0, 1.0, 2.0)),)
    assert "2 x 2 x 3 mm" in finding.how_much
    assert both.bodies[1].volume_mm3 == pytest.approx(12.0)


def test_a_body_that_lies_loose_in_a_hollow_is_a_body():
    rattle = certify(together(shell(10.0, 1.0), box((3.0, 3.0, 3.0))), SILVER)
    assert (rattle.n_bodies, rattle.n_cavities) == (2, 1)


@pytest.mark.parametrize("shape", [box((9.0, 3.0, 2.0)), shell(10.0, 1.0)], ids=["box", "shell"])
def test_inside_out_is_named_and_the_rest_is_measured_as_if_flipped(shape):
    right, wrong = certify(shape, SILVER), certify(inverted(shape), SILVER)
    assert found(wrong) == ["is inside out"]
    assert "flip" in wrong.findings[0].remedy
    assert wrong.wall_mm == pytest.approx(right.wall_mm, rel=1e-3)
    assert wrong.volume_mm3 == pytest.approx(right.volume_mm3)
    assert wrong.n_cavities == right.n_cavities


def test_one_of_two_bodies_inside_out_is_told_from_a_cavity():
    mixed = certify(together(box((10.0, 10.0, 3.0)), inverted(box((2.0, 2.0, 2.0), (20.0, 0.0, 0.0)))), SILVER)
    assert found(mixed) == ["has 1 body inside out", "falls into 2 bodies"]
    assert mixed.findings[0].where == (pytest.approx((20.0, 0.0, 0.0)),)


def test_a_hole_is_named_with_its_place():
    faces = np.delete(BALL.faces, 17, axis=0)
    hole = BALL.vertices[BALL.faces[17]].mean(axis=0)
    torn = certify(trimesh.Trimesh(BALL.vertices, faces, process=False), SILVER)
    assert found(torn) == ["is not closed"]
    assert np.linalg.norm(np.subtract(torn.findings[0].where[0], hole)) < 0.5
    assert torn.findings[0].how_much.startswith("3 edges")
    assert torn.volume_mm3 is None
    assert torn.grams is None


def test_a_turned_face_and_an_edge_of_three_faces_are_named():
    faces = BALL.faces.copy()
    faces[5] = faces[5][::-1]
    assert found(certify(trimesh.Trimesh(BALL.vertices, faces, process=False), SILVER)) == [
        "has faces turned the wrong way"
    ]
    fin = trimesh.Trimesh(
        np.vstack([BALL.vertices, [[9.0, 9.0, 9.0]]]), np.vstack([BALL.faces, [*BALL.faces[0, :2], len(BALL.vertices)]])
    )
    assert {"is not closed", "is not a manifold"} <= set(found(certify(fin, SILVER)))


def test_a_piece_in_metres_is_too_small_and_asked_for_its_unit():
    tiny = certify(box((0.03, 0.02, 0.01)), SILVER)
    assert {"is too flat", "is too small"} <= set(found(tiny))
    assert "is its unit mm?" in tiny.findings[-1].remedy


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (trimesh.Trimesh(), "no extent|0 faces"),
        (trimesh.Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False), "longest side of 0 mm"),
        (trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], process=False), "no area"),
        (trimesh.Trimesh([[0, 0, 0], [1, np.nan, 0], [0, 1, 0]], [[0, 1, 2]], process=False), "vertex 1 at .*nan"),
        (trimesh.Trimesh([[0, 0, 0], [1e30, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False), "1e\\+30 mm; at most"),
    ],
)
def test_what_cannot_be_measured_is_one_clear_line(mesh, message):
    with pytest.raises(InputError, match=message) as raised:
        certify(mesh, SILVER)
    assert "\n" not in str(raised.value)


def test_certificates_are_the_same_each_time_and_fit_for_json():
    first, second = (json.dumps(certify(shell(6.0, 0.5), SILVER).as_dict(), allow_nan=False) for _ in range(2))
    assert first == second


@settings(max_examples=15)
@given(sides=st.tuples(*[st.floats(0.3, 20.0)] * 3))
def test_the_thickness_of_any_box_is_its_smallest_side(sides):
    measured = certify(box(sides), SILVER)
    # Rays across the smallest side start on two of six faces, which are always more than 1 % of the surface.
    assert measured.wall_mm == pytest.approx(min(sides), rel=1e-3)
    assert measured.thickest.diameter_mm <= min(sides) * (1.0 + 1e-9)
    assert measured.thickest.diameter_mm >= min(sides) - measured.thickest.error_mm
    assert measured.volume_mm3 == pytest.approx(np.prod(sides))


@settings(max_examples=8)
@given(seed=st.integers(0, 2**31))
def test_a_turned_piece_has_the_same_certificate(seed):
    flag = trimesh.boolean.union([box((10.0, 10.0, 3.0)), box((12.0, 10.0, 0.3), (8.0, 0.0, 0.0))])
    turn = trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))
    turned = flag.copy().apply_transform(turn)
    before, after = certify(flag, SILVER), certify(turned, SILVER)
    assert found(before) == found(after) == ["is too thin"]
    assert after.wall_mm == pytest.approx(before.wall_mm, rel=1e-3)
    assert after.volume_mm3 == pytest.approx(before.volume_mm3, rel=1e-6)
    assert abs(after.thickest.diameter_mm - before.thickest.diameter_mm) <= before.thickest.error_mm
    moved = trimesh.transform_points([before.thin_places[0].place_mm], turn)[0]
    assert np.linalg.norm(moved - after.thin_places[0].place_mm) < 1.5


BAD = {
    "inside_out": (inverted(box((10.0, 10.0, 3.0))), "is inside out", "flip all faces"),
    "two_bodies": (
        together(box((10.0, 10.0, 3.0)), box((2.0, 2.0, 2.0), (20.0, 5.0, 0.0))),
        "falls into 2 bodies at (20.0, 5.0, 0.0) mm",
        "keep the largest alone",
    ),
    "thin_wall": (
        trimesh.boolean.union([box((10.0, 10.0, 3.0)), box((12.0, 10.0, 0.2), (8.0, 0.0, 0.0))]),
        "is too thin at (",
        "its wall is 0.20 mm at the 1 % quantile, silver needs 0.76 mm",
    ),
}


@pytest.mark.parametrize("form", ["stl", "ply", "obj", "glb", "3mf"])
@pytest.mark.parametrize("name", BAD)
def test_the_command_refuses_a_bad_mesh_and_says_what_is_wrong_and_where(name, form, tmp_path, capsys):
    from fractal_farm.solid.files import mesh_files

    mesh, what, more = BAD[name]
    path = tmp_path / f"{name}.{form}"
    mesh.metadata.clear()  # what trimesh keeps of a shape's making does not belong into a file
    path.write_bytes(mesh_files(mesh, (form,))[f"solid.{form}"])
    assert main(["certify", str(path), "--material", "silver"]) == 1
    out, err = capsys.readouterr()
    assert f"{path.name}: does not pass for silver" in out
    assert f"failure: {what}" in out
    assert more in out
    assert err == ""
    assert main(["certify", str(path), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["verdict"] == "fail"
    assert any(what.startswith(finding["what"]) for finding in report["findings"])


def test_the_command_writes_a_page_without_requests(tmp_path, capsys):
    path, page = tmp_path / "<b>.stl", tmp_path / "page.html"
    BAD["thin_wall"][0].export(path)
    assert main(["certify", str(path), "--page", str(page)]) == 1
    text = page.read_text()
    assert "<b>" not in text
    assert text.count("src='data:image/png;base64,") == 2
    assert "http" not in text
    assert "prefers-color-scheme: dark" in text
    assert "does not pass" in text


def test_the_command_passes_a_sound_mesh_and_refuses_nonsense_in_one_line(tmp_path, capsys):
    sound = tmp_path / "sound.stl"
    box((10.0, 10.0, 3.0)).export(sound)
    assert main(["certify", str(sound)]) == 0
    assert "sound.stl: passes for silver" in capsys.readouterr().out
    nothing = tmp_path / "nothing.stl"
    trimesh.Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False).export(nothing)
    for arguments in (
        [str(nothing)],
        [str(tmp_path / "missing.stl")],
        [str(tmp_path)],
        [str(sound), "--material", "mithril"],
        [str(sound), "--size", "20"],
    ):
        assert main(["certify", *arguments]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1
