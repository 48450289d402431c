"""A disk that fills up under a run: it waits with one line, tears nothing, and goes on when there is room."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.farm.events import Continued, EpochCompleted, PartCommitted, Paused, RunEnded
from tests.farm.runs import Recorder, small_config
from tests.farm.storm import duplicates, torn_files

MEGABYTES = 20


@pytest.fixture
def small_disk(tmp_path):
    """A file system of its own, of 20 MB; only root may mount one."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={MEGABYTES}m", "tmpfs", str(place)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("no file system can be mounted here")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


class Filler(Recorder):
    """Fills the disk after the first commit, and makes room once the run waits."""

    def __init__(self, disk, make_room=True):
        super().__init__()
        self.file, self.make_room, self.full = disk / "filler", make_room, False

    def on_event(self, event):
        super().on_event(event)
        if isinstance(event, PartCommitted) and not self.full:
            self.full = True
            fill(self.file)
        if isinstance(event, Paused) and self.make_room:
            threading.Timer(1.5, self.file.unlink).start()


def fill(path):
    """All the room that there is, except for less than any part takes."""
    with path.open("wb", buffering=0) as file:
        while True:
            try:
                file.write(bytes(4096))
            except OSError:
                return


@pytest.mark.parametrize("executor", ["serial", pytest.param("ray", marks=[pytest.mark.ray, pytest.mark.slow])])
def test_a_full_disk_pauses_the_run_and_changes_nothing(small_disk, tmp_path, monkeypatch, executor, request):
    if executor == "ray":
        request.getfixturevalue("ray_cluster")
    monkeypatch.setattr("fractal_farm.farm.run.PART_DESIGNS", 1)
    config = small_config("catalogue.min_free_gb=0", "stop.epochs=4")
    whole = farm.submit(config, tmp_path / "whole", executor="serial")
    filler = Filler(small_disk)
    summary = farm.submit(config, small_disk / "run", executor=executor, callbacks=[filler])
    assert len(filler.of(Paused)) == 1
    assert "\n" not in filler.of(Paused)[0].cause
    assert "no space" in filler.of(Paused)[0].cause
    assert len(filler.of(Continued)) == 1
    assert summary.ended.digest == whole.ended.digest
    assert torn_files(small_disk / "run") == []
    assert duplicates(small_disk / "run") == []


def test_little_room_lets_nothing_new_begin(small_disk, tmp_path):
    config = small_config("catalogue.min_free_gb=0.01", "stop.epochs=4")
    whole = farm.submit(config, tmp_path / "whole", executor="serial")

    class Filling(Filler):
        def on_event(self, event):
            Recorder.on_event(self, event)
            if isinstance(event, EpochCompleted) and event.epoch == 0:
                self.file.write_bytes(bytes(12_000_000))
            if isinstance(event, Paused):
                threading.Timer(1.0, self.file.unlink).start()

    filler = Filling(small_disk)
    summary = farm.submit(config, small_disk / "run", executor="serial", callbacks=[filler])
    kinds = [type(event) for event in filler.events]
    begin, end = kinds.index(Paused), kinds.index(Continued)
    assert "min_free_gb" in filler.of(Paused)[0].cause
    assert EpochCompleted not in kinds[begin:end]
    assert summary.ended.digest == whole.ended.digest


CHILD = """
import sys
from pathlib import Path
from fractal_farm import farm
import fractal_farm.farm.run as run
from fractal_farm.farm.events import Paused
from tests.farm.runs import small_config
from tests.farm.test_full_disk import Filler

run.PART_DESIGNS = 1

class Tell(Filler):
    def on_event(self, event):
        super().on_event(event)
        if isinstance(event, Paused):
            print("paused", flush=True)

disk = Path(sys.argv[1])
config = small_config("catalogue.min_free_gb=0")
summary = farm.submit(config, disk / "run", executor="serial", callbacks=[Tell(disk, make_room=False)])
print("ended", summary.ended.progress.epochs, flush=True)
sys.exit(summary.exit_code)
"""


def test_ctrl_c_while_the_disk_is_full_ends_the_run_at_its_last_commit(small_disk, tmp_path):
    from pathlib import Path

    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", CHILD, str(small_disk)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=root)
    assert process.stdout.readline() == "paused\n"
    time.sleep(0.5)
    os.kill(process.pid, signal.SIGINT)
    rest = process.stdout.read()
    assert process.wait(60) == 130
    assert rest.startswith("ended")
    assert torn_files(small_disk / "run") == []
    (small_disk / "filler").unlink()
    recorder = Recorder()
    end = farm.resume(small_disk / "run", overrides=["stop.epochs=4"], callbacks=[recorder])
    whole = farm.submit(small_config("stop.epochs=4"), tmp_path / "whole", executor="serial")
    assert end.ended.digest == whole.ended.digest
    assert recorder.of(RunEnded)
    assert Catalogue.open(small_disk / "run").digest() == end.ended.digest
