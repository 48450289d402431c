"""`farm status`: from another terminal, of a run that lives, ended, was cut short, or lies damaged."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fractal_farm.catalogue import Catalogue
from fractal_farm.cli import main
from tests.cli.conftest import submit_arguments

COMMAND = [sys.executable, "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())"]


@pytest.fixture
def live_run(tmp_path: Path) -> Iterator[tuple[Path, subprocess.Popen[str]]]:
    """A run in another process that would last for hours; it has committed something."""
    directory = tmp_path / "live"
    arguments = submit_arguments(directory, "--set", "stop.epochs=100000", "--set", "solids.max=0")
    with subprocess.Popen([*COMMAND, *arguments], stderr=subprocess.PIPE, text=True) as run:
        assert run.stderr is not None
        log = directory / "logs"
        for _ in run.stderr:
            if any('"PartCommitted"' in path.read_text() for path in log.glob("*.jsonl")):
                break
        try:
            yield directory, run
        finally:
            run.kill()


def look(capsys: pytest.CaptureFixture[str], directory: Path, code: int = 0, *more: str) -> dict[str, Any]:
    """The facts as JSON."""
    capsys.readouterr()
    assert main(["status", str(directory), "--json", *more]) == code
    facts: dict[str, Any] = json.loads(capsys.readouterr().out)
    return facts


def test_a_live_run_is_seen_from_another_process(
    capsys: pytest.CaptureFixture[str], live_run: tuple[Path, subprocess.Popen[str]]
) -> None:
    directory, run = live_run
    facts = look(capsys, directory)
    assert facts["state"] == "running"
    assert facts["epochs"] >= 1
    assert facts["complete_epochs"] >= facts["epochs"]
    assert [island["island"] for island in facts["islands"]] == [0, 1]
    assert {island["epoch"] for island in facts["islands"]} == {facts["epochs"] - 1}
    assert facts["silent_s"] < 60
    assert facts["free_bytes"] > facts["min_free_bytes"]
    run.kill()
    run.wait()
    assert look(capsys, directory)["state"] == "interrupted"


def test_watching_on_a_pipe_prints_a_line_at_each_look_until_the_run_ends(
    live_run: tuple[Path, subprocess.Popen[str]],
) -> None:
    directory, run = live_run
    command = [*COMMAND, "status", str(directory), "--watch", "--interval", "0.2"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as watch:
        assert watch.stdout is not None
        seen = [watch.stdout.readline() for _ in range(3)]
        run.send_signal(signal.SIGINT)
        rest = watch.stdout.read()
    assert watch.returncode == 0
    assert all(line.startswith("running, epoch ") for line in seen)
    assert "\ninterrupted, epoch " in "\n" + rest
    # In the end the whole state follows, with the digest of what is there.
    assert Catalogue.open(directory).digest() in rest


def test_watching_as_json_prints_one_object_a_line(run_directory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["status", str(run_directory), "--watch", "--json"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert json.loads(line)["state"] == "ended"


def test_watching_on_a_terminal_redraws_and_ends_with_the_run(live_run: tuple[Path, subprocess.Popen[str]]) -> None:
    directory, run = live_run
    ours, theirs = pty.openpty()
    command = [*COMMAND, "status", str(directory), "--watch", "--interval", "0.2"]
    environment = os.environ | {"TERM": "xterm", "COLUMNS": "100", "LINES": "40"}
    with subprocess.Popen(command, stdout=theirs, stderr=theirs, env=environment) as watch:
        os.close(theirs)
        text = b""
        # A page that is drawn again begins with a jump upwards.
        while text.count(b"\x1b[1A") < 5:
            text += os.read(ours, 65536)
        run.send_signal(signal.SIGINT)
        with contextlib.suppress(OSError):  # the terminal is gone
            while more := os.read(ours, 65536):
                text += more
    assert watch.returncode == 0
    for part in (b"running", b"migration", b"time left", b"interrupted", Catalogue.open(directory).digest().encode()):
        assert part in text


def test_migration_says_who_gave_how_many_to_whom(capsys: pytest.CaptureFixture[str], run_directory: Path) -> None:
    facts = look(capsys, run_directory)
    assert facts["migration_epochs"] == [0, 1]
    # Two islands in a ring, two epochs: five designs came once, from the other one.
    assert [island["received"] for island in facts["islands"]] == [{"1": 5}, {"0": 5}]
    assert facts["settled"] == sum(island["settled"] for island in facts["islands"])
    capsys.readouterr()
    assert main(["status", str(run_directory)]) == 0
    assert "to 0: 5 from 1, " in capsys.readouterr().out


def test_faults_are_counted_by_cause(capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path) -> None:
    shutil.copytree(run_directory, tmp_path / "run")
    (log,) = (tmp_path / "run" / "logs").glob("*.jsonl")
    fault = {"event": "Fault", "where": "writer", "cause": "OutOfMemoryError", "remedy": "the part is written again"}
    with log.open("a") as file:
        file.writelines(json.dumps({"at": float(second), **fault}) + "\n" for second in (1, 2, 3))
        file.write('{"at": 9, "event": "Fau')  # torn by a crash
    (failure,) = look(capsys, tmp_path / "run")["failures"]
    assert (failure["where"], failure["cause"], failure["count"], failure["last"]) == ("writer", fault["cause"], 3, 3)


@pytest.mark.parametrize("victim", ["manifest/designs/*.parquet", "runs/*/run.json", "runs/*/final*.json"])
def test_a_damaged_catalogue_is_described_as_far_as_it_can_be_read(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path, victim: str
) -> None:
    directory = tmp_path / "run"
    shutil.copytree(run_directory, directory)
    path = sorted(directory.glob(victim))[0]
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)
    capsys.readouterr()
    assert main(["status", str(directory)]) == 1
    out, err = capsys.readouterr()
    assert out.startswith("run ")
    assert path.name in err
    assert "Traceback" not in err
    facts = look(capsys, directory, code=1)
    assert any(path.name in line for line in facts["damage"])
    whole = Catalogue.open(run_directory).designs().num_rows
    assert facts["designs"] == (whole if "parquet" not in victim else 0)
    assert facts["files"] == Catalogue.open(directory).usage().files


def test_a_place_without_a_run_is_refused_in_one_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    Catalogue.create(tmp_path / "empty")
    for place in (tmp_path, tmp_path / "empty", tmp_path / "nowhere"):
        assert main(["status", str(place), "--watch"]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.count("\n") == 1


def test_a_run_that_waits_says_why(
    capsys: pytest.CaptureFixture[str], live_run: tuple[Path, subprocess.Popen[str]]
) -> None:
    directory, run = live_run
    run.send_signal(signal.SIGSTOP)
    try:
        (log,) = (directory / "logs").glob("*.jsonl")
        whole = log.read_bytes()
        pause = {"at": 1.0, "event": "Paused", "cause": "no space left on the disk"}
        log.write_bytes(whole + json.dumps(pause).encode() + b"\n")
        assert look(capsys, directory)["waits"] == pause["cause"]
        going_on = {"at": 2.0, "event": "Continued", "reason": "there is room"}
        log.write_bytes(whole + json.dumps(pause).encode() + b"\n" + json.dumps(going_on).encode() + b"\n")
        assert look(capsys, directory)["waits"] is None
    finally:
        run.send_signal(signal.SIGCONT)


def test_one_of_several_runs_is_chosen_by_its_first_digits(
    capsys: pytest.CaptureFixture[str], run_directory: Path, tmp_path: Path
) -> None:
    directory = tmp_path / "run"
    shutil.copytree(run_directory, directory)
    first = look(capsys, directory)
    second = submit_arguments(directory, "--into", "--set", "evolution.seed=1", "--set", "solids.max=0")
    assert main(second) == 0
    assert look(capsys, directory)["run_id"] != first["run_id"]
    assert look(capsys, directory, 0, "--run", first["run_id"][:6])["digest"] == first["digest"]
