"""Runs whose catalogues have a mirror: back on a fresh machine, through outages, and after the death of the driver."""

import json
import os
import random
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.mirror import Store, fetch, keeping
from fractal_farm.catalogue.verify import verify
from fractal_farm.cli import main
from fractal_farm.errors import InputError
from fractal_farm.farm import mirroring
from fractal_farm.farm.events import EpochCompleted, MirrorChanged, PartCommitted, RunEnded
from fractal_farm.farm.history import RunHistory
from tests.farm.runs import Recorder, small_config

HOUSE = Path(__file__).resolve().parents[2]


@pytest.fixture
def many_commits(monkeypatch):
    """A commit for each epoch."""
    monkeypatch.setattr("fractal_farm.farm.run.PART_DESIGNS", 1)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The digest of an undisturbed run of twelve epochs, without a mirror."""
    path = tmp_path_factory.mktemp("whole") / "run"
    return farm.submit(small_config("stop.epochs=12"), path, executor="serial").ended.digest


def config_with(object_store, *overrides):
    return small_config(f"catalogue.mirror={object_store.url}", *overrides)


def bring(object_store, root):
    return fetch(object_store.url, root, lambda fetched, commits: None)


def sound(root):
    report = verify(root, "full")
    assert [finding for finding in report.findings if finding.damage] == []
    return report


def test_a_run_goes_on_from_its_mirror_alone(object_store, many_commits, tmp_path, whole):
    config = config_with(object_store, "solids.max=1")
    first = farm.submit(config, tmp_path / "run", executor="serial")
    assert first.mirror.cause is None
    assert config.run_id == small_config().run_id
    shutil.rmtree(tmp_path / "run")
    bring(object_store, tmp_path / "elsewhere")
    assert sound(tmp_path / "elsewhere").digest == first.ended.digest
    assert len(Catalogue.open(tmp_path / "elsewhere").solids()) == first.ended.meshes == 1
    # What it works with is remembered, the mirror too.
    longer = farm.resume(tmp_path / "elsewhere", overrides=["stop.epochs=12"], executor="serial")
    assert longer.ended.digest == whole
    assert longer.as_dict()["mirror"] == {"url": object_store.url, "files": 0, "bytes": 0, "cause": None}
    bring(object_store, tmp_path / "third")
    assert sound(tmp_path / "third").digest == whole


class Outage(Recorder):
    """Silences the store after the first commit, and lets it answer again at another event."""

    def __init__(self, object_store, until):
        super().__init__()
        self.store, self.until, self.begun = object_store, until, False

    def on_event(self, event):
        super().on_event(event)
        if isinstance(event, PartCommitted) and not self.begun:
            self.begun = True
            self.store.stop()
        if isinstance(event, EpochCompleted) and self.begun and not self.of(MirrorChanged):
            time.sleep(0.3)  # time for the mirror to find out
        if self.until is not None and isinstance(event, self.until) and self.begun:
            threading.Timer(0.5, self.store.start).start()


def test_an_outage_is_told_and_waited_out(object_store, many_commits, tmp_path, whole):
    outage = Outage(object_store, RunEnded)
    config = config_with(object_store, "stop.epochs=12")
    end = farm.submit(config, tmp_path / "run", executor="serial", callbacks=[outage])
    silent = outage.of(MirrorChanged)[0]
    assert "does not answer" in silent.cause
    assert "\n" not in silent.cause
    assert [event.cause is None for event in outage.of(MirrorChanged)] in ([False], [False, True])
    assert end.ended.digest == whole
    assert end.mirror.cause is None
    assert "MirrorChanged" in [entry["event"] for entry in RunHistory(tmp_path / "run", config.run_id, ()).log]
    bring(object_store, tmp_path / "back")
    assert sound(tmp_path / "back").digest == whole


def test_a_mirror_that_stays_silent_is_left_behind_and_caught_up_by_hand(
    object_store, many_commits, tmp_path, whole, monkeypatch, capsys
):
    monkeypatch.setattr(mirroring, "_SILENT_SECONDS", 1.0)
    config = config_with(object_store, "stop.epochs=12")
    end = farm.submit(config, tmp_path / "run", executor="serial", callbacks=[Outage(object_store, None)])
    assert end.exit_code == 0
    assert end.ended.digest == whole
    assert end.mirror.files > 10
    assert "does not answer" in end.mirror.cause
    status = farm.status(tmp_path / "run")["mirror"]
    assert status["files"] == end.mirror.files
    capsys.readouterr()
    assert main(["status", str(tmp_path / "run")]) == 0
    assert f"{end.mirror.files} files behind" in capsys.readouterr().out
    for thread in threading.enumerate():  # a run's own process lives until its mirror has given up what it was sending
        if thread.name == "mirror":
            thread.join(60.0)
            assert not thread.is_alive()
    object_store.start()
    # The dead run's lease is of this directory: nobody waits for it.
    assert main(["mirror", str(tmp_path / "run"), object_store.url, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"] >= end.mirror.files
    assert farm.status(tmp_path / "run")["mirror"]["files"] == 0
    bring(object_store, tmp_path / "back")
    assert sound(tmp_path / "back").digest == whole


def test_a_run_goes_on_where_its_mirror_is_silent_but_does_not_begin_there(object_store, tmp_path):
    config = config_with(object_store, "stop.epochs=1")
    farm.submit(config, tmp_path / "run", executor="serial")
    object_store.stop()
    with pytest.raises(InputError, match="does not answer"):
        farm.submit(config, tmp_path / "another", executor="serial")
    assert not (tmp_path / "another").exists()
    threading.Timer(3.0, object_store.start).start()
    end = farm.resume(tmp_path / "run", overrides=["stop.epochs=2"], executor="serial")
    assert end.ended.progress.epochs == 2
    assert end.mirror.cause is None


def test_two_machines_do_not_mirror_to_one_place(object_store, tmp_path, monkeypatch):
    config = config_with(object_store, "stop.epochs=1")
    farm.submit(config, tmp_path / "run", executor="serial")
    bring(object_store, tmp_path / "elsewhere")
    with pytest.raises(InputError, match="holds another catalogue"):
        farm.submit(config, tmp_path / "another", executor="serial")
    assert not (tmp_path / "another").exists()
    monkeypatch.setattr(keeping, "_LOOK_SECONDS", 0.1)
    monkeypatch.setattr(keeping, "_RENEW_SECONDS", 0.05)
    with keeping.kept(tmp_path / "run", object_store.url, "run small", lambda *line: None) as first:
        stop = threading.Event()

        def live():
            while not stop.wait(0.1):
                first.catch_up(lambda backlog: None, everything=True)

        living = threading.Thread(target=live)
        living.start()
        try:
            with pytest.raises(InputError, match="kept by run small, process"):
                farm.resume(tmp_path / "elsewhere", overrides=["stop.epochs=2"], executor="serial")
        finally:
            stop.set()
            living.join()


@pytest.mark.parametrize(
    ("url", "words"), [("s3://nobody-has-this/x", "no such bucket"), ("S3://x", "s3://bucket/prefix")]
)
def test_a_mirror_that_cannot_be_is_refused_before_anything_is_made(object_store, tmp_path, capsys, url, words):
    out = tmp_path / "run"
    words_of_command = ["submit", str(HOUSE / "configs/quickstart.yaml"), "--out", str(out), "--executor", "serial"]
    assert main([*words_of_command, "--set", f"catalogue.mirror={url}"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert words in err
    assert not out.exists()


CHILD = """
import sys
from pathlib import Path
from fractal_farm import farm
import fractal_farm.farm.run as run
from tests.farm.runs import small_config

run.PART_DESIGNS = 1
path, url = Path(sys.argv[1]), sys.argv[2]
if (path / "zarr.json").exists() and list(path.glob("runs/*/run.json")):
    farm.resume(path, executor="serial")
else:
    farm.submit(small_config("stop.epochs=400", f"catalogue.mirror={url}"), path, executor="serial")
"""


@pytest.mark.slow
def test_a_driver_killed_again_and_again_leaves_a_mirror_that_a_fresh_machine_goes_on_from(object_store, tmp_path):
    chance, reached = random.Random(3), []
    for life in range(8):
        command = [sys.executable, "-c", CHILD, str(tmp_path / "run"), object_store.url]
        child = subprocess.Popen(command, env=os.environ | {"PYTHONPATH": str(HOUSE)}, cwd=HOUSE)
        deadline = time.monotonic() + 120
        begun = len(Store(object_store.url).listing("manifest/designs"))
        while len(Store(object_store.url).listing("manifest/designs")) == begun and time.monotonic() < deadline:
            assert child.poll() is None
            time.sleep(0.05)
        time.sleep(chance.uniform(0.0, 1.5))
        child.kill()
        child.wait()
        back = tmp_path / f"back-{life}"
        bring(object_store, back)
        sound(back)
        reached.append(farm.status(back)["epochs"])
    assert reached == sorted(reached)
    assert reached[-1] > reached[0] > 0
    epochs = f"stop.epochs={reached[-1] + 2}"
    end = farm.resume(back, overrides=[epochs, "catalogue.mirror=null"], executor="serial")
    assert end.ended.digest == farm.submit(small_config(epochs), tmp_path / "whole", executor="serial").ended.digest
