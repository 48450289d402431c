"""The `farm` command as people use it: exit codes, one line for an error, clean streams."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from fractal_farm import __version__
from fractal_farm.cli import main

CONFIGS = Path(__file__).parents[2] / "configs"


def farm(*arguments: object) -> subprocess.CompletedProcess[str]:
    """The real command in a process of its own."""
    command = [sys.executable, "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())"]
    return subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True, check=False)


def refusal(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line on stderr that refuses these arguments with exit code 2, and nothing on stdout."""
    assert main([str(argument) for argument in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("farm: error: ")
    return err


def test_help_names_every_command() -> None:
    done = farm("--help")
    assert done.returncode == 0
    assert done.stderr == ""
    for command in ("submit", "resume", "status", "list", "show", "score", "render", "mesh", "doctor"):
        assert f"\n  {command} " in done.stdout


def test_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"farm {__version__}\n"


def test_no_arguments_mean_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    assert capsys.readouterr().out.startswith("Usage: farm")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["sumbit"], "did you mean 'submit'"),
        (["submit"], "missing argument 'CONFIG'; see farm submit --help"),
        (["list", "x", "--limit", "0"], "--limit"),
        (["list", "x", "--format", "xml"], "'table', 'csv', 'json', 'parquet'"),
        (["submit", "nowhere.yaml"], "nowhere.yaml: no such file"),
        (["submit", CONFIGS / "table1.yaml"], "unknown key genomes"),
        (["submit", CONFIGS / "quickstart.yaml", "--set", "evolution.library.size=0"], "library.size is 0"),
        (["score", "nowhere.yaml"], "nowhere.yaml: no such file"),
        (["submit", CONFIGS / "quickstart.yaml", "--out", "new", "--address", "127.0.0.1:99999999"], "nothing answers"),
        (["status", "nowhere"], "nowhere: no such directory"),
        (["resume", "nowhere"], "nowhere: no such directory"),
        (["list", "nowhere"], "nowhere: no such directory"),
        (["show", "nowhere", "abcd"], "nowhere: no such directory"),
        (["render", "nowhere", "abcd", "-o", "a.png"], "nowhere: no such directory"),
        (["render", "nowhere", "abcd", "-o", "a.jpg"], "ends in .png"),
        (["mesh", "nowhere", "abcd", "-o", "meshes"], "nowhere: no such directory"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    arguments: list[object],
    reason: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert reason in refusal(capsys, *arguments)
    assert list(tmp_path.iterdir()) == []


def test_a_genome_that_is_no_contraction_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "genomes.yaml"
    path.write_text("genomes: {spiral: [[0, 0, 0, 0.5, 1, 0, 0], [0, 0, 0, 1.2, 0, 1, 0]]}")
    message = refusal(capsys, "score", path)
    assert f"{path}: genome spiral map 2: rho is 1.2; it must lie between 0 and 1" in message


def test_debug_adds_the_traceback_and_keeps_the_exit_code() -> None:
    done = farm("list", "nowhere", "--debug")
    assert done.returncode == 2
    assert "Traceback" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("farm: error: nowhere")


def test_a_directory_that_is_no_catalogue_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "not a catalogue" in refusal(capsys, "list", tmp_path)


def test_an_error_of_the_operating_system_is_one_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code = main(["submit", str(tmp_path / "file" / "run.yaml")])
    err = capsys.readouterr().err
    assert code in (1, 2)
    assert err.count("\n") == 1


def test_doctor_reports_as_json() -> None:
    done = farm("doctor", "--json")
    report = json.loads(done.stdout)
    assert report["ok"] == (done.returncode == 0)
    assert {"python", "ray", "cores", "memory", "disk", "/dev/shm", "scores"} <= {c["name"] for c in report["checks"]}
    assert all(check["ok"] or check["remedy"] for check in report["checks"])


def test_doctor_says_what_is_wrong_and_exits_with_1(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("Usage", (), {"free": 10.0})())
    assert main(["doctor"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any("FAIL" in line and "free 2 GB" in line for line in lines)
