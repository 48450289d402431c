"""Processes that stand still, by a real SIGSTOP: they are found and killed, and no design changes."""

import time

import psutil
import pytest

from fractal_farm import farm
from fractal_farm.farm.events import Callback, EpochCompleted, Fault, MeshFinished
from tests.farm.runs import Recorder, small_config
from tests.farm.test_on_ray import ray_processes

pytestmark = pytest.mark.ray
# Bigger clouds, so that evaluations are under way when the blow falls.
CONFIG = ("evolution.phenotype.points=20000", "stop.epochs=4", "solids.max=2", "evolution.qualified=0.8")


class Stopper(Callback):
    """Stops one process of each kind, the next when the one before is gone."""

    def __init__(self, *titles):
        self.titles, self.stopped = list(titles), []

    def on_event(self, event):
        if not isinstance(event, EpochCompleted | MeshFinished):
            return
        deadline = time.monotonic() + 10
        while self.titles and time.monotonic() < deadline:
            for process in ray_processes(self.titles[0])[:1]:
                process.suspend()
                self.stopped.append(process)
                self.titles.pop(0)
                return
            time.sleep(0.002)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return farm.submit(small_config(*CONFIG), tmp_path_factory.mktemp("whole") / "run", executor="serial").ended


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr("fractal_farm.farm.on_ray.wardens.LOOK_SECONDS", 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("title", ["evaluate_batch", "Island", "Writer", "Mesher", "IDLE", "Warden"])
def test_a_process_that_is_stopped_is_killed_and_changes_nothing(ray_cluster, tmp_path, impatient, whole, title):
    stopper, recorder = Stopper(title), Recorder()
    try:
        summary = farm.submit(small_config(*CONFIG), tmp_path / "run", executor="ray", callbacks=[stopper, recorder])
        assert len(stopper.stopped) == 1
        gone = not psutil.pid_exists(stopper.stopped[0].pid)
    finally:
        for process in stopper.stopped:
            if process.is_running():
                process.kill()
    assert summary.ended.digest == whole.digest
    assert summary.ended.meshes == whole.meshes
    # One that nobody waits for may be found after the end.
    assert gone or title in ("IDLE", "Warden")
    assert not gone or f"worker {title}" in {fault.where for fault in recorder.of(Fault)}
