"""Other people's programs open our files: PrusaSlicer, admesh, gltf-validator, lib3mf.

Without a program the tests are skipped; where CI is set, they fail.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fractal_farm.ifs.genome import Genome
from fractal_farm.solid import SolidParameters, solid_files
from tests.table1 import TABLE1

pytestmark = pytest.mark.slow

GENOMES = {name: Genome(np.array(genes)) for name, genes in TABLE1.items()}
# Smallest and largest that a shop would cast, coarse enough that twenty files take two minutes.
SIZES = {"pendant": SolidParameters(30.0, 1.0, 90), "desk object": SolidParameters(80.0, 3.0, 80)}
VALIDATE = """
const validator = require(process.env.GLTF_VALIDATOR || 'gltf-validator');
const bytes = new Uint8Array(require('fs').readFileSync(process.argv[1]));
validator.validateBytes(bytes).then((report) => console.log(JSON.stringify(report.issues)));
"""


def needed(program: str) -> str:
    """Where a program is; no test without it."""
    return shutil.which(program) or absent(program)


def absent(program: str) -> str:
    if os.environ.get("CI"):
        pytest.fail(f"{program} is not installed, and CI is set")
    pytest.skip(f"{program} is not installed")


def said(*command: str | Path) -> str:
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def solids(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Directories with the files of five designs in two sizes."""
    directory = tmp_path_factory.mktemp("solids")
    mirrored = GENOMES["06425"].genes * [1, -1, 1, 1, 1, -1, 1]
    designs = {**GENOMES, "mirrored": Genome(mirrored)}
    made = {}
    for name, genome in designs.items():
        for purpose, parameters in SIZES.items():
            place = directory / f"{name} {purpose}"
            place.mkdir()
            for file, content in solid_files(genome, parameters, ("glb", "3mf", "stl")).items():
                (place / file).write_bytes(content)
            made[place.name] = place
    return made


@pytest.fixture(scope="module")
def torn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A box without one of its triangles."""
    box = trimesh.creation.box((20.0, 20.0, 20.0))
    box.update_faces(np.arange(len(box.faces)) > 0)
    path = tmp_path_factory.mktemp("torn") / "torn.stl"
    path.write_bytes(box.export(file_type="stl"))
    return path


def slicer_finds(path: Path) -> str:
    """What PrusaSlicer says about a mesh as it reads it."""
    return said(needed("prusa-slicer"), "--info", path)


def test_prusa_slicer_slices_twenty_files_and_repairs_none(solids: dict[str, Path], tmp_path: Path) -> None:
    slicer = needed("prusa-slicer")
    files = [place / f"solid.{form}" for place in solids.values() for form in ("stl", "3mf")]
    assert len(files) == 20
    for number, file in enumerate(files):
        facts = json.loads((file.parent / "solid.json").read_text())
        found = slicer_finds(file)
        assert "manifold = yes" in found, file
        assert "number_of_parts =  1\n" in found, file
        assert not re.search("repair|open_edges|degenerate|backwards|reversed", found), found
        size = [float(re.search(rf"size_{axis} = ([\d.]+)", found)[1]) for axis in "xyz"]
        np.testing.assert_allclose(size, facts["box_mm"], rtol=1e-4)
        assert float(re.search(r"\bvolume = ([\d.]+)", found)[1]) == pytest.approx(facts["volume_mm3"], rel=1e-3)
        layers = tmp_path / f"{number}.gcode"
        log = said(slicer, "--export-gcode", "--layer-height", "0.3", "--support-material", "--output", layers, file)
        assert not re.search("repair|manifold|open edge|empty layer", log, re.IGNORECASE), log
        assert layers.read_text().count(";LAYER_CHANGE") > facts["box_mm"][2] / 0.6


def test_prusa_slicer_would_tell_of_a_torn_mesh(torn: Path) -> None:
    assert "manifold = no" in slicer_finds(torn)


def admesh_finds(path: Path) -> dict[str, int]:
    """What admesh had to do, from its table."""
    report = said(needed("admesh"), path)
    return {
        name: int(re.search(rf"{name}\s*:\s*(\d+)", report)[1])
        for name in (
            "Total disconnected facets",
            "Degenerate facets",
            "Edges fixed",
            "Facets removed",
            "Facets added",
            "Facets reversed",
            "Backwards edges",
            "Normals fixed",
        )
    }


def test_admesh_finds_nothing_to_fix(solids: dict[str, Path]) -> None:
    for name, place in solids.items():
        assert set(admesh_finds(place / "solid.stl").values()) == {0}, name


def test_admesh_would_tell_of_a_torn_mesh(torn: Path) -> None:
    assert any(admesh_finds(torn).values())


def validated(path: Path) -> dict[str, int]:
    node = needed("node")
    done = subprocess.run([node, "-e", VALIDATE, str(path)], capture_output=True, text=True, timeout=120, check=False)
    if "Cannot find module" in done.stderr:
        absent("gltf-validator")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_gltf_validator_reports_no_errors_and_no_warnings(solids: dict[str, Path]) -> None:
    for place in solids.values():
        issues = validated(place / "solid.glb")
        assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


def test_gltf_validator_would_tell_of_an_error(solids: dict[str, Path], tmp_path: Path) -> None:
    content = next(iter(solids.values())).joinpath("solid.glb").read_bytes()
    (tmp_path / "wrong.glb").write_bytes(content.replace(b'"VEC3"', b'"VEC2"'))
    assert validated(tmp_path / "wrong.glb")["numErrors"] > 0


def test_lib3mf_reads_units_metadata_and_mesh_without_a_warning(solids: dict[str, Path]) -> None:
    try:
        import lib3mf
    except ImportError:
        absent("lib3mf")
    for place in solids.values():
        facts = json.loads((place / "solid.json").read_text())
        model = lib3mf.get_wrapper().CreateModel()
        reader = model.QueryReader("3mf")
        reader.SetStrictModeActive(True)
        reader.ReadFromFile(str(place / "solid.3mf"))
        assert reader.GetWarningCount() == 0, reader.GetWarning(0)
        assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
        group = model.GetMetaDataGroup()
        told = {
            (entry.GetNameSpace(), entry.GetName()): entry.GetValue()
            for entry in map(group.GetMetaData, range(group.GetMetaDataCount()))
        }
        assert facts["design_code"] in told["", "Title"]
        assert facts["design_id"] in told["", "Description"]
        assert {"Designer", "Application"} <= {name for _, name in told}
        (ours,) = (value for (space, _), value in told.items() if space)
        assert json.loads(ours) == facts
        objects = model.GetMeshObjects()
        assert objects.MoveNext()
        mesh = objects.GetCurrentMeshObject()
        assert (mesh.GetVertexCount(), mesh.GetTriangleCount()) == (facts["vertices"], facts["faces"])
        assert mesh.IsManifoldAndOriented()
        box = model.GetOutbox()
        size = np.subtract(list(box.MaxCoordinate), list(box.MinCoordinate))
        np.testing.assert_allclose(size, facts["box_mm"], rtol=1e-5)
