import io
import json
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome
from fractal_farm.solid import FORMATS, SolidParameters, solid_files
from tests.table1 import TABLE1

GENOME = Genome(np.array(TABLE1["06447"]))


@pytest.fixture(scope="module")
def files():
    return solid_files(GENOME, SolidParameters(resolution=120), FORMATS, {"fitness": 0.78, "volume_mm3": "a lie"})


@pytest.fixture(scope="module")
def facts(files):
    return json.loads(files["solid.json"])


def load(files, name):
    return trimesh.load_scene(io.BytesIO(files[f"solid.{name}"]), file_type=name)


def test_there_is_a_file_for_each_format_and_a_sidecar(files):
    assert set(files) == {*(f"solid.{name}" for name in FORMATS), "solid.json"}
    assert set(solid_files(GENOME, SolidParameters(resolution=120), ("STL",))) == {"solid.stl", "solid.json"}


@pytest.mark.parametrize("name", FORMATS)
def test_every_file_loads_as_the_same_watertight_body(files, facts, name):
    mesh = load(files, name).to_mesh()
    scale = 1000.0 if name == "glb" else 1.0
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert mesh.volume * scale**3 == pytest.approx(facts["volume_mm3"], rel=1e-3)
    np.testing.assert_allclose(sorted(mesh.extents * scale), sorted(facts["box_mm"]), rtol=1e-4)


def test_glb_is_y_up_and_in_metres_and_stl_is_z_up_and_in_millimetres(files, facts):
    width, depth, height = facts["box_mm"]
    np.testing.assert_allclose(1000 * load(files, "glb").to_mesh().extents, [width, height, depth], rtol=1e-4)
    np.testing.assert_allclose(load(files, "stl").to_mesh().extents, [width, depth, height], rtol=1e-4)
    assert width < depth < height


def test_the_genome_is_read_back_from_the_glb(files):
    (mesh,) = load(files, "glb").geometry.values()
    assert mesh.metadata["genome"] == TABLE1["06447"]
    assert mesh.metadata["design_id"] == GENOME.design_id
    assert mesh.metadata["units"] == "m"
    assert mesh.metadata["fitness"] == 0.78
    assert (mesh.metadata["size_mm"], mesh.metadata["wall_mm"]) == (30.0, 0.8)
    assert mesh.visual.material.metallicFactor == 1.0


def test_stl_and_ply_name_the_design_in_their_header(files):
    assert GENOME.design_id.encode() in files["solid.stl"][:80]
    assert GENOME.design_id.encode() in files["solid.ply"].partition(b"end_header")[0]


def test_the_sidecar_says_what_was_asked_for_and_what_was_measured(facts):
    assert facts["genome"] == TABLE1["06447"]
    assert facts["parameters"] == {"size_mm": 30.0, "wall_mm": 0.8, "resolution": 120, "thicken": True}
    assert facts["parameters_hash"] == SolidParameters(resolution=120).hash
    assert facts["watertight"]
    assert facts["bodies"] == 1
    assert facts["units"] == "mm"
    assert facts["fitness"] == 0.78
    assert facts["volume_mm3"] > 10
    assert 0.76 < facts["wall_measured_mm"] < 1.2


def test_an_unknown_format_is_refused_before_any_work():
    with pytest.raises(InputError, match=r"'step'.*glb, 3mf, stl, ply, obj"):
        solid_files(GENOME, formats=("glb", "step"))


def test_importing_the_package_imports_no_mesh_library():
    code = "import sys, fractal_farm.solid, fractal_farm.picture; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "fractal_farm.solid" in done.stdout.split()
    assert not {"trimesh", "numba", "skimage", "PIL"} & set(done.stdout.split())
