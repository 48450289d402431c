"""`farm verify`: exit codes, lines and JSON; a run that was killed and resumed is sound."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fractal_farm.catalogue import Catalogue, run_lock
from fractal_farm.catalogue.verify.bit_flips import flipped
from fractal_farm.cli import main
from tests.cli.conftest import submit_arguments


@pytest.fixture
def damaged(run_directory: Path, tmp_path: Path) -> Path:
    """A copy of the small run with one flipped bit in a shard."""
    copy: Path = shutil.copytree(run_directory, tmp_path / "copy")
    shard = next(copy.glob("clouds/*/points/c.*"))
    shard.write_bytes(flipped(shard.read_bytes(), 1000))
    return copy


def spoken(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    capsys.readouterr()
    code = main(["verify", *map(str, arguments)])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.mark.parametrize("level", [(), ("quick",), ("--level", "full"), ("deep", "--level", "deep"), ("--repair",)])
def test_a_sound_run_says_so_and_exits_with_0(
    capsys: pytest.CaptureFixture[str], run_directory: Path, level: tuple[str, ...]
) -> None:
    code, out, err = spoken(capsys, run_directory, *level)
    assert (code, out) == (0, "")
    assert err.startswith("sound")
    assert err.count("\n") == 1
    assert ("quick" in level) != (Catalogue.open(run_directory).digest() in err)


def test_damage_is_one_line_and_exit_code_1(capsys: pytest.CaptureFixture[str], damaged: Path) -> None:
    code, out, err = spoken(capsys, damaged)
    assert code == 1
    assert out.count("\n") == 1
    assert "/points/c.0.0.0: damaged" in out
    assert "(1 design: " in out
    assert "farm verify --repair" in out
    assert err.startswith("1 damage found")


def test_json_says_the_same(capsys: pytest.CaptureFixture[str], damaged: Path) -> None:
    code, out, _ = spoken(capsys, damaged, "--json")
    report = json.loads(out)
    (finding,) = report["findings"]
    assert code == report["exit_code"] == 1
    assert finding["kind"] == "cloud"
    assert finding["path"].endswith("/points/c.0.0.0")
    assert [len(identity) for identity in finding["designs"]] == [32]


def test_repair_restores_clouds_solids_and_pictures(
    capsys: pytest.CaptureFixture[str], run_directory: Path, damaged: Path
) -> None:
    (damaged / "catalogue.png").unlink()
    mesh = next(damaged.glob("solids/*/*/*.stl"))
    mesh.write_bytes(mesh.read_bytes()[:-1])
    code, out, err = spoken(capsys, damaged, "full", "--repair")
    assert code == 0
    assert "grown again, bit for bit" in out
    assert err.startswith("3 of 3 damages undone")
    shard = next(damaged.glob("clouds/*/points/c.*"))
    for path in (mesh, mesh.parent / "preview.png", shard, damaged / "catalogue.png"):
        assert path.read_bytes() == (run_directory / path.relative_to(damaged)).read_bytes()
    assert spoken(capsys, damaged)[0] == 0


def test_what_cannot_be_repaired_is_exit_code_3(capsys: pytest.CaptureFixture[str], damaged: Path) -> None:
    next(damaged.glob("runs/*/run.json")).unlink()
    code, out, err = spoken(capsys, damaged, "--repair")
    assert code == 3
    assert "restored from a copy" in out
    assert "1 remain" in err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["thorough"], "--level thorough: choose quick, full, deep"),
        (["quick", "--level", "full"], "leave one of them out"),
    ],
)
def test_a_wrong_level_is_one_line_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], run_directory: Path, arguments: list[str], reason: str
) -> None:
    code, out, err = spoken(capsys, run_directory, *arguments)
    assert (code, out) == (2, "")
    assert reason in err
    assert err.count("\n") == 1


def test_no_catalogue_is_exit_code_2(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nowhere", Path(__file__)):
        code, _, err = spoken(capsys, path)
        assert code == 2
        assert err.count("\n") == 1


def test_a_live_run_is_not_repaired(capsys: pytest.CaptureFixture[str], damaged: Path) -> None:
    (run_id,) = [run.run_id for run in Catalogue.open(damaged).runs()]
    with run_lock(damaged, run_id):
        assert spoken(capsys, damaged)[0] == 1
        code, _, err = spoken(capsys, damaged, "--repair")
    assert code == 2
    assert "in the hands of" in err


def test_a_run_that_was_killed_is_sound_before_and_after_it_is_resumed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "run"
    arguments = submit_arguments(out, "--set", "stop.epochs=100", "--set", "solids.max=0")
    farm = [sys.executable, "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())"]
    process = subprocess.Popen([*farm, *arguments], stderr=subprocess.DEVNULL)
    while not list(out.glob("clouds/*/points/*")):
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert spoken(capsys, out)[0] == 0
    assert main(["resume", str(out), "--executor", "serial", "--set", "stop.epochs=4"]) == 0
    code, said, _ = spoken(capsys, out, "deep")
    assert (code, said) == (0, "")
