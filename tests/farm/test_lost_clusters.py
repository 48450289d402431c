"""Clusters that go while a run works on them: our own are started anew, those of others end the run with a line."""

import contextlib
import fcntl
import os
import re
import socket
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import last_epoch, run_ids
from fractal_farm.farm.on_ray.pulse import Pulse
from tests.farm.runs import small_config

pytestmark = pytest.mark.ray
ROOT = Path(__file__).parents[2]

CHILD = """
import sys
from pathlib import Path
from fractal_farm import farm
import fractal_farm.farm.run as run
from fractal_farm.farm.events import Callback, Fault, PartCommitted
from tests.farm.runs import small_config

run.PART_DESIGNS = 1

class Tell(Callback):
    def on_event(self, event):
        if isinstance(event, PartCommitted):
            print("part", event.last_epoch, flush=True)
        if isinstance(event, Fault):
            print("fault", event.where, event.cause, flush=True)

if __name__ == "__main__":
    try:
        summary = farm.submit(
            small_config("stop.epochs=" + sys.argv[2]), Path(sys.argv[1]), address=sys.argv[3] or None,
            executor="ray", callbacks=[Tell()],
        )
    except farm.FarmError as error:
        print("error", error, flush=True)
        sys.exit(1)
    print("digest", summary.ended.digest, flush=True)
""".replace("farm.FarmError", "Exception")


def _child(path, epochs, address=""):
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path), str(epochs), address],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
        start_new_session=True,
    )


def _until(process, word):
    """The next line that begins with a pattern."""
    said = []
    for line in process.stdout:
        if re.match(word, line):
            return line
        said.append(line)
    return pytest.fail(f"it ended without {word!r}: {''.join(said[-20:])}")


@pytest.mark.slow
@pytest.mark.parametrize("server", ["raylet", "gcs_server"])
def test_a_run_goes_on_by_itself_when_its_own_ray_dies(tmp_path, server):
    epochs = 200  # more than pass before the blow falls, on a busy machine too
    process = _child(tmp_path / "run", epochs)
    _until(process, "part")
    for child in psutil.Process(process.pid).children(recursive=True):
        if child.name() == server:
            child.kill()
    assert "has died" in _until(process, "fault workers")
    digest = _until(process, "digest").split()[1]
    assert process.wait(60) == 0
    whole = farm.submit(small_config(f"stop.epochs={epochs}"), tmp_path / "whole", executor="serial")
    assert digest == whole.ended.digest


@pytest.fixture
def head(tmp_path_factory):
    """A cluster of its own: its address, and its processes."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    directory = tmp_path_factory.mktemp("r")
    environment = os.environ | {"RAY_AUTH_MODE": "disabled", "RAY_TMPDIR": "/tmp", "RAY_USAGE_STATS_ENABLED": "0"}
    ray = str(Path(sys.executable).with_name("ray"))
    with (directory / "out").open("w") as out:
        process = subprocess.Popen(
            [
                *(ray, "start", "--head", "--block", f"--port={port}", "--node-ip-address=127.0.0.1", "--num-cpus=2"),
                *("--include-dashboard=false", "--dashboard-agent-listen-port=0"),
            ],
            env=environment,
            stdout=out,
            stderr=out,
            start_new_session=True,
        )
    deadline = time.monotonic() + 90
    while "Ray runtime started" not in (directory / "out").read_text():
        assert time.monotonic() < deadline, (directory / "out").read_text()
        time.sleep(0.2)
    family = psutil.Process(process.pid).children(recursive=True)
    yield f"127.0.0.1:{port}", family
    for member in [*psutil.Process(process.pid).children(recursive=True), *family]:
        try:
            member.kill()
        except psutil.NoSuchProcess:
            continue
    process.kill()
    process.wait()


@pytest.mark.slow
@pytest.mark.parametrize("victims", [("gcs_server",), ("gcs_server", "raylet")])
def test_a_cluster_whose_head_dies_ends_the_run_with_a_line_and_it_can_be_resumed(tmp_path, head, victims):
    address, family = head
    path = tmp_path / "run"
    process = _child(path, 10_000, address)
    _until(process, "part")
    writers = [child for child in psutil.process_iter() if _title(child).startswith("ray::Writer")]
    for member in family:
        if member.name() in victims:
            member.kill()
    began = time.monotonic()
    line = _until(process, "(farm: )?error")  # raised, or said by the watcher of a driver that is caught inside Ray
    assert process.wait(120) == 1
    assert time.monotonic() - began < 120
    assert re.search(rf"({re.escape(address)}|Ray) is lost.*farm resume", line)
    epochs = last_epoch(path, run_ids(path)[0]) + 3
    end = farm.resume(path, overrides=[f"stop.epochs={epochs}", "execution.address=null"], executor="serial")
    whole = farm.submit(small_config(f"stop.epochs={epochs}"), tmp_path / "whole", executor="serial")
    assert end.ended.digest == whole.ended.digest
    assert writers


def _title(process):
    try:
        return (process.cmdline() or [""])[0]
    except psutil.Error:
        return ""


def test_a_server_that_stands_still_is_told_from_one_that_lives(monkeypatch):
    monkeypatch.setattr("fractal_farm.farm.on_ray.pulse._ANSWER_SECONDS", 0.2)
    monkeypatch.setattr("fractal_farm.farm.on_ray.pulse._SILENCE_SECONDS", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:  # takes connections, never answers
        pulse = Pulse({"head": silent.getsockname()}, 0.0)
        pulse.beat()
        assert pulse.lost is None
        time.sleep(0.6)
        pulse.beat()
        assert "does not answer" in pulse.lost
        pulse.stop()


def test_the_servers_of_a_live_cluster_answer(ray_cluster):
    from fractal_farm.farm.on_ray.session import _servers

    pulse = Pulse(_servers(), 0.0)
    pulse.beat()
    assert pulse.lost is None
    pulse.stop()
    dead = Pulse({"raylet": ("127.0.0.1", 9)}, 0.0)
    dead.beat()
    assert "has died" in dead.lost
    dead.stop()


@pytest.mark.slow
def test_a_writer_that_outlives_its_driver_may_not_write_after_a_resumed_run(tmp_path, head):
    address, _ = head
    path = tmp_path / "run"
    process = _child(path, 10_000, address)
    _until(process, "part")
    writer = next(child for child in psutil.process_iter() if _title(child).startswith("ray::Writer"))
    # It stands still, so that Ray cannot end it with its driver, and wakes when another session has taken over.
    fence = next(path.glob("runs/*/fence"))
    while True:
        writer.suspend()
        with fence.open() as file, contextlib.suppress(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        writer.resume()  # in the middle of a write, for which a new session would wait
        time.sleep(0.01)
    process.kill()
    process.wait()
    epochs = last_epoch(path, run_ids(path)[0]) + 3
    try:
        end = farm.resume(path, overrides=[f"stop.epochs={epochs}", "execution.address=null"], executor="serial")
        files = sorted(path.rglob("*"))
    finally:
        writer.resume()
    time.sleep(3.0)
    assert sorted(path.rglob("*")) == files
    whole = farm.submit(small_config(f"stop.epochs={epochs}"), tmp_path / "whole", executor="serial")
    assert end.ended.digest == whole.ended.digest
    assert farm.status(path)["digest"] == end.ended.digest
