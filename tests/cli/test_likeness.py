"""`farm similar`, `prototypes`, `diff` and `reproduce` on a real catalogue, and on one whose numbers were changed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from PIL import Image

from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.layout import DESIGNS
from fractal_farm.catalogue.parts import encoded_part, list_parts, read_commits, read_rows
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.cli import main
from fractal_farm.distinctness import signatures
from fractal_farm.fitness import evaluate
from fractal_farm.ifs.genome import GENE_NAMES
from tests.cli.conftest import CONFIGS
from tests.cli.test_commands import best, output, result


def test_similar_lists_the_nearest_by_signature(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    table = Catalogue.open(run_directory).designs()
    marks = signatures(
        np.array(table.column("descriptor").to_pylist()), table.column("d0").to_numpy(), table.column("d2").to_numpy()
    )
    ids = table.column("design_id").to_pylist()
    apart = np.linalg.norm(marks - marks[0], axis=1)
    nearest = np.argsort(apart)[1:6]
    (answer,) = result(capsys, "similar", run_directory, ids[0], "-k", "5")
    assert answer["asked"] == ids[0]
    assert {hit["design_id"] for hit in answer["similar"]} == {ids[place] for place in nearest}
    for hit in answer["similar"]:
        assert hit["distance"] == pytest.approx(apart[ids.index(hit["design_id"])], abs=1e-4)
    aligned = [hit["aligned_distance"] for hit in answer["similar"]]
    assert aligned == sorted(aligned)
    assert output(capsys, "similar", run_directory, ids[0], "-k", "5").count("\n") == 7


def test_similar_takes_genomes_of_a_file(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    shown = result(capsys, "show", run_directory, best(run_directory)["design_id"])
    (tmp_path / "mine.yaml").write_text(json.dumps({"genomes": {"mine": shown["genes"]}}))
    (answer,) = result(capsys, "similar", run_directory, "--genome", tmp_path / "mine.yaml", "-k", "2")
    assert answer["asked"] == "mine"
    assert answer["similar"][0]["design_id"] == shown["design_id"]
    assert answer["similar"][0]["same_shape"]
    assert len(result(capsys, "similar", run_directory, "--genome", CONFIGS / "table1.yaml", "-k", "1")) == 4


def test_prototypes_stand_for_all_and_are_drawn(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    count = Catalogue.open(run_directory).designs().num_rows
    rows = result(capsys, "prototypes", run_directory, "-k", "9", "--sheet", tmp_path / "sheet.png")
    assert len(rows) == min(9, count)
    assert sum(row["designs"] for row in rows) == count
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.size == (8 * 234 + 10, 2 * 262 + 10)
    assert output(capsys, "prototypes", run_directory, "-k", "9").count("\n") == 1 + len(rows)


def test_diff_shows_what_a_child_inherited(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    table = Catalogue.open(run_directory).designs(ancestors=True).to_pylist()
    rows = {row["design_id"]: row for row in table}
    child = next(row for row in table if row["operator"] == "mutation" and row["parents"][0] in rows)
    parent = rows[child["parents"][0]]
    facts = result(
        capsys, "diff", run_directory, child["design_id"], parent["design_id"], "--picture", tmp_path / "two.png"
    )
    assert facts["common_ancestor"] == [parent["design_id"], 1, 0]
    assert facts["numbers"] == list(GENE_NAMES)
    assert len(facts["maps"]) == child["n_maps"] == parent["n_maps"]
    for side, row in enumerate((child, parent)):
        genes = np.reshape(row["genes"], (-1, 7)).tolist()
        assert sorted(pair[side][1:] for pair in facts["maps"]) == sorted(genes)
        again = evaluate([np.array(genes)], repeats=20)
        fitness = next(score for score in facts["scores"] if score["name"] == "fitness")
        assert fitness["recorded"][side] == row["fitness"]
        assert fitness["means"][side] == pytest.approx(again.fitness[0])
        assert fitness["errors"][side] == pytest.approx(again.fitness_error[0])
    with Image.open(tmp_path / "two.png") as picture:
        assert picture.width > picture.height
    text = output(capsys, "diff", run_directory, child["design_id"], parent["design_id"])
    assert "common ancestor" in text


def test_a_design_is_not_different_from_itself(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    own = best(run_directory)["design_id"]
    facts = result(capsys, "diff", run_directory, own, own)
    assert facts["distance"] == 0.0
    assert facts["aligned_distance"] == pytest.approx(0.0, abs=1e-9)
    assert all(one == two for one, two in facts["maps"])
    assert facts["common_ancestor"] == [own, 0, 0]


def test_every_design_is_reproduced_to_the_bit(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    table = Catalogue.open(run_directory).designs(["design_id", "kind"], ancestors=True).to_pylist()
    for row in [*table[:3], *(row for row in table if row["kind"] == "ancestor")][:5]:
        facts = result(capsys, "reproduce", run_directory, row["design_id"])
        assert facts["same"]
        names = {quantity["name"] for quantity in facts["quantities"]}
        assert {"fitness", "d0", "d2", "lle", "maps"} <= names
        assert ("stored points" in names) == (row["kind"] == "design")


def changed(source: Path, target: Path, column: str, change: Any) -> str:
    """A copy of a catalogue with one value of its best design changed, and all checksums right; the design."""
    shutil.copytree(source, target)
    identity: str = best(source)["design_id"]
    for part in list_parts(target):
        table = read_rows(target, part, DESIGN_SCHEMA.names)
        rows = table.to_pylist()
        for row in rows:
            if row["design_id"] == identity:
                row[column] = change(row[column])
        (commit,) = read_commits(target, part)
        name, content = encoded_part(pa.Table.from_pylist(rows, DESIGN_SCHEMA), part.writer, commit)
        (target / DESIGNS / part.file_name).unlink()
        (target / DESIGNS / name.file_name).write_bytes(content)
    return identity


@pytest.mark.parametrize(
    ("column", "change"),
    [("fitness", lambda value: np.nextafter(value, 1)), ("cloud_crc32c", lambda value: value ^ 1)],
)
def test_one_changed_bit_is_told(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path, column: str, change: Any
) -> None:
    identity = changed(run_directory, tmp_path / "copy", column, change)
    assert main(["reproduce", str(tmp_path / "copy"), identity]) == 1
    out, err = capsys.readouterr()
    assert [line.split()[0] for line in out.splitlines() if line.endswith("no")] == [column]
    assert f"{identity}: {column} " in err


def test_list_can_be_asked_for_ancestors(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    rows = result(capsys, "list", run_directory, "--ancestors", "--where", "kind == 'ancestor'")
    table = Catalogue.open(run_directory).designs(["design_id", "kind"], ancestors=True).to_pylist()
    assert len(rows) == sum(row["kind"] == "ancestor" for row in table) > 0


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["similar"], "give an ID or --genome FILE"),
        (["similar", "00000000"], "no design 00000000"),
        (["similar", "--genome", "missing.yaml"], "no such file"),
        (["prototypes", "--sheet", "sheet.jpg"], "ends in .png"),
        (["diff", "00000000", "00000000"], "no design 00000000"),
        (["reproduce", "00000000"], "no design 00000000"),
    ],
)
def test_a_wrong_question_is_one_line(
    capsys: pytest.CaptureFixture[str], run_directory: Path, arguments: list[str], reason: str
) -> None:
    assert main([arguments[0], str(run_directory), *arguments[1:]]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert reason in err
