"""Processes that stand still, by a real SIGSTOP: they are found and killed, and no design changes."""

import functools
import time

import numpy as np
import psutil
import pytest
import ray

from fractal_farm import farm
from fractal_farm.farm.events import Callback, EpochCompleted, Fault, MeshFinished
from fractal_farm.farm.on_ray import executor as on_ray
from tests.farm import deadly
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
    # Nobody waits for these two: the end may come first.
    if title not in ("IDLE", "Warden"):
        assert gone
        assert f"worker {title}" in {fault.where for fault in recorder.of(Fault)}


@pytest.mark.slow
def test_an_evaluation_that_waits_for_ever_is_done_again(ray_cluster, tmp_path, impatient, whole, monkeypatch):
    evaluate = functools.partial(deadly.waits_once, str(tmp_path / "waited"))
    monkeypatch.setattr(on_ray, "RayExecutor", functools.partial(on_ray.RayExecutor, evaluate=evaluate))
    recorder = Recorder()
    summary = farm.submit(small_config(*CONFIG), tmp_path / "run", executor="ray", callbacks=[recorder])
    assert (tmp_path / "waited").exists()
    assert "worker evaluate_batch" in {fault.where for fault in recorder.of(Fault)}
    assert summary.ended.digest == whole.digest


@pytest.mark.slow
def test_an_object_store_that_spills_is_told(ray_cluster, tmp_path):
    class Filler(Callback):
        held = ()

        def on_event(self, event):
            if isinstance(event, EpochCompleted) and not self.held:
                self.held = [ray.put(np.ones(4_000_000)) for _ in range(16)]  # twice of what it holds

    filler, recorder = Filler(), Recorder()
    config = small_config("stop.epochs=null", "stop.hours=0.008")
    farm.submit(config, tmp_path / "run", executor="ray", callbacks=[filler, recorder])
    filler.held = ()
    assert [fault.where for fault in recorder.of(Fault)] == ["object store"]
