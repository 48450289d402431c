"""Steered runs: the request decides, not the moment at which somebody, or something, came in between."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue, durable, steering
from fractal_farm.catalogue.layout import DESIGNS
from fractal_farm.catalogue.parts import epochs_of, list_parts, read_commits
from fractal_farm.catalogue.steering import bind_wishes, record_wish, steering_requests
from fractal_farm.catalogue.verify import verify
from fractal_farm.errors import FarmError, InputError, StorageFullError
from fractal_farm.farm.events import EpochCompleted, Steered
from fractal_farm.farm.restore import restore
from fractal_farm.hand.keeping import keep
from fractal_farm.hand.steering import steer
from fractal_farm.ifs.genome import Genome
from tests.farm.runs import Recorder, small_config
from tests.farm.test_niches import niches

HOUSE = Path(__file__).resolve().parents[2]
RESUME_ALOUD = """
import sys
from pathlib import Path
from fractal_farm import farm
from fractal_farm.farm.events import Callback, EpochCompleted

class Aloud(Callback):
    def on_event(self, event):
        if isinstance(event, EpochCompleted):
            print(event.epoch, flush=True)

farm.resume(Path(sys.argv[1]), overrides=["stop.epochs=8"], executor="serial", callbacks=[Aloud()])
"""


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """Three epochs of a run, and the request to breed from one of its designs and from one made by hand."""
    path = tmp_path_factory.mktemp("begun") / "run"
    farm.submit(niches("stop.epochs=3"), path, executor="serial")
    own = Catalogue.open(path).designs(["design_id"]).column("design_id").to_pylist()[-1]
    genes = Catalogue.open(path).genome(own).genes.copy()
    genes[:, :3] += 0.7
    (foreign,) = keep(path, [Genome(genes)])
    steered = steer(path, [own, foreign["design_id"]])
    assert (steered.live, steered.epochs) == (False, 3)
    assert (steered.request.first, steered.request.last) == (3, 12)
    return path, {own, foreign["design_id"]}


@pytest.fixture(scope="module")
def steered_run(begun, tmp_path_factory):
    """The run to its eighth epoch, undisturbed: path and digest."""
    path = tmp_path_factory.mktemp("steered") / "run"
    shutil.copytree(begun[0], path)
    return path, farm.resume(path, overrides=["stop.epochs=8"], executor="serial").ended.digest


def test_all_islands_breed_from_the_chosen_designs_from_the_epoch_on_that_the_request_names(begun, steered_run):
    (run,) = Catalogue.open(steered_run[0]).runs()
    rows = Catalogue.open(steered_run[0]).designs(run_id=run.run_id, ancestors=True).to_pylist()
    foreign = [row for row in rows if row["operator"] == "seed"]
    assert [(row["epoch"], row["island"]) for row in foreign] == [(3, 0)]
    later = [row for row in rows if row["epoch"] >= 3 and row["operator"] != "seed"]
    children = [row for row in later if begun[1] & set(row["parents"])]
    assert {row["island"] for row in children} == {0, 1, 2}
    assert len(children) > len(later) / 8
    assert not [row for row in rows if foreign[0]["design_id"] in row["parents"] and row["epoch"] < 3]


def test_a_steered_run_is_another_run_than_an_unsteered_one(steered_run, tmp_path):
    assert farm.submit(niches(), tmp_path / "run", executor="serial").ended.digest != steered_run[1]


def test_a_steered_catalogue_is_sound_to_the_last_number(steered_run):
    assert not [finding for finding in verify(steered_run[0], "deep").findings if finding.damage]


def test_a_steered_run_that_is_interrupted_equals_one_that_is_not(begun, steered_run, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(begun[0], path)
    farm.resume(path, overrides=["stop.epochs=4"], executor="serial")
    shutil.rmtree(path / "snapshots")
    farm.resume(path, overrides=["stop.epochs=6"], executor="serial")
    assert farm.resume(path, overrides=["stop.epochs=8"], executor="serial").ended.digest == steered_run[1]


def test_a_request_begins_beyond_the_parts_that_follow_a_lost_one(tmp_path):
    path, config = tmp_path / "run", small_config("stop.epochs=2")
    farm.submit(config, path, executor="serial")
    for epochs in (4, 6):
        farm.resume(path, overrides=[f"stop.epochs={epochs}"], executor="serial")
    lost = next(name for name in list_parts(path) if epochs_of(read_commits(path, name))[1] == 3)
    (path / DESIGNS / lost.file_name).unlink()
    schedule, *_ = restore(config, path)
    assert schedule.complete < 3
    assert schedule.unbegun() == 6


def test_a_steered_run_that_is_killed_equals_one_that_is_not(begun, steered_run, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(begun[0], path)
    for epoch in (4, 6):
        child = subprocess.Popen(
            [sys.executable, "-c", RESUME_ALOUD, str(path)],
            cwd=HOUSE,
            env=os.environ | {"PYTHONPATH": str(HOUSE)},
            stdout=subprocess.PIPE,
            text=True,
        )
        while int(child.stdout.readline()) < epoch:
            pass
        child.send_signal(signal.SIGKILL)
        child.communicate()
    assert farm.resume(path, overrides=["stop.epochs=8"], executor="serial").ended.digest == steered_run[1]


@pytest.mark.slow
@pytest.mark.ray
def test_ray_breeds_what_the_serial_executor_breeds(begun, steered_run, tmp_path, ray_cluster):
    path = tmp_path / "run"
    shutil.copytree(begun[0], path)
    assert farm.resume(path, overrides=["stop.epochs=8"], executor="ray").ended.digest == steered_run[1]


class Wishing(Recorder):
    """Wishes for a design once an epoch is complete, while the run is at work."""

    def __init__(self, path, epoch):
        super().__init__()
        self.path, self.epoch, self.chosen = path, epoch, None

    def on_event(self, event):
        super().on_event(event)
        if isinstance(event, EpochCompleted) and event.epoch == self.epoch:
            (run,) = Catalogue.open(self.path).runs()
            self.chosen = Genome(np.array([[0.1, 0.2, 0.3, 0.6, 0.5, 0, 0], [2.0, 0, 0, 0.7, -0.5, 1, 0]]))
            record_wish(self.path, run.run_id, [self.chosen])


def wished_for(path, executor):
    """A run that is steered while it is live, and its request."""
    wishing = Wishing(path, 1)
    summary = farm.submit(niches(), path, executor=executor, callbacks=[wishing])
    (request,) = steering_requests(path, summary.run_id)
    (told,) = wishing.of(Steered)
    assert (told.first, told.design_ids) == (request.first, (wishing.chosen.design_id,))
    assert 2 <= request.first < 8
    assert not list((path / "runs").rglob("wish~*"))
    return summary, request


def replayed(run, path):
    """The run again, with the request there from its second epoch on."""
    farm.submit(niches("stop.epochs=2"), path, executor="serial")
    (document,) = (run.path / "runs" / run.run_id).glob("steering~*")
    shutil.copy(document, path / "runs" / run.run_id)
    return farm.resume(path, overrides=["stop.epochs=8"], executor="serial").ended.digest


def test_a_live_run_takes_a_wish_up_and_is_replayed_from_the_request(tmp_path):
    run, request = wished_for(tmp_path / "live", "serial")
    assert replayed(run, tmp_path / "again") == run.ended.digest
    assert farm.status(run.path)["steering"] == [
        {"first": request.first, "last": request.last, "design_ids": list(request.design_ids)}
    ]


def test_a_wish_that_finds_no_room_waits_and_those_before_it_begin_in_time(tmp_path, monkeypatch):
    refused = []

    def put(path, content):
        if path.name.startswith("steering~0001") and len(refused) < 3:
            refused.append(path)
            raise StorageFullError("no space left")
        durable.put(path, content)

    class WishingTwice(Wishing):
        def on_event(self, event):
            super().on_event(event)
            if isinstance(event, EpochCompleted) and event.epoch == self.epoch:
                record_wish(self.path, small_config().run_id, [self.chosen])

    monkeypatch.setattr(steering, "put", put)
    wishing = WishingTwice(tmp_path / "run", 1)
    summary = farm.submit(small_config(), tmp_path / "run", executor="serial", callbacks=[wishing])
    requests = steering_requests(tmp_path / "run", summary.run_id)
    assert len(refused) == 3
    assert [request.first for request in requests] == [event.first for event in wishing.of(Steered)]
    assert requests[0].first < requests[1].first


@pytest.mark.slow
@pytest.mark.ray
def test_a_live_run_on_ray_is_replayed_from_the_request(tmp_path, ray_cluster):
    run, _ = wished_for(tmp_path / "live", "ray")
    assert replayed(run, tmp_path / "again") == run.ended.digest


def test_wishes_are_bound_once_in_their_order_whatever_a_crash_left(begun, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(begun[0], path)
    (run,) = Catalogue.open(path).runs()
    genomes = [Catalogue.open(path).genome(identity) for identity in sorted(begun[1])]
    names = [record_wish(path, run.run_id, [genome]) for genome in genomes]
    left = (path / "runs" / run.run_id / names[0]).read_bytes()
    requests = bind_wishes(path, run.run_id, 5)
    assert [(request.first, request.wish) for request in requests] == [(5, names[0]), (5, names[1])]
    (path / "runs" / run.run_id / names[0]).write_bytes(left)
    assert bind_wishes(path, run.run_id, 6) == []
    assert [request.first for request in steering_requests(path, run.run_id)] == [3, 5, 5]
    end = farm.resume(path, overrides=["stop.epochs=6"], executor="serial")
    assert end.ended.progress.epochs == 6


def test_a_run_that_has_lost_a_request_is_not_resumed(steered_run, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(steered_run[0], path)
    next((path / "runs").rglob("steering~*")).unlink()
    with pytest.raises(FarmError, match="steered 1 times, and 0"):
        farm.resume(path, overrides=["stop.epochs=9"], executor="serial")


def test_a_damaged_request_is_found_and_restored(steered_run, tmp_path):
    from fractal_farm.catalogue.verify import Remakers, repair

    path = tmp_path / "run"
    shutil.copytree(steered_run[0], path)
    document = next((path / "runs").rglob("steering~*"))
    whole = document.read_bytes()
    document.write_bytes(whole.replace(b"0.", b"1.", 1))
    assert [finding.path for finding in verify(path, "quick").findings] == [str(document.relative_to(path))]
    document.write_bytes(bytes([whole[0], whole[1] ^ 8, *whole[2:]]))
    assert repair(path, "quick", Remakers({}, lambda *_: {})).exit_code == 0
    assert document.read_bytes() == whole


def test_a_run_refuses_parents_that_it_has_no_room_for(tmp_path):
    farm.submit(small_config("stop.epochs=1"), tmp_path / "run", executor="serial")
    rows = np.array([[0.0, 0, 0, 0.5, x, 0, 1] for x in (0.0, 0.5, 1.0, 2.0)])
    (four,) = keep(tmp_path / "run", [Genome(rows)])
    with pytest.raises(InputError, match="has 4 maps"):
        steer(tmp_path / "run", [four["design_id"]])
    assert not list((tmp_path / "run/runs").rglob("wish~*"))
