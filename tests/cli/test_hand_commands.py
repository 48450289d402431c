"""`farm rate`, `preference`, `breed` and `keep` on the command line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from fractal_farm.catalogue import Catalogue
from fractal_farm.cli import main
from tests.cli.test_commands import output, result


@pytest.fixture
def directory(run_directory: Path, tmp_path: Path) -> Path:
    shutil.copytree(run_directory, tmp_path / "run")
    return tmp_path / "run"


@pytest.fixture
def ids(directory: Path) -> list[str]:
    found: list[str] = Catalogue.open(directory).designs(["design_id"]).column("design_id").to_pylist()
    return found


def test_judgements_are_listed_filtered_and_shown(
    capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str]
) -> None:
    assert "stars" not in output(capsys, "list", directory)
    output(capsys, "rate", directory, ids[0][:8], ids[1], "--stars", 4)
    output(capsys, "rate", directory, ids[2], "--favourite")
    output(capsys, "rate", directory, ids[3], "--favourite", "--stars", 2)
    assert result(capsys, "rate", directory, ids[3], "--reject") == [
        {"design_id": ids[3], "stars": 0, "favourite": False}
    ]
    header = output(capsys, "list", directory).splitlines()[0].split()
    assert header[-2:] == ["stars", "favourite"]
    liked = result(capsys, "list", directory, "--where", "stars >= 4 or favourite")
    assert {row["design_id"] for row in liked} == set(ids[:3])
    assert "4 stars" in output(capsys, "show", directory, ids[0])
    assert result(capsys, "show", directory, ids[2])["favourite"] is True
    output(capsys, "rate", directory, ids[0], "--clear")
    assert result(capsys, "show", directory, ids[0])["stars"] is None


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([], "--stars"),
        (["--stars", "3", "--reject"], "--reject"),
        (["--stars", "6"], "--stars"),
        (["--favourite", "--clear"], "--clear"),
    ],
)
def test_a_judgement_that_is_none_is_one_line(
    capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str], words: list[str], reason: str
) -> None:
    assert main(["rate", str(directory), ids[0], *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert reason in err
    assert not (directory / "runs/hand").exists()


def test_breeding_makes_a_catalogue_of_children(
    capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str]
) -> None:
    output(capsys, "rate", directory, *ids[:2], "--favourite")
    few = ["--set", "evolution.offspring=32", "--set", "evolution.islands=2", "--executor", "serial"]
    summary = result(capsys, "breed", directory, "--favourites", *few)
    assert summary["path"] == f"{directory}-bred"
    children = Catalogue.open(summary["path"]).designs(["operator", "parents"]).to_pylist()
    assert {parent for row in children for parent in row["parents"]} == set(ids[:2])
    assert main(["breed", str(directory), ids[0], *few, "--into"]) == 0
    assert len(Catalogue.open(directory).runs()) == 2


def test_a_brood_lies_beside_its_founders_wherever_one_stands(
    capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    inside = directory / "solids"
    for place, name in ((directory, "."), (inside, ".."), (directory.parent, "run")):
        monkeypatch.chdir(place)
        (directory.parent / "run-bred").write_text("taken")
        assert main(["breed", name, ids[0], "--executor", "serial"]) == 2
        assert "run-bred" in capsys.readouterr().err


def test_steering_an_ended_run_says_how_to_go_on(
    capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str]
) -> None:
    assert main(["breed", str(directory), ids[0], "--steer"]) == 0
    out, err = capsys.readouterr()
    assert ids[0] in out
    assert "2 to 11" in out
    assert "stop.epochs=12" in err
    assert f"breed from {ids[0][:8]}, too" in output(capsys, "status", directory)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([], "--favourites"),
        (["--favourites"], "no favourites"),
        (["ID", "--favourites"], "--favourites"),
        (["ID", "--steer", "--into"], "--into"),
        (["ID", "--into", "--out", "x"], "--out and --into"),
        (["ID", "--run", "abcd"], "--run"),
        (["ffffffff"], "no design ffffffff"),
    ],
)
def test_a_brood_that_cannot_be_is_one_line_and_leaves_nothing(
    capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str], words: list[str], reason: str
) -> None:
    before = sorted(directory.parent.rglob("*"))
    assert main(["breed", str(directory), *(ids[0] if word == "ID" else word for word in words)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert reason in err
    assert sorted(directory.parent.rglob("*")) == before


def test_a_variant_in_a_file_is_kept_as_a_child(
    capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str], tmp_path: Path
) -> None:
    genes = [row[:] for row in result(capsys, "show", directory, ids[0])["genes"]]
    genes[0][0] += 0.1
    (tmp_path / "variant.yaml").write_text(json.dumps({"genomes": {"turned": genes}}))
    (row,) = result(capsys, "keep", directory, tmp_path / "variant.yaml", "--parent", ids[0])
    assert row["parents"] == [ids[0]]
    assert "by hand" in output(capsys, "show", directory, row["design_id"])
    assert len(result(capsys, "list", directory, "--where", "run_id == 'hand'")) == 1
    assert main(["keep", str(directory), str(tmp_path / "variant.yaml")]) == 2


def test_a_preference_is_told_and_ranks(capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str]) -> None:
    rows = {row["design_id"]: row for row in result(capsys, "list", directory)}
    thickness = {identity: row["descriptor"][-2] for identity, row in rows.items()}
    flat_first = sorted(ids, key=lambda identity: thickness[identity])
    assert main(["preference", str(directory)]) == 2
    assert "30 short of the 30" in capsys.readouterr().err
    for number, identity in enumerate(flat_first[:40]):
        output(capsys, "rate", directory, identity, "--stars", 5 - number // 7)
    told = result(capsys, "preference", directory)
    assert told["judged"] == 40
    assert told["accuracy"]["low"] > 0.5
    assert "less thickness" in output(capsys, "preference", directory)
    ranked = result(capsys, "list", directory, "--sort", "preference")
    assert [row["preference"] for row in ranked] == sorted((row["preference"] for row in ranked), reverse=True)
    assert result(capsys, "list", directory, "--where", "preference > 4", "--limit", 1)


def test_a_symmetric_child_of_a_design_is_kept_shown_found_compared_and_reproduced(
    capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str]
) -> None:
    assert "symmetry" not in output(capsys, "list", directory)
    (row,) = result(capsys, "keep", directory, ids[0][:8], "--symmetry", "rotation:6")
    assert (row["symmetry"], row["operator"], row["parents"]) == ("rotation:6", "symmetry", [ids[0]])
    child = row["design_id"]
    assert "rotation:6" in output(capsys, "show", directory, child)
    assert "rotation:6" in output(capsys, "list", directory)
    assert "rotation:6" in output(capsys, "lineage", directory, child)
    assert "rotation:6 and none" in output(capsys, "diff", directory, child, ids[0])
    found = result(capsys, "list", directory, "--where", "symmetry == 'rotation:6'")
    assert [entry["design_id"] for entry in found] == [child]
    assert main(["reproduce", str(directory), child]) == 0
    capsys.readouterr()
    assert main(["keep", str(directory), ids[0], "--symmetry", "rotation:1"]) == 2
    assert "--symmetry: symmetry is 'rotation:1'; allowed: none, rotation:2" in capsys.readouterr().err


def test_a_genome_file_may_ask_for_a_symmetry(
    capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str], tmp_path: Path
) -> None:
    genes = result(capsys, "show", directory, ids[0])["genes"]
    path = tmp_path / "symmetric.yaml"
    path.write_text(json.dumps({"genomes": {"star": {"genes": genes, "symmetry": "dihedral:5"}, "plain": genes}}))
    assert [entry["symmetry"] for entry in result(capsys, "score", path)] == ["dihedral:5", "none"]
    path.write_text(json.dumps({"genomes": {"star": {"genes": genes, "symmetry": "spiral"}}}))
    assert main(["score", str(path)]) == 2
    error = capsys.readouterr().err
    assert "genome star: symmetry is 'spiral'; allowed: none" in error
    assert error.count("\n") == 1


def test_designs_bred_from_a_symmetric_one_are_symmetric(
    capsys: pytest.CaptureFixture[str], directory: Path, ids: list[str], tmp_path: Path
) -> None:
    (row,) = result(capsys, "keep", directory, ids[0], "--symmetry", "mirror")
    bred = tmp_path / "bred"
    arguments = ["breed", str(directory), row["design_id"], "--out", str(bred), "--executor", "serial"]
    assert main([*arguments, "--set", "evolution.islands=1", "--set", "evolution.offspring=64"]) == 0
    capsys.readouterr()
    children = result(capsys, "list", bred)
    assert len(children) > 1
    assert {child["symmetry"] for child in children} == {"mirror"}
