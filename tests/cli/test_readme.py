"""The README is true: its commands and snippets run as they are printed."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from fractal_farm.catalogue import Catalogue
from fractal_farm.cli import main
from fractal_farm.cli.main import app

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    """The fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


@pytest.fixture
def clone(tmp_path: Path, run_directory: Path) -> Path:
    """A directory that looks like a clone after the quickstart."""
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "quickstart").symlink_to(run_directory)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    return tmp_path


@pytest.mark.parametrize("number", range(len(blocks("python"))))
def test_a_python_snippet_runs(clone: Path, number: int) -> None:
    if "published/" in blocks("python")[number]:
        assert main(["export", str(clone / "runs" / "quickstart"), "--to", str(clone / "published")]) == 0
    done = subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning:__main__", "-c", blocks("python")[number]],
        cwd=clone,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def commands() -> list[str]:
    """The `farm` commands of the README that work on the quickstart's catalogue."""
    lines = [line.partition("#")[0].strip() for block in blocks("sh") for line in block.splitlines()]
    return [line for line in lines if line.startswith("farm ")]


# They change the catalogue, take long, or need what is not there; other tests run them.
NOT_RUN = ("resume", "stop", "bench", "experiment", "jobs", "rate", "breed", "preference", "keep", "mirror", "fetch")
NOT_RUN += ("compact", "merge", "studio", "paper", "scene")


@pytest.mark.parametrize("command", [command for command in commands() if command.split()[1] not in NOT_RUN])
def test_a_command_runs(clone: Path, monkeypatch: pytest.MonkeyPatch, command: str) -> None:
    monkeypatch.chdir(clone)
    identity = Catalogue.open("runs/quickstart").designs(["design_id"])["design_id"][0].as_py()
    words = [re.sub(r"\bID\b", identity, word) for word in shlex.split(command)[1:]]
    if words[:2] == ["show", f"meshes/{identity}.glb"]:
        assert main(["mesh", "runs/quickstart", identity, "-o", "meshes"]) == 0
    assert main(words) == 0


def test_every_command_is_named() -> None:
    named = {command.split()[1] for command in commands()} | {"submit"}
    assert named == set(typer.main.get_command(app).commands)


def test_files_that_are_named_exist() -> None:
    for name in re.findall(r"configs/\w+\.yaml|constraints\.txt|fractal_farm/\w+\.py", README):
        assert (ROOT / name).is_file(), name
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", README):
        assert (ROOT / target).is_file(), target


def test_no_more_than_three_lines_open_a_catalogue() -> None:
    snippets = blocks("python")[1:]
    assert len(snippets) == 5
    assert all(len(snippet.splitlines()) <= 3 for snippet in snippets)
