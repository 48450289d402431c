"""How runs end and go on, on the command line: as a person at two terminals sees it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from fractal_farm.catalogue import Catalogue, run_ids
from fractal_farm.cli import main
from fractal_farm.farm.interrupts import interrupts, listening
from tests.cli.conftest import submit_arguments

FARM = [sys.executable, "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())"]
ENDLESS = ("--set", "stop.epochs=1000000", "--set", "solids.max=0")


def start(*arguments: str) -> subprocess.Popen[str]:
    """`farm` in a process of its own, as the leader of its group, as a shell starts it: with signals that are heard."""
    return subprocess.Popen(
        [*FARM, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def until_epochs_pass(run: subprocess.Popen[str]) -> None:
    assert run.stderr is not None
    assert any(line.startswith("epoch") for line in run.stderr)


def epochs_and_digest(directory: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    capsys.readouterr()
    assert main(["status", str(directory), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    return facts["epochs"], facts["digest"]


def test_farm_stop_ends_a_run_at_a_whole_epoch_from_another_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    directory = tmp_path / "run"
    run = start(*submit_arguments(directory, *ENDLESS))
    until_epochs_pass(run)
    assert main(["stop", str(directory)]) == 0
    said = capsys.readouterr().err
    out, err = run.communicate(timeout=60)
    assert run.returncode == 0, err
    assert "farm stop" in out
    epochs, digest = epochs_and_digest(directory, capsys)
    assert f"ended after {epochs:,} epochs" in said
    whole = tmp_path / "whole"
    assert main(submit_arguments(whole, "--set", f"stop.epochs={epochs}", "--set", "solids.max=0")) == 0
    assert epochs_and_digest(whole, capsys) == (epochs, digest)
    # The wish does not outlive the session that it was for.
    assert main(["resume", str(directory), "--set", f"stop.epochs={epochs + 1}"]) == 0
    assert epochs_and_digest(directory, capsys)[0] == epochs + 1


def test_a_run_that_is_not_live_cannot_be_stopped(run_directory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stop", str(run_directory)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "not live" in err


@pytest.mark.parametrize("executor", ["serial", pytest.param("ray", marks=pytest.mark.slow)])
def test_a_second_ctrl_c_ends_a_run_at_once_and_it_can_be_resumed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], executor: str
) -> None:
    directory = tmp_path / "run"
    arguments = [word for word in submit_arguments(directory, *ENDLESS) if word not in ("--executor", "serial")]
    run = start(*arguments, "--executor", executor)
    until_epochs_pass(run)
    os.killpg(run.pid, signal.SIGINT)
    os.killpg(run.pid, signal.SIGINT)
    err = run.communicate(timeout=60)[1]
    assert run.returncode == 130
    assert "Traceback" not in err
    assert f"farm resume {directory}" in err
    epochs = epochs_and_digest(directory, capsys)[0] + 1
    assert main(["resume", str(directory), "--executor", "serial", "--set", f"stop.epochs={epochs}"]) == 0
    assert epochs_and_digest(directory, capsys)[0] == epochs


# A fork, such as each of Ray's processes begins with; what is raised in its callbacks goes no further.
LOST = """
import os, signal, sys
from fractal_farm.cli import main
from fractal_farm.cli import progress
display = progress.progress_display

def at_a_bad_moment():
    os.register_at_fork(after_in_parent=lambda: signal.raise_signal(signal.SIGINT))
    if os.fork() == 0:
        os._exit(0)
    return display()

progress.progress_display = at_a_bad_moment
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(main())
"""


def test_ctrl_c_is_heard_even_where_python_cannot_raise_it(tmp_path: Path) -> None:
    command = [sys.executable, "-c", LOST, *submit_arguments(tmp_path / "run", *ENDLESS)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr


def test_what_ray_could_not_raise_comes_again() -> None:
    class Dying:
        def __del__(self) -> None:
            sys.exit(15)  # as Ray's handler of SIGTERM does, in the main thread, whatever it is at

    with listening(), interrupts() as why:
        Dying()
        deadline = time.monotonic() + 30
        while why() is None and time.monotonic() < deadline:
            time.sleep(0.01)
        assert why() == "asked to end (SIGTERM)"


@pytest.fixture
def interruptible() -> Iterator[None]:
    """SIGINT as a terminal's process has it; one that a shell started in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_that_another_exception_replaced_comes_again() -> None:
    def run() -> None:
        with contextlib.suppress(OSError):
            try:
                signal.raise_signal(signal.SIGINT)
            finally:
                os.close(-1)  # as shutil.rmtree does when it is interrupted just after it has closed its directory
        with interrupts():
            pytest.fail("the run began although it was interrupted")

    with listening(), pytest.raises(KeyboardInterrupt):
        run()


@pytest.mark.slow
@pytest.mark.parametrize("delay_s", [0.5, 1.5, 2.5, 3.5])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_ray_starts_leaves_no_traceback(tmp_path: Path, delay_s: float, number: int) -> None:
    arguments = [word for word in submit_arguments(tmp_path / "run") if word not in ("--executor", "serial")]
    run = start(*arguments, *ENDLESS)
    while run.poll() is None and sum(psutil.Process(run.pid).cpu_times()[:2]) < 0.5:
        time.sleep(0.01)  # Python itself, and our own modules, are there now, however busy the machine is
    time.sleep(delay_s)
    if number == signal.SIGINT:
        os.killpg(run.pid, number)  # as a terminal does
    else:
        run.send_signal(number)  # as a supervisor does
    err = run.communicate(timeout=60)[1]
    assert run.returncode in (130, -number)
    assert "Traceback" not in err


def test_what_resume_was_given_is_remembered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    directory = tmp_path / "run"
    assert main(submit_arguments(directory, "--set", "solids.max=0", "--set", "stop.epochs=1")) == 0
    assert main(["resume", str(directory), "--set", "stop.epochs=3", "--set", "catalogue.durability=full"]) == 0
    extended = epochs_and_digest(directory, capsys)
    # Neither the executor nor the limit is named again: nothing starts Ray, and nothing is left to do.
    assert main(["resume", str(directory)]) == 0
    assert epochs_and_digest(directory, capsys) == extended
    assert extended[0] == 3
    assert len(list(directory.glob("runs/*/settings~*.json"))) == 1


def test_resume_names_one_of_several_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    directory = tmp_path / "run"
    few = ("--set", "solids.max=0", "--set", "stop.epochs=1")
    assert main(submit_arguments(directory, *few)) == 0
    first = run_ids(directory)[0]
    assert main(submit_arguments(directory, *few, "--into", "--set", "evolution.seed=5")) == 0
    second = next(run_id for run_id in run_ids(directory) if run_id != first)
    before = Catalogue.open(directory).digest(second)
    assert main(["resume", str(directory), "--run", first[:6], "--set", "stop.epochs=2"]) == 0
    assert Catalogue.open(directory).digest(second) == before
    capsys.readouterr()
    assert main(["resume", str(directory), "--run", "nothing"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert first in err
    assert second in err
