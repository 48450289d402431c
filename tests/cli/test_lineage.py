"""`farm lineage` draws what the manifest says, in every format, however deep."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from fractal_farm.catalogue import Catalogue
from fractal_farm.cli import main
from tests.catalogue.examples import designs, genome, writer
from tests.cli.test_commands import output

DEEP = 400


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A catalogue in which each of many designs comes from the one before, on another island every tenth time."""
    root = Catalogue.create(tmp_path_factory.mktemp("chain") / "catalogue").path
    parents = [[genome(k - 1).design_id] if k else [] for k in range(DEEP)]
    table, _ = designs(range(DEEP), parents=parents, island=[k // 10 % 2 for k in range(DEEP)])
    writer(root, clouds="none").commit(table, None, b"", (0, 0))
    return root


def rows_of(directory: Path) -> dict[str, dict[str, Any]]:
    columns = ["design_id", "kind", "parents", "operator", "island", "n_maps"]
    return {row["design_id"]: row for row in Catalogue.open(directory).designs(columns, ancestors=True).to_pylist()}


def test_the_tree_of_a_real_design_has_its_parents(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    rows = rows_of(run_directory)
    child = next(row for row in rows.values() if len(row["parents"]) == 2 and row["kind"] == "design")
    lines = output(capsys, "lineage", run_directory, child["design_id"], "--depth", "1").splitlines()
    assert len(lines) == 3
    for line, identity in zip(lines, [child["design_id"], *child["parents"]], strict=True):
        row = rows[identity]
        assert identity[:8] in line
        assert f"{row['operator']}  island {row['island']} " in line
        assert ("not published" in line) == (row["kind"] == "ancestor")
        assert ("migrated" in line) == (row["island"] != child["island"] and row["operator"] != "seed")
    below = output(capsys, "lineage", run_directory, child["parents"][0], "--descendants", "--depth", "1")
    assert any(child["design_id"][:8] in line for line in below.splitlines()[1:])


def test_json_and_dot_hold_the_same_family(capsys: pytest.CaptureFixture[str], chain: Path) -> None:
    last = genome(DEEP - 1).design_id
    family = json.loads(output(capsys, "lineage", chain, last, "--format", "json"))
    assert {row["design_id"]: row["steps"] for row in family["designs"]} == {
        genome(k).design_id: DEEP - 1 - k for k in range(DEEP)
    }
    assert family["summary"]["links"] == DEEP - 1
    assert family["summary"]["between_islands"] == DEEP // 10 - 1
    dot = output(capsys, "lineage", chain, last, "--format", "dot").splitlines()
    assert dot[0] == "digraph lineage {"
    assert dot[-1] == "}"
    nodes = [found[1] for line in dot if (found := re.fullmatch(r'  "(\w{32})" \[label="[^"]*"\];', line))]
    edges = [found.groups() for line in dot if (found := re.fullmatch(r'  "(\w{32})" -> "(\w{32})"( \[\S+\])?;', line))]
    assert len(dot) == 3 + len(nodes) + len(edges)
    assert sorted(nodes) == sorted(row["design_id"] for row in family["designs"])
    assert {(parent, child, mark is not None) for parent, child, mark in edges} == {
        (link["parent"], link["child"], link["between_islands"]) for link in family["links"]
    }


def test_a_tree_of_hundreds_of_generations_has_a_line_for_each(capsys: pytest.CaptureFixture[str], chain: Path) -> None:
    lines = output(capsys, "lineage", chain, genome(0).design_id, "--descendants", "--depth", DEEP).splitlines()
    assert len(lines) == DEEP
    assert all(genome(k).design_id[:8] in line for k, line in enumerate(lines))
    folded = output(capsys, "lineage", chain, genome(0).design_id, "--descendants").splitlines()
    assert len(folded) == 5
    assert folded[-1].endswith("... 1 more")


def test_without_a_design_operators_are_counted(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    rows = rows_of(run_directory)
    facts = json.loads(output(capsys, "lineage", run_directory, "--format", "json"))
    counted = {(entry["operator"], entry["n_maps"]): entry for entry in facts["operators"]}
    for (operator, n_maps), entry in counted.items():
        alike = [row for row in rows.values() if (row["operator"], row["n_maps"]) == (operator, n_maps)]
        assert entry["published"] == sum(row["kind"] == "design" for row in alike)
        assert entry["ancestors"] == sum(row["kind"] == "ancestor" for row in alike)
    assert sum(entry["published"] + entry["ancestors"] for entry in counted.values()) == len(rows)
    best = facts["fertile"][0]
    children = [row for row in rows.values() if best["design_id"] in row["parents"] and row["kind"] == "design"]
    assert best["children"] == len(children)
    table = output(capsys, "lineage", run_directory)
    assert best["design_id"] in table


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [(["--format", "dot"], "give its ID"), (["00000000"], "no design 00000000"), (["xyz"], "at least 4 hex digits")],
)
def test_a_wrong_question_is_one_line(
    capsys: pytest.CaptureFixture[str], chain: Path, arguments: list[str], reason: str
) -> None:
    assert main(["lineage", str(chain), *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert reason in err
