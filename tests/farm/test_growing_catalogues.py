"""A run merges its small parts while it goes on; what it writes stays below what was foretold."""

import contextlib
import shutil

import pytest

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.compaction import compact
from fractal_farm.catalogue.parts import list_parts
from fractal_farm.catalogue.verify import verify
from fractal_farm.catalogue.verify.contents import Contents
from fractal_farm.errors import InputError
from fractal_farm.farm import publisher, run, sessions
from fractal_farm.farm.events import PartCommitted, RunStarted
from fractal_farm.farm.preflight import check_disk, disk_need
from fractal_farm.farm.run_status import status
from tests.farm.runs import Recorder, small_config


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The run in one part."""
    path = tmp_path_factory.mktemp("plain") / "run"
    return path, farm.submit(small_config(), path, executor="serial")


def test_a_run_that_may_fill_the_disk_in_minutes_is_refused_unless_it_is_told_to(tmp_path):
    minutes = disk_need(small_config("stop.epochs=2000")).first_hour / 1e10
    for share, refused in ((0.5, True), (2.0, False)):
        free = shutil.disk_usage(tmp_path).free / 1e9
        config = small_config("stop.epochs=2000", f"catalogue.min_free_gb={free - share * minutes}")
        with pytest.raises(InputError, match="in minutes") if refused else contextlib.nullcontext():
            check_disk(config, tmp_path / "run")
    check_disk(small_config("stop.epochs=100000", "catalogue.min_free_gb=0"), tmp_path / "run")


def test_a_run_that_merges_its_parts_ends_in_the_same_catalogue_and_resumes(plain, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "PART_DESIGNS", 1)
    monkeypatch.setattr(publisher, "MERGE_COMMITS", 3)
    recorder = Recorder()
    path = tmp_path / "run"
    farm.submit(small_config("stop.epochs=5"), path, executor="serial", callbacks=[recorder])
    assert [(part.seq, part.last) for part in list_parts(path)] == [(0, 2), (3, 3), (4, 4)]
    committed = recorder.of(PartCommitted)
    assert committed[2].files == committed[1].files - 2  # it took the place of three
    counted = farm.resume(path, overrides=["stop.epochs=8"], executor="serial")
    assert counted.ended.digest == plain[1].ended.digest
    assert counted.ended.progress == plain[1].ended.progress
    assert verify(path, "full").findings == ()


def test_a_deep_look_goes_on_when_parts_are_merged_meanwhile(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "PART_DESIGNS", 1)
    path = tmp_path / "run"
    run_id = farm.submit(small_config("stop.epochs=3"), path, executor="serial").run_id
    rows_of, looked_at = Contents.rows, []

    def rows_and_then_a_merge(contents, part, *wanted):
        table = rows_of(contents, part, *wanted)
        looked_at.append(part.name)
        compact(path, run_id)
        return table

    monkeypatch.setattr(Contents, "rows", rows_and_then_a_merge)
    report = verify(path, "deep")
    assert report.findings == ()
    assert report.designs == Catalogue.open(path).usage().rows
    assert [name.is_merged for name in looked_at] == [False, True]


def test_many_parts_are_merged_when_a_run_ends(plain, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "PART_DESIGNS", 1)
    monkeypatch.setattr(sessions, "_PARTS", 4)
    path = tmp_path / "run"
    summary = farm.submit(small_config(), path, executor="serial")
    assert [(part.seq, part.last) for part in list_parts(path)] == [(0, 7)]
    assert summary.ended.digest == plain[1].ended.digest
    told, as_one_part = status(path), status(plain[0])
    for name in ("designs", "n_maps", "printable", "distinct", "evaluated", "refused", "islands", "complete_epochs"):
        assert told[name] == as_one_part[name], name
    assert told["state"] == "ended"
    assert told["damage"] == []


@pytest.mark.parametrize(
    "overrides",
    [
        ("stop.epochs=8",),
        ("stop.epochs=null", "stop.evaluations=800"),
        ("stop.epochs=null", "stop.qualified=60", "catalogue.keep=qualified"),
        ("evolution.method=niches", "catalogue.keep=distinct", "solids.max=1"),
    ],
)
def test_a_run_writes_no_more_than_was_foretold(tmp_path, overrides):
    config, recorder = small_config(*overrides), Recorder()
    path = tmp_path / "run"
    farm.submit(config, path, executor="serial", callbacks=[recorder])
    (started,) = recorder.of(RunStarted)
    written = Catalogue.open(path).usage().bytes
    assert written <= started.whole_bytes
    assert disk_need(config, 1).whole == started.whole_bytes
    assert status(path)["whole_bytes"] == started.whole_bytes


def test_more_work_needs_more_disk_and_no_limit_needs_no_end():
    one, two = (disk_need(small_config(f"stop.hours={hours}", "stop.epochs=null"), 2) for hours in (1, 2))
    assert one.first_hour == two.first_hour == one.whole < two.whole
    assert disk_need(small_config("stop.epochs=null"), 2).whole is None
    assert disk_need(small_config(), 2).first_hour == disk_need(small_config(), 4).whole
    assert disk_need(small_config("solids.max=5"), 2).whole == disk_need(small_config(), 2).whole + 5 * 8e6
