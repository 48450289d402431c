"""Runs with the serial executor: what a session leaves behind, and how it goes on."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import cKDTree

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.layout import DESIGNS
from fractal_farm.catalogue.parts import epochs_of, list_parts, read_commits
from fractal_farm.catalogue.settings import record_settings
from fractal_farm.catalogue.verify import verify
from fractal_farm.errors import InputError
from fractal_farm.farm.events import EpochCompleted, MeshFinished, Migration, PartCommitted, RunEnded, RunStarted
from fractal_farm.farm.report import report_page
from fractal_farm.farm.restore import restore
from fractal_farm.fitness import evaluate
from fractal_farm.ifs.random_iteration import attractor_points
from tests.farm.runs import Recorder, small_config


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    path = tmp_path_factory.mktemp("finished") / "run"
    recorder = Recorder()
    summary = farm.submit(small_config(), path, executor="serial", callbacks=[recorder])
    return path, summary, recorder


def test_a_run_ends_at_its_limit_with_designs_of_every_island(finished):
    path, summary, _ = finished
    designs = Catalogue.open(path).designs()
    assert summary.exit_code == 0
    assert summary.ended.progress.epochs == 8
    assert set(designs.column("island").to_pylist()) == {0, 1, 2}
    assert designs.num_rows > 30
    assert min(designs.column("fitness").to_pylist()) >= 0.75
    assert (path / "catalogue.png").stat().st_size > 1000


def test_a_run_that_lost_a_part_in_its_middle_finds_the_same_shapes_again(tmp_path):
    path, config = tmp_path / "run", small_config("stop.epochs=2", "catalogue.keep=distinct")
    farm.submit(config, path, executor="serial")
    for epochs in (4, 6):
        whole = farm.resume(path, overrides=[f"stop.epochs={epochs}"], executor="serial").ended
    lost = next(name for name in list_parts(path) if epochs_of(read_commits(path, name))[1] == 3)
    (path / DESIGNS / lost.file_name).unlink()
    again = farm.resume(path, executor="serial").ended
    assert again.digest == whole.digest
    assert again.progress == whole.progress


def test_stored_scores_are_those_of_the_genomes(finished):
    path, _, _ = finished
    catalogue = Catalogue.open(path)
    rows = catalogue.designs().to_pylist()[::5]
    again = evaluate([catalogue.genome(row["design_id"]) for row in rows], n_points=1000)
    for name in ("d0", "d2", "lle", "fitness"):
        assert getattr(again, name).tolist() == [row[name] for row in rows]


def test_stored_clouds_are_those_of_the_genomes(finished):
    path, _, _ = finished
    catalogue = Catalogue.open(path)
    for row in catalogue.designs().to_pylist()[::9]:
        grown = attractor_points(catalogue.genome(row["design_id"]), 1000)
        stored = catalogue.points(row["design_id"])
        step = np.ptp(grown, axis=0).max() / 65535
        assert len(stored) == 1000
        assert cKDTree(stored).query(grown)[0].max() < step
        assert cKDTree(grown).query(stored)[0].max() < step


def test_every_parent_is_in_the_catalogue(finished):
    path, _, _ = finished
    rows = Catalogue.open(path).designs(["design_id", "kind", "parents"], ancestors=True).to_pylist()
    known = {row["design_id"] for row in rows}
    assert {parent for row in rows for parent in row["parents"]} <= known
    assert {row["kind"] for row in rows} == {"design", "ancestor"}


def test_events_tell_the_whole_story_in_order(finished):
    _, summary, recorder = finished
    assert isinstance(recorder.events[0], RunStarted)
    assert recorder.events[-1] == summary.ended
    assert [event.epoch for event in recorder.of(EpochCompleted)] == list(range(8))
    parts = recorder.of(PartCommitted)
    assert [parts[0].first_epoch, parts[-1].last_epoch] == [0, 7]
    assert parts[-1].total_designs == summary.ended.progress.designs
    assert any(event.settled for event in recorder.of(Migration))


def test_usage_is_counted_right(finished):
    path, _, recorder = finished
    last = recorder.of(PartCommitted)[-1]
    usage = Catalogue.open(path).usage()
    # After the last part come the snapshot, the record of the end and the picture.
    assert last.total_files <= usage.files <= last.total_files + 4
    assert last.total_bytes <= usage.bytes


def test_status_agrees_with_the_summary(finished):
    path, summary, _ = finished
    status = farm.status(path)
    assert json.loads(json.dumps(status)) == status
    assert status["state"] == "ended"
    assert status["digest"] == summary.ended.digest
    assert status["evaluated"] == summary.ended.progress.evaluated
    assert status["designs"] == Catalogue.open(path).designs().num_rows


@pytest.mark.parametrize(
    ("overrides", "same"),
    [
        (["execution.batch_size=5"], True),
        (["catalogue.durability=process"], True),
        (["evolution.seed=8"], False),
        (["evolution.migration.lag=2"], False),
        (["evolution.migration.topology=isolated"], False),
        (["evolution.islands=2"], False),
    ],
)
def test_the_digest_depends_on_the_evolution_section_alone(finished, tmp_path, overrides, same):
    _, summary, _ = finished
    other = farm.submit(small_config(*overrides), tmp_path / "run", executor="serial")
    assert (other.ended.digest == summary.ended.digest) == same


def test_a_run_extended_in_steps_equals_one_long_run(finished, tmp_path):
    _, summary, _ = finished
    path = tmp_path / "run"
    farm.submit(small_config("stop.epochs=3"), path, executor="serial")
    farm.resume(path, overrides=["stop.epochs=4"], executor="serial")
    end = farm.resume(path, overrides=["stop.epochs=8"], executor="serial")
    assert end.ended.digest == summary.ended.digest
    assert end.ended.progress == summary.ended.progress


@pytest.mark.parametrize("lag", [1, 3])
def test_a_run_without_snapshots_is_restored_from_its_records(tmp_path, lag):
    path, whole = tmp_path / "run", tmp_path / "whole"
    lagging = f"evolution.migration.lag={lag}"
    farm.submit(small_config(lagging, "stop.epochs=5"), path, executor="serial")
    shutil.rmtree(path / "snapshots")
    end = farm.resume(path, overrides=["stop.epochs=8"], executor="serial")
    assert end.ended.digest == farm.submit(small_config(lagging), whole, executor="serial").ended.digest


def test_resuming_a_finished_run_changes_nothing(finished):
    path, summary, _ = finished
    recorder = Recorder()
    again = farm.resume(path, executor="serial", callbacks=[recorder])
    assert again.ended.digest == summary.ended.digest
    assert not recorder.of(EpochCompleted)


def test_counting_limits_end_at_the_first_epoch_that_reaches_them(tmp_path):
    recorder = Recorder()
    config = small_config("stop.epochs=null", "stop.evaluations=500")
    farm.submit(config, tmp_path / "run", executor="serial", callbacks=[recorder])
    totals = [event.progress.evaluated for event in recorder.of(EpochCompleted)]
    assert totals[-1] >= 500
    assert all(total < 500 for total in totals[:-1])


def test_solids_are_made_of_the_best_printable_designs_and_stored_whole(tmp_path):
    recorder = Recorder()
    config = small_config("solids.max=2", "stop.epochs=3", "evolution.qualified=0.8")
    farm.submit(config, tmp_path / "run", executor="serial", callbacks=[recorder])
    solids = Catalogue.open(tmp_path / "run").solids()
    assert len(solids) == len([event for event in recorder.of(MeshFinished) if event.failure is None]) == 2
    rows = Catalogue.open(tmp_path / "run").designs(["design_id", "fitness", "gap"]).to_pylist()
    qualified = [row for row in rows if row["fitness"] > 0.8]
    wall = config.solids.parameters.wall_mm / config.solids.parameters.size_mm
    best = sorted(qualified, key=lambda row: (row["gap"] > wall, -row["fitness"]))
    assert {solid.design_id for solid in solids} <= {row["design_id"] for row in best[: max(2, len(best) // 2)]}
    assert all({"solid.json", "preview.png", "certificate.json"} < set(solid.files) for solid in solids)
    for solid in solids:
        with Image.open(solid.files["preview.png"]) as picture:
            assert len(picture.convert("RGB").getcolors(1 << 20) or []) > 100
        told = solid.certificate
        assert told["box_mm"] == pytest.approx(solid.facts["box_mm"])
        assert told["wall_mm"] == pytest.approx(solid.facts["wall_measured_mm"])
        assert told["material"] == "silver"
        assert (told["verdict"] == "fail") == any(found["severity"] == "failure" for found in told["findings"])
        assert all(found["remedy"] for found in told["findings"])
    # Resuming makes no more than the budget.
    again = farm.resume(tmp_path / "run", executor="serial")
    assert again.ended.meshes == 0


def test_a_directory_with_another_run_is_refused_and_left_alone(finished):
    path, _, _ = finished
    before = sorted(entry.name for entry in path.rglob("*"))
    with pytest.raises(InputError, match="holds run"):
        farm.submit(small_config("evolution.seed=9"), path, executor="serial")
    assert sorted(entry.name for entry in path.rglob("*")) == before


def test_a_second_run_may_join_a_catalogue_but_not_the_same_run_twice(finished, tmp_path):
    source, _, _ = finished
    path = tmp_path / "run"
    shutil.copytree(source, path)
    second = small_config("evolution.seed=9", "stop.epochs=1")
    farm.submit(second, path, executor="serial", into=True)
    assert len(Catalogue.open(path).runs()) == 2
    with pytest.raises(InputError, match="already"):
        farm.submit(second, path, executor="serial", into=True)


def test_what_decides_the_designs_cannot_change_on_resume(finished):
    path, _, _ = finished
    with pytest.raises(InputError, match="evolution section"):
        farm.resume(path, overrides=["evolution.seed=9"], executor="serial")
    with pytest.raises(InputError, match=r"catalogue\.keep"):
        farm.resume(path, overrides=["catalogue.keep=qualified"], executor="serial")


def test_a_run_of_another_version_is_read_as_ever_but_does_not_go_on(tmp_path, monkeypatch):
    path = tmp_path / "run"
    with monkeypatch.context() as older:
        older.setattr("fractal_farm.config.IDENTITY_VERSION", 1)
        summary = farm.submit(small_config("stop.epochs=1"), path, executor="serial")
    before = sorted(path.rglob("*"))
    for overrides in ([], ["stop.epochs=9"]):
        with pytest.raises(InputError, match=r"another version of the farm.*cannot go on.*farm submit") as error:
            farm.resume(path, overrides=overrides, executor="serial")
        assert "--set" not in str(error.value)
    assert sorted(path.rglob("*")) == before
    status = farm.status(path)
    assert (status["digest"], status["damage"]) == (summary.ended.digest, [])
    assert Catalogue.open(path).designs().num_rows == status["designs"]
    assert verify(path, "full").findings == ()


def test_a_configuration_with_fields_of_another_version_is_no_damage(tmp_path, monkeypatch):
    path = tmp_path / "run"
    config = small_config("stop.epochs=1")
    summary = farm.submit(config, path, executor="serial")
    record_settings(path, config.run_id, config.to_dict() | {"weather": "fine"})
    with pytest.raises(InputError, match=r"another version of the farm.*weather"):
        farm.resume(path, executor="serial")
    status = farm.status(path)
    assert (status["digest"], status["damage"]) == (summary.ended.digest, [])
    assert "weather" not in report_page(path)


def test_status_tells_the_limits_that_the_last_session_was_given(tmp_path):
    path = tmp_path / "run"
    farm.submit(small_config("stop.epochs=1"), path, executor="serial")
    farm.resume(path, overrides=["stop.epochs=2", "stop.hours=3"], executor="serial")
    for _ in range(2):
        stop = farm.status(path)["stop"]
        assert {name: limit for name, limit in stop.items() if limit is not None} == {"epochs": 2, "hours": 3.0}
        shutil.rmtree(path / "logs", ignore_errors=True)  # which may be lost


@pytest.mark.parametrize(
    ("overrides", "options", "words"),
    [
        (["catalogue.min_free_gb=900000"], {}, "GB free"),
        ([], {"executor": "ray", "address": "127.0.0.1:9"}, "nothing answers"),
        ([], {"executor": "serial", "address": "127.0.0.1:9"}, "serial executor"),
        ([], {"address": "somewhere"}, "host:port"),
    ],
)
def test_a_run_that_cannot_start_writes_nothing(tmp_path, overrides, options, words):
    with pytest.raises(InputError, match=words) as error:
        farm.submit(small_config(*overrides), tmp_path / "run", **options)
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_restoring_needs_the_records_alone(finished):
    path, summary, _ = finished
    schedule, progress, _ = restore(small_config(), path)
    assert schedule.complete == 7
    assert progress == summary.ended.progress
    assert [pair[1] for pair in schedule.ready()] == [8, 8, 8]
    assert isinstance(summary.ended, RunEnded)
