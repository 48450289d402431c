"""Runs on a real local Ray cluster: the same designs as in one process, whoever is killed on the way."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import psutil
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.errors import FarmError
from fractal_farm.farm.events import Callback, EpochCompleted, Fault, MeshFinished, RunEnded, RunStarted
from tests.farm.runs import Recorder, small_config

pytestmark = pytest.mark.ray


@pytest.fixture(scope="module")
def digest(tmp_path_factory):
    path = tmp_path_factory.mktemp("serial") / "run"
    return farm.submit(small_config(), path, executor="serial").ended.digest


def ray_processes(title):
    """Processes of this session's cluster that do a kind of work now, by Ray's titles."""
    found = []
    for process in psutil.Process().children(recursive=True):
        try:
            if process.cmdline()[0].startswith(f"ray::{title}"):
                found.append(process)
        except (psutil.Error, IndexError):
            continue
    return found


class Killer(Callback):
    """Kills processes of one kind as soon as given epochs are complete."""

    def __init__(self, title, epochs):
        self.title, self.epochs, self.killed = title, set(epochs), 0

    def on_event(self, event):
        if isinstance(event, EpochCompleted) and event.epoch in self.epochs:
            for process in ray_processes(self.title)[:2]:
                process.send_signal(signal.SIGKILL)
                self.killed += 1


@pytest.mark.parametrize("batch", ["null", "5"])
def test_islands_on_ray_give_the_digest_of_one_process(ray_cluster, tmp_path, digest, batch):
    recorder = Recorder()
    config = small_config(f"execution.batch_size={batch}")
    summary = farm.submit(config, tmp_path / "run", executor="ray", callbacks=[recorder])
    assert ray_cluster == 2
    assert [event.executor for event in recorder.of(RunStarted)] == ["ray"]
    assert summary.ended.digest == digest


def test_killed_islands_are_started_again_from_what_the_run_knows(ray_cluster, tmp_path, digest):
    killer, recorder = Killer("Island", [1, 3, 5]), Recorder()
    summary = farm.submit(small_config(), tmp_path / "run", executor="ray", callbacks=[killer, recorder])
    assert killer.killed >= 3
    assert recorder.of(Fault)
    assert summary.ended.digest == digest


@pytest.mark.slow
def test_killed_evaluations_are_done_again(ray_cluster, tmp_path):
    # Bigger clouds, so that evaluations are under way when the blow falls.
    config = small_config("evolution.phenotype.points=20000", "stop.epochs=3")
    whole = farm.submit(config, tmp_path / "whole", executor="serial")
    killed, over = [], threading.Event()

    def hunt():
        while len(killed) < 3 and not over.is_set():
            for process in ray_processes("evaluate_batch")[:1]:
                process.kill()
                killed.append(process)
                time.sleep(0.5)
            time.sleep(0.005)

    hunter = threading.Thread(target=hunt)
    hunter.start()
    try:
        summary = farm.submit(config, tmp_path / "run", executor="ray")
    finally:
        over.set()
        hunter.join()
    assert len(killed) >= 1
    assert summary.ended.digest == whole.ended.digest


def test_a_killed_writer_loses_nothing_and_doubles_nothing(ray_cluster, tmp_path, monkeypatch, digest):
    # A part for each epoch, so that the writer has died before most of them.
    monkeypatch.setattr("fractal_farm.farm.run.PART_DESIGNS", 1)
    killer = Killer("Writer", [0, 2, 4])
    summary = farm.submit(small_config(), tmp_path / "run", executor="ray", callbacks=[killer])
    assert killer.killed >= 1
    assert summary.ended.digest == digest
    rows = Catalogue.open(tmp_path / "run").designs().num_rows
    assert rows == summary.ended.progress.designs


def test_solids_are_made_while_evolution_goes_on(ray_cluster, tmp_path):
    recorder = Recorder()
    config = small_config("solids.max=2", "evolution.qualified=0.8", "stop.epochs=6")
    summary = farm.submit(config, tmp_path / "run", executor="ray", callbacks=[recorder])
    assert summary.ended.meshes + summary.ended.mesh_failures == 2
    assert len(Catalogue.open(tmp_path / "run").solids()) == summary.ended.meshes


@pytest.mark.slow
def test_a_writer_killed_among_solids_costs_none_of_them(ray_cluster, tmp_path):
    class Blow(Callback):
        fallen = 0

        def on_event(self, event):
            if isinstance(event, RunEnded | MeshFinished) and not self.fallen:
                for process in ray_processes("Writer"):
                    process.kill()
                    self.fallen += 1

    blow, recorder = Blow(), Recorder()
    config = small_config("solids.max=4", "evolution.qualified=0.8", "stop.epochs=4")
    summary = farm.submit(config, tmp_path / "run", executor="ray", callbacks=[blow, recorder])
    assert blow.fallen == 1
    assert summary.ended.meshes == 4
    assert len(Catalogue.open(tmp_path / "run").solids()) == 4


def test_an_error_of_the_writer_reaches_the_user_as_one_line(ray_cluster, tmp_path):
    class Vandal(Callback):
        def on_event(self, event):
            if isinstance(event, EpochCompleted) and event.epoch == 0:
                (tmp_path / "run" / "manifest").write_text("in the way")

    with pytest.raises(FarmError) as error:
        farm.submit(small_config(), tmp_path / "run", executor="ray", callbacks=[Vandal()])
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_another_process_joins_the_cluster_by_its_address(ray_cluster, tmp_path, digest):
    import ray

    address = ray.get_runtime_context().gcs_address
    code = (
        "import sys; from pathlib import Path; from fractal_farm import farm\n"
        "from tests.farm.runs import small_config\n"
        "print(farm.submit(small_config(), Path(sys.argv[1]), address=sys.argv[2]).ended.digest)"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "run"), address]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[2], check=True)
    assert done.stdout.split()[-1] == digest
    # The cluster is not ours to end.
    assert ray.cluster_resources()["CPU"] == 2


CHILD = """
import sys
from pathlib import Path
from fractal_farm import farm
from fractal_farm.farm.events import Callback, PartCommitted
import fractal_farm.farm.run as run
from tests.farm.runs import small_config

run.PART_DESIGNS = 1

class Tell(Callback):
    def on_event(self, event):
        if isinstance(event, PartCommitted):
            print("part", event.last_epoch, flush=True)

if __name__ == "__main__":
    summary = farm.submit(small_config("stop.epochs=400"), Path(sys.argv[1]), executor=sys.argv[2], callbacks=[Tell()])
    print("end", summary.ended.reason, flush=True)
    sys.exit(summary.exit_code)
"""


def _child(path, executor):
    process = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path), executor],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        cwd=Path(__file__).parents[2],
    )
    for line in process.stdout:
        if line.startswith("part"):
            return process
    pytest.fail("the run ended before its first part")


@pytest.mark.parametrize("executor", ["serial", pytest.param("ray", marks=pytest.mark.slow)])
def test_a_run_whose_driver_is_killed_ends_with_the_same_digest(tmp_path, ray_cluster, digest, executor):
    path = tmp_path / "run"
    process = _child(path, executor)
    process.kill()
    process.wait()
    interrupted = farm.status(path)
    assert interrupted["state"] == "interrupted"
    assert 1 <= interrupted["epochs"] < 400
    if interrupted["epochs"] > 8:
        pytest.skip("the machine was faster than the blow")
    other = "ray" if executor == "serial" else "serial"
    summary = farm.resume(path, overrides=["stop.epochs=8"], executor=other)
    assert summary.ended.digest == digest


@pytest.mark.parametrize("executor", ["serial", pytest.param("ray", marks=pytest.mark.slow)])
def test_ctrl_c_ends_a_run_cleanly_at_a_whole_epoch(tmp_path, executor):
    path = tmp_path / "run"
    process = _child(path, executor)
    os.killpg(process.pid, signal.SIGINT)
    rest = process.stdout.read()
    assert process.wait(timeout=60) == 130
    assert "end interrupted" in rest
    stopped = farm.status(path)
    assert stopped["state"] == "interrupted"
    again = farm.submit(small_config(f"stop.epochs={stopped['epochs']}"), tmp_path / "whole", executor="serial")
    assert again.ended.digest == stopped["digest"]
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and _left_behind(process.pid):
        time.sleep(0.2)
    assert not _left_behind(process.pid)


def _left_behind(session):
    found = []
    for process in psutil.process_iter(["pid"]):
        try:
            if os.getsid(process.pid) == session:
                found.append(process)
        except ProcessLookupError:
            continue
    return found
