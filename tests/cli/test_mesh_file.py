import json

import pytest

from fractal_farm.cli import main
from fractal_farm.ifs.design_code import design_code
from tests.cli.test_commands import output, result


@pytest.fixture(scope="module")
def meshed(run_directory, tmp_path_factory):
    """A design of the small run in all formats, and its id."""
    catalogue = json.loads(next((run_directory / "solids").glob("*/*/solid.json")).read_text())
    identity = catalogue["design_id"]
    to = tmp_path_factory.mktemp("meshed")
    formats = [word for name in ("glb", "3mf", "stl", "ply", "obj") for word in ("--format", name)]
    code = design_code(identity)
    arguments = ["mesh", str(run_directory), code, "-o", str(to), "--wall", "1.2", "--resolution", "80", *formats]
    assert main([*arguments, "--licence", "CC-BY-4.0"]) == 0
    return to, identity


@pytest.mark.parametrize("form", ["glb", "3mf", "ply", "obj"])
def test_a_file_says_what_it_is_and_carries(capsys, run_directory, meshed, form):
    to, identity = meshed
    page = output(capsys, "show", to / f"{identity}.{form}")
    for words in (identity, design_code(identity), "CC-BY-4.0", "resolution 80", form.upper(), "Fractal Farm"):
        assert words in page
    told = result(capsys, "show", to / f"{identity}.{form}")
    stored = result(capsys, "show", run_directory, design_code(identity))
    assert told["carries"]["genome"] == stored["genes"]
    assert told["bodies"] == 1
    assert max(told["box_mm"]) == pytest.approx(30.0, rel=1e-5)


def test_stl_and_sidecar_are_shown_too(capsys, meshed):
    to, identity = meshed
    assert design_code(identity) in output(capsys, "show", to / f"{identity}.stl")
    assert "CC-BY-4.0" in output(capsys, "show", to / f"{identity}.json")


def test_a_code_finds_its_design_and_a_slip_in_it_is_named(capsys, run_directory, meshed):
    _, identity = meshed
    for groups in (2, 3, 6):
        code = design_code(identity, groups)
        assert result(capsys, "show", run_directory, code.lower())["design_id"] == identity
    assert design_code(identity) in output(capsys, "show", run_directory, identity)
    code = design_code(identity)
    wrong = code[:-1] + ("0" if code[-1] != "0" else "1")
    assert main(["show", str(run_directory), wrong]) == 2
    told = capsys.readouterr().err
    assert "check character" in told
    assert told.count("\n") == 1


@pytest.mark.parametrize("name", ["torn.glb", "empty.3mf", "missing.stl", "noise.ply", "facts.json", "notes.txt", "."])
def test_what_cannot_be_shown_is_one_line_and_exit_code_2(capsys, tmp_path, meshed, name):
    to, identity = meshed
    (tmp_path / "torn.glb").write_bytes((to / f"{identity}.glb").read_bytes()[:-99])
    (tmp_path / "empty.3mf").touch()
    (tmp_path / "noise.ply").write_bytes(bytes(range(256)) * 9)
    (tmp_path / "facts.json").write_text("{")
    (tmp_path / "notes.txt").write_text("notes")
    assert main(["show", str(tmp_path / name)]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith("farm: error: ")
    assert told.err.count("\n") == 1


def test_what_somebody_wrote_into_a_file_cannot_steer_the_terminal(capsys, tmp_path):
    (tmp_path / "solid.json").write_text(json.dumps({"licence": "\x1b[2J\x9b2J free", "software": "\u202eevil"}))
    page = output(capsys, "show", tmp_path / "solid.json")
    assert not set("\x1b\x9b\u202e") & set(page)
    assert "free" in page


def test_a_file_needs_no_design(capsys, meshed):
    to, identity = meshed
    assert main(["show", str(to / f"{identity}.stl"), identity]) == 2
    assert "is a file" in capsys.readouterr().err


def test_the_papers_grid_is_how_fine_a_mesh_is(capsys, tmp_path, run_directory, meshed):
    _, identity = meshed
    arguments = ["mesh", str(run_directory), identity, "-o", str(tmp_path), "--grid", "85x199x144"]
    assert main([*arguments, "--json", "--format", "stl"]) == 0
    told = capsys.readouterr()
    [facts] = json.loads(told.out)
    assert round(max(facts["box_mm"]) / facts["voxel_mm"]) == 199
    assert "its grid is" in told.err
    assert main([*arguments, "--resolution", "80"]) == 2


def test_a_grid_and_a_resolution_contradict_each_other(capsys, tmp_path):
    arguments = ["mesh", str(tmp_path), "abcd", "-o", str(tmp_path / "meshes"), "--grid"]
    assert main([*arguments, "J0698", "--resolution", "90"]) == 2
    assert "leave out --resolution 90" in capsys.readouterr().err
    assert main([*arguments, "J1"]) == 2
    assert "J0698, J0619" in capsys.readouterr().err
