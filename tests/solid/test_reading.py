import contextlib
import io
import json
import struct
import zipfile

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fractal_farm.errors import InputError
from fractal_farm.ifs.design_code import design_code
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.solid import FORMATS, SolidParameters
from fractal_farm.solid.files import mesh_files
from fractal_farm.solid.pipeline import make_solid
from fractal_farm.solid.reading import genome_of_facts, read_facts, read_mesh
from tests.table1 import TABLE1

GENOME = Genome(
    np.array(TABLE1["06582"]) + 1e-16,
    Phenotype(influence=3.7, map_form="rho R x + d", rotation_sign=-1),
    (0.1, 0.2, 0.7)[: len(TABLE1["06582"])] if len(TABLE1["06582"]) == 3 else None,
    "rotation:3",
)
QUIRKY = {"licence": "CC-BY-4.0", "remark": "two  spaces, <&\"'> and \N{GREEK SMALL LETTER RHO}\n" + " " * 450 + "end"}
CARRIERS = [name for name in FORMATS if name != "stl"]
FORM = st.sampled_from(FORMATS)


@pytest.fixture(scope="module")
def solid():
    return make_solid(GENOME, SolidParameters(wall_mm=1.5, resolution=64))


@pytest.fixture(scope="module")
def files(solid):
    return mesh_files(solid, FORMATS, QUIRKY)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("files")


@pytest.fixture
def read(place):
    def read_content(name, content):
        path = place / f"solid.{name}"
        path.write_bytes(content)
        return read_mesh(path)

    return read_content


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_comes_back_in_mm_and_z_up(solid, files, read, name):
    mesh = read(name, files[f"solid.{name}"])
    assert mesh.is_watertight
    assert len(mesh.faces) == len(solid.faces)
    assert mesh.volume == pytest.approx(solid.volume, rel=1e-5)
    np.testing.assert_allclose(mesh.bounds, solid.bounds, atol=1e-5)
    file = mesh.metadata["file"]
    assert file["format"] == name
    assert (file["unit_mm"], file["up"]) == ((1000.0, "y") if name == "glb" else (1.0, "z"))
    np.testing.assert_allclose(sorted(np.array(file["size"]) * file["unit_mm"]), sorted(solid.extents), rtol=1e-5)


@pytest.mark.parametrize("name", CARRIERS)
def test_every_format_but_stl_rebuilds_the_genome_to_the_bit(files, read, name):
    facts = read(name, files[f"solid.{name}"]).metadata
    genome = genome_of_facts(facts)
    assert genome == GENOME
    assert (genome.genes == GENOME.genes).all()
    assert (genome.phenotype, genome.symmetry) == (GENOME.phenotype, GENOME.symmetry)
    assert genome.probabilities == GENOME.probabilities
    sidecar = json.loads(files["solid.json"])
    assert {key: facts[key] for key in sidecar if key not in ("units", "up")} == {
        key: sidecar[key] for key in sidecar if key not in ("units", "up")
    }
    assert (facts["licence"], facts["remark"]) == (QUIRKY["licence"], QUIRKY["remark"])
    assert facts["design_code"] == design_code(GENOME.design_id)


def test_stl_names_its_design_and_no_genome(files, read):
    facts = read("stl", files["solid.stl"]).metadata
    assert facts["design_id"] == GENOME.design_id
    assert genome_of_facts(facts) is None
    assert design_code(GENOME.design_id).encode() in files["solid.stl"][:80]


def test_files_have_the_same_bytes_whenever_they_are_written(solid, files):
    assert mesh_files(solid, FORMATS, QUIRKY) == files


@pytest.mark.parametrize("name", ["ply", "obj"])
def test_no_comment_line_is_too_long_for_other_readers(files, name):
    head = files[f"solid.{name}"].partition(b"end_header" if name == "ply" else b"\nv ")[0]
    assert max(map(len, head.splitlines())) < 256


def test_an_altered_genome_is_named(files):
    facts = json.loads(files["solid.json"])
    facts["genome"][0][0] += 1e-9
    with pytest.raises(InputError, match="altered"):
        genome_of_facts(facts)


@given(FORM, st.binary(max_size=4096))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=200)
def test_random_bytes_are_refused_in_one_line(read, name, content):
    with pytest.raises(InputError) as caught:
        read(name, content)
    assert "\n" not in str(caught.value)


@given(FORM, st.floats(0, 1, exclude_max=True))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=100)
def test_files_that_were_cut_short_are_refused(files, read, name, share):
    content = files[f"solid.{name}"]
    part = content[: int(len(content) * share)]
    # A text has no end mark: what is left of an OBJ may be a mesh.
    with contextlib.suppress(InputError) if name == "obj" else pytest.raises(InputError):
        read(name, part)


@given(FORM, st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.binary(min_size=1, max_size=4)), min_size=1))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=150)
def test_changed_bytes_give_a_mesh_or_one_line(files, read, name, changes):
    content = bytearray(files[f"solid.{name}"])
    for share, new in changes:
        # The first kilobytes are what steers a parser.
        at = int(len(content) * share**4)
        content[at : at + len(new)] = new
    with contextlib.suppress(InputError):
        mesh = read(name, bytes(content))
        assert np.isfinite(mesh.vertices).all()


def model_of(body):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", body)
    return buffer.getvalue()


def glb_of(tree, binary=b""):
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def triangle_glb(count=3, **more):
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": count}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
        **more,
    }


PLY = "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
PLY += "element face {}\nproperty list uchar int vertex_indices\nend_header\n"
BOMB = '<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb">]><model>&b;</model>'


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("stl", b" " * 80 + struct.pack("<I", 2**32 - 1) + b" " * 50, "4294967295 faces"),
        ("ply", PLY.format(10**15, 1).encode() + b"\0" * 64, "vertices, more than"),
        ("ply", PLY.format(3, 10**7).encode() + b"\0" * 64, "at least"),
        ("glb", glb_of(triangle_glb(10**9), b"\0" * 36), "longer than its bytes"),
        ("glb", glb_of(triangle_glb(nodes=[{"mesh": 0, "children": [0]}]), b"\0" * 36), "no tree"),
        ("glb", glb_of(triangle_glb(buffers=[{"byteLength": 36, "uri": "/etc/passwd"}]), b"\0" * 36), "another file"),
        ("glb", glb_of(triangle_glb(extensionsRequired=["KHR_draco_mesh_compression"])), "draco"),
        ("glb", glb_of(triangle_glb(accessors=[{"componentType": 5126, "type": "VEC3", "count": 9**9}])), "no bytes"),
        ("3mf", model_of(BOMB), "document type"),
        ("3mf", model_of('<model unit="furlong"/>'), "furlong"),
        ("3mf", model_of("<model><vertices>"), "not XML"),
        ("3mf", model_of("<model>" + " " * (1 << 29) + "</model>"), "512 MiB"),
        ("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "OBJ"),
        ("obj", b"v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", "OBJ"),
    ],
)
def test_what_would_fill_the_memory_or_lead_elsewhere_is_refused(read, name, content, words):
    with pytest.raises(InputError, match=words) as caught:
        read(name, content)
    assert "\n" not in str(caught.value)


def test_objects_that_are_built_of_each_other_without_end_are_refused(read):
    objects = '<object id="1"><components><component objectid="1"/><component objectid="1"/></components></object>'
    model = f'<model><resources>{objects}</resources><build><item objectid="1"/></build></model>'
    with pytest.raises(InputError, match="more than 10000 objects"):
        read("3mf", model_of(model))


def test_units_and_transforms_of_other_programs_are_obeyed(read):
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in box.vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in box.faces)
    mesh = f"<mesh><vertices>{corners}</vertices><triangles>{faces}</triangles></mesh>"
    outer = '<component objectid="1" transform="2 0 0 0 1 0 0 0 1 5 0 0"/>'
    resources = f'<object id="1">{mesh}</object><object id="2"><components>{outer}</components></object>'
    build = '<item objectid="2" transform="0 1 0 -1 0 0 0 0 1 0 0 0"/>'
    model = f'<model unit="inch"><resources>{resources}</resources><build>{build}</build></model>'
    found = read("3mf", model_of(model))
    # Twice as wide, moved by 5 along x, then turned by 90 degrees about z.
    np.testing.assert_allclose(found.bounds, 25.4 * np.array([[-1, 4, -1.5], [1, 6, 1.5]]), atol=1e-9)
    assert found.is_watertight
    assert found.volume == pytest.approx(25.4**3 * 12)


@pytest.mark.parametrize("name", ["glb", "ply", "obj", "stl", "stl_ascii", "3mf"])
def test_meshes_that_trimesh_wrote_are_read_as_they_are(read, name):
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=10.0).apply_translation((1.0, 2.0, 3.0))
    content = sphere.export(file_type=name)
    found = read(name.partition("_")[0], content if isinstance(content, bytes) else content.encode())
    assert found.is_watertight
    scale = 1000.0 if name == "glb" else 1.0
    assert found.volume == pytest.approx(scale**3 * sphere.volume, rel=1e-5)
    centre = [1.0, -3.0, 2.0] if name == "glb" else [1.0, 2.0, 3.0]
    np.testing.assert_allclose(found.center_mass / scale, centre, rtol=1e-4)


@pytest.mark.parametrize("name", ["missing.stl", "empty.glb", "directory.ply", "notes.txt"])
def test_what_is_no_mesh_file_is_named(tmp_path, name):
    (tmp_path / "empty.glb").touch()
    (tmp_path / "directory.ply").mkdir()
    (tmp_path / "notes.txt").write_text("notes")
    with pytest.raises(InputError, match=name):
        read_mesh(tmp_path / name)


def test_a_huge_file_is_refused_before_it_is_read(tmp_path):
    with (tmp_path / "huge.stl").open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(InputError, match="larger than 512 MiB"):
        read_mesh(tmp_path / "huge.stl")


@given(st.binary(max_size=300))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_facts_of_random_bytes_are_refused(place, content):
    (place / "solid.json").write_bytes(content)
    with contextlib.suppress(InputError):
        assert read_facts(place / "solid.json") == {}


@pytest.mark.parametrize("content", ["[" * 100_000, '{"a":' * 40 + "1" + "}" * 40, "[1]", '{"a": "\\ud800"}', "{1}"])
def test_facts_that_cannot_be_handed_on_are_refused(tmp_path, content):
    (tmp_path / "solid.json").write_text(content)
    with pytest.raises(InputError):
        read_facts(tmp_path / "solid.json")
