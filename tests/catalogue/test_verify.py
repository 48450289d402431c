"""`verify` and `repair` on a real catalogue: every bit counts, and what a genome can grow again is never lost."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numcodecs import blosc

from fractal_farm.catalogue import Catalogue, create_run, read_run, run_lock, shards
from fractal_farm.catalogue.documents import encoded_document, sealed_page
from fractal_farm.catalogue.layout import crc32c
from fractal_farm.catalogue.settings import record_settings
from fractal_farm.catalogue.shards import group_metadata
from fractal_farm.catalogue.verify import LEVELS, Remakers, content, repair, verify
from fractal_farm.catalogue.verify import contents as contents_of
from fractal_farm.catalogue.verify.bit_flips import flipped, unflipped
from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError, InputError
from fractal_farm.farm import resume, run, submit
from fractal_farm.farm.sheet import write_sheet
from fractal_farm.fitness import evaluate, formula
from fractal_farm.ifs.quantised_cloud import quantised_attractors
from tests.catalogue import under_fire
from tests.catalogue.examples import RUN, designs, genome, records, writer
from tests.farm.runs import small_config

SOLID = {"solid.json": b'{"size_mm": 30}', "solid.stl": bytes(range(256)) * 8}
KINDS = (
    "identity.json",
    "zarr.json",
    "clouds/zarr.json",
    "clouds/*/zarr.json",
    "clouds/*/points/zarr.json",
    "clouds/*/points/c.*",
    "clouds/*/transform/c.*",
    "clouds/*/design_id/c.*",
    "manifest/designs/*",
    "runs/*/run.json",
    "runs/*/final*",
    "runs/*/settings*",
    "runs/*/lock",
    "runs/*/fence",
    "snapshots/*",
    "solids/*/*/*",
    "catalogue.png",
    "report.html",
)
"""Every kind of file that a catalogue vouches for."""


def remakers(root):
    """As the command has them, but for solids, which are quick here."""

    def sheet():
        (run_id,) = [info.run_id for info in Catalogue.open(root).runs()]
        write_sheet(root, RunConfig.from_dict(read_run(root, run_id)["config"]))

    return Remakers({"catalogue.png": sheet}, lambda design_id, parameters_hash: SOLID)


@pytest.fixture(scope="module")
def grown(tmp_path_factory):
    """A finished run with several parts, a solid and a report; read-only by agreement."""
    root = tmp_path_factory.mktemp("runs") / "grown"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "PART_DESIGNS", 60)
        submit(small_config(), root, executor="serial")
        record_settings(root, small_config().run_id, small_config("stop.epochs=8", "stop.hours=1").to_dict())
    catalogue = Catalogue.open(root)
    catalogue.add_solid(catalogue.designs(["design_id"]).column(0)[0].as_py(), "30x08", SOLID)
    (root / "identity.json").write_bytes(encoded_document({"catalogue": 32 * "7"}))
    (root / "report.html").write_bytes(sealed_page("<p>How it went</p>"))
    assert len(list((root / "manifest/designs").iterdir())) > 2
    return root


@pytest.fixture
def root(grown, tmp_path):
    """A copy of it that may be damaged."""
    return shutil.copytree(grown, tmp_path / "copy")


@pytest.fixture
def empty(tmp_path):
    """A catalogue with a run that has not begun."""
    path = Catalogue.create(tmp_path / "my.farm").path
    create_run(path, RUN, {"note": "made by hand"})
    return path


def some(root, pattern):
    return sorted(path for path in root.glob(pattern) if path.is_file())[0]


def contents(root):
    """All files that count: relative path -> bytes."""
    files = (path for path in root.rglob("*") if path.is_file() and path.name not in ("lock", "fence"))
    named = {path.relative_to(root).as_posix(): path.read_bytes() for path in files}
    return {name: data for name, data in named.items() if not name.startswith(("logs/", "quarantine/"))}


@pytest.mark.parametrize("level", LEVELS)
def test_a_sound_catalogue_is_sound_at_every_level(grown, level):
    report = verify(grown, level)
    assert report.findings == ()
    assert report.exit_code == 0
    assert report.digest == (None if level == "quick" else Catalogue.open(grown).digest())


def test_each_of_200_flipped_bits_is_found(root):
    chance = random.Random(200)
    for number in range(200):
        path = chance.choice(sorted(each for each in root.glob(KINDS[number % len(KINDS)]) if each.is_file()))
        content = path.read_bytes()
        bit = chance.randrange(8 * len(content))
        path.write_bytes(flipped(content, bit))
        report = verify(root, "full")
        assert report.exit_code == 1, f"bit {bit} of {path}"
        relative = path.relative_to(root).as_posix()
        assert any(relative.startswith(finding.path) for finding in report.findings)
        path.write_bytes(content)
    assert verify(root, "full").findings == ()


@pytest.mark.parametrize(
    "pattern", [kind for kind in KINDS if not kind.endswith(("snapshots/*", "html", "lock", "fence"))]
)
def test_a_flipped_bit_is_flipped_back(root, pattern):
    before = contents(root)
    path = some(root, pattern)
    path.write_bytes(flipped(path.read_bytes(), 8 * (path.stat().st_size // 2) + 3))
    report = repair(root, "full", remakers(root))
    assert report.exit_code == 0
    assert contents(root) == before


def test_all_clouds_grow_again_bit_for_bit(root):
    before = contents(root)
    for directory in (root / "clouds").glob("*/*/"):
        shutil.rmtree(directory)
    report = repair(root, "quick", remakers(root))
    assert report.exit_code == 0
    ids = set(Catalogue.open(root).designs(["design_id"]).column(0).to_pylist())
    assert ids <= {identity for finding in report.findings for identity in finding.designs}
    assert contents(root) == before


@pytest.mark.parametrize("level", ["quick", "full", pytest.param("deep", marks=pytest.mark.slow)])
@pytest.mark.parametrize("pattern", KINDS)
def test_garbage_is_a_finding_and_no_traceback(root, pattern, level):
    path = some(root, pattern)
    content = path.read_bytes()
    held = pattern in ("runs/*/lock", "runs/*/fence")  # may be empty
    read_in_full = level == "quick" and pattern in ("snapshots/*", "catalogue.png", "report.html")
    for torn in (content[:-1], b"", b"[" * len(content), b"\0" * len(content), content + b"x"):
        path.write_bytes(torn)
        same_size = level == "quick" and len(torn) == len(content)
        assert verify(root, level).exit_code == 1 or read_in_full or same_size or (held and not torn)
    path.unlink()
    dispensable = ("identity.json", "snapshots/*", "report.html", "runs/*/final*", "runs/*/settings*")
    assert verify(root, level).exit_code == 1 or pattern in dispensable or held
    path.mkdir()
    assert verify(root, level).exit_code == 1


def test_a_repair_never_deletes_and_can_be_repeated(root):
    part = some(root, "manifest/designs/*")
    torn = part.read_bytes()[:-1]
    part.write_bytes(torn)
    clouds = set(contents(root)) - {part.relative_to(root).as_posix()}
    for _ in range(2):
        report = repair(root, "full", remakers(root))
        assert report.exit_code == 3
    aside = [path.relative_to(root / "quarantine") for path in (root / "quarantine").rglob("*") if path.is_file()]
    assert [(root / "quarantine" / path).read_bytes() for path in aside if path.name == part.name] == [torn]
    kept = {path.as_posix().partition("/")[2] for path in aside}
    assert {name for name in clouds if not (root / name).exists()} <= kept
    assert any("farm resume" in finding.remedy for finding in report.findings)


@pytest.mark.slow
def test_a_repair_that_is_killed_is_simply_repeated(root):
    before = contents(root)
    chance = random.Random(6)
    for path in [*(root / "clouds").rglob("c.*"), some(root, "manifest/designs/*"), some(root, "runs/*/run.json")]:
        path.write_bytes(flipped(path.read_bytes(), 8 * chance.randrange(path.stat().st_size)))
    command = [sys.executable, "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())"]
    for _ in range(12):
        process = subprocess.Popen([*command, "verify", str(root), "--repair"], stdout=subprocess.DEVNULL)
        while not verify_is_at_work(root, process):
            time.sleep(0.001)
        time.sleep(chance.uniform(0.0, 0.15))
        process.kill()
        process.wait()
        assert verify(root, "quick").exit_code in (0, 1)
    assert repair(root, "full", remakers(root)).exit_code == 0
    assert contents(root) == before


def verify_is_at_work(root, process):
    (lock,) = root.glob("runs/*/lock")
    return lock.read_text().startswith(f"process {process.pid} ") or process.poll() is not None


@pytest.mark.parametrize("lost", [0, -1])
def test_a_lost_part_grows_again_when_the_run_is_resumed(grown, root, lost):
    sorted((root / "manifest/designs").iterdir())[lost].write_bytes(b"")
    assert repair(root, "full", remakers(root)).exit_code == 3
    ended = resume(root, executor="serial").ended
    assert ended.digest == Catalogue.open(grown).digest()
    assert ended.progress.epochs == 8
    assert verify(root, "deep").findings == ()


PUTTING = """
import sys, time
from pathlib import Path
from fractal_farm.catalogue import Catalogue, run_ids, run_lock
root = Path(sys.argv[1])
catalogue = Catalogue.open(root)
with run_lock(root, run_ids(root)[0]):
    print("live", flush=True)
    for number in range(100_000):
        catalogue.add_solid(f"{number:032x}", "30x08", {"solid.json": b"{}", "solid.stl": bytes(2000)})
"""


def test_solids_that_are_being_put_are_no_findings(root):
    with subprocess.Popen([sys.executable, "-c", PUTTING, str(root)], stdout=subprocess.PIPE) as putting:
        try:
            putting.stdout.readline()
            solids = []
            for _ in range(25):
                assert verify(root, "full").findings == ()
                solids.append(sum(1 for _ in (root / "solids").iterdir()))
        finally:
            putting.kill()
    assert solids[-1] > solids[0]


def test_a_solid_that_is_finished_while_it_is_looked_at_is_sound(root, monkeypatch):
    partial = root / "solids" / ("0" * 32) / ".30x08.1f.partial"
    partial.mkdir(parents=True)
    walk = os.walk

    def meanwhile(top, **options):
        for place, folders, names in walk(top, **options):
            if partial.name in folders:
                partial.rmdir()
            yield place, folders, names

    monkeypatch.setattr(contents_of.os, "walk", meanwhile)
    assert verify(root, "full").findings == ()


def test_a_run_that_ends_while_it_is_looked_at_is_sound(root, monkeypatch):
    ends = {path: path.read_bytes() for path in root.glob("runs/*/final*")}
    part = sorted((root / "manifest/designs").iterdir())[-1]
    last = part.read_bytes()
    for path in (part, *ends):
        path.unlink()
    walk = contents_of._walk

    def meanwhile(contents):
        part.write_bytes(last)
        for path, end in ends.items():
            path.write_bytes(end)
        walk(contents)

    monkeypatch.setattr(contents_of, "_walk", meanwhile)
    with run_lock(root, next(iter(ends)).parent.name):
        assert verify(root, "full").findings == ()


def test_what_a_killed_process_leaves_is_noted_but_is_no_damage(root):
    (writer_directory,) = (root / "clouds").glob("*-*")
    left = [
        writer_directory / "points" / "c.77.0.0",
        writer_directory / "points" / ".c.78.0.0.1.partial",
        root / "manifest/designs" / f".{writer_directory.name}~00000009.parquet.1.partial",
    ]
    for path in left:
        path.write_bytes(b"half")
    half = root / "solids" / ("0" * 32) / ".hash.1.partial"
    half.mkdir(parents=True)
    report = verify(root, "full")
    assert {finding.path for finding in report.findings} == {
        path.relative_to(root).as_posix() for path in [*left, half]
    }
    assert report.exit_code == 0
    assert repair(root, "full", remakers(root)).exit_code == 0
    assert not any(path.exists() for path in [*left, half])
    assert verify(root, "full").findings == ()


@pytest.mark.parametrize(
    "stranger", ["manifest/designs/part.parquet", "clouds/0000-x/points/c.0.0.0", "snapshots/mine", "manifest/x/y"]
)
def test_a_stranger_among_our_files_is_damage(root, stranger):
    (root / stranger).parent.mkdir(parents=True, exist_ok=True)
    (root / stranger).write_bytes(b"")
    assert [finding.path for finding in verify(root, "quick").findings] == [stranger]
    assert verify(root, "quick").exit_code == 1
    assert repair(root, "quick", remakers(root)).exit_code == 0


def test_a_live_run_is_verified_but_not_repaired(root):
    (writer_directory,) = (root / "clouds").glob("*-*")
    (writer_directory / "points" / "c.77.0.0").write_bytes(b"not yet committed")
    (run_id,) = [info.run_id for info in Catalogue.open(root).runs()]
    with run_lock(root, run_id):
        assert verify(root, "full").findings == ()
        with pytest.raises(InputError, match=f"run {run_id} is in the hands of process {os.getpid()}"):
            repair(root, "full", remakers(root))


def test_several_runs_are_sound_together(root):
    submit(small_config("evolution.seed=8"), root, executor="serial", into=True)
    assert verify(root, "deep").findings == ()


def test_a_catalogue_from_before_documents_were_sealed_is_sound(root):
    (root / "zarr.json").write_bytes(group_metadata({"format": "1.0", "min_reader": "1.0", "features": []}))
    (root / "clouds/zarr.json").write_bytes(group_metadata({"format": "1.0"}))
    assert verify(root, "full").findings == ()
    (root / "zarr.json").write_bytes(group_metadata({"format": "1.0", "min_reader": "0.0", "features": []}))
    assert verify(root, "quick").exit_code == 1


def test_every_bit_of_the_root_documents_counts(root):
    for key in ("zarr.json", "clouds/zarr.json"):
        content = (root / key).read_bytes()
        assert shards.is_root_document(key, content)
        assert not any(shards.is_root_document(key, flipped(content, bit)) for bit in range(8 * len(content)))
    about = (root / "zarr.json").read_bytes()
    (root / "zarr.json").write_bytes(about.replace(b'"min_reader": "1.0"', b'"min_reader": "9.0"'))
    assert verify(root, "quick").exit_code == 1


def test_a_catalogue_of_a_newer_format_is_refused(root):
    newer = {"format": "9.0", "min_reader": "9.0", "features": []}
    (root / "zarr.json").write_bytes(shards.sealed_group_metadata(newer))
    with pytest.raises(InputError, match="install a newer"):
        verify(root, "quick")


def test_what_is_no_catalogue_is_refused(tmp_path):
    for path in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(InputError):
            verify(path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        verify(tmp_path / "file")


def test_another_compressor_gives_other_bytes_of_the_same_clouds(empty, monkeypatch):
    with monkeypatch.context() as older:
        compress = blosc.compress
        older.setattr(blosc, "compress", lambda data, *_: compress(data, b"lz4", 1, 1, 0, 2))
        clouds = quantised_attractors([genome(number) for number in range(4)], 2000)
        writer(empty, n_points=2000).commit(designs(range(4))[0], clouds, records(0), (0, 0))
    before = Catalogue.open(empty).dense_points()[:]
    damaged = some(empty, "clouds/*/points/c.*")
    damaged.write_bytes(flipped(damaged.read_bytes(), 3))
    report = repair(empty, "full", remakers(empty))
    assert report.exit_code == 0
    assert verify(empty, "full").findings == ()
    np.testing.assert_array_equal(Catalogue.open(empty).dense_points()[:], before)
    document = some(empty, "manifest/mendings/*")
    document.write_bytes(flipped(document.read_bytes(), 100))
    assert verify(empty, "full").exit_code == 1
    assert repair(empty, "full", remakers(empty)).exit_code == 0


def test_clouds_that_do_not_grow_again_are_lost_and_the_others_stay(empty):
    given = writer(empty, n_points=under_fire.N_POINTS)
    numbers, clouds, blob = under_fire.epoch_content(6)
    given.commit(designs(numbers)[0], clouds, blob, (0, 0))
    shard = some(empty, "clouds/*/points/c.*")
    before = shard.read_bytes()
    shard.write_bytes(flipped(before, 8 * 40))
    report = repair(empty, "full", remakers(empty))
    assert report.exit_code == 3
    (lost,) = [finding for finding in report.findings if finding.lost]
    assert len(lost.designs) == 1
    (remaining,) = verify(empty, "quick").findings
    assert remaining.designs == lost.designs
    catalogue = Catalogue.open(empty)
    for row in catalogue.designs(["design_id"]).column(0).to_pylist():
        if row in lost.designs:
            with pytest.raises(FarmError, match="missing or damaged"):
                catalogue.points(row)
        else:
            assert catalogue.points(row).shape == (under_fire.N_POINTS, 3)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({}, "similarity_dimension"),  # the examples' scores are made up
        ({"parents": [["f" * 32], [], [], []]}, "parent ffff"),
    ],
)
def test_deep_tells_what_checksums_cannot(empty, changes, told):
    writer(empty).commit(*designs(range(4), **changes), records(0), (0, 0))
    assert verify(empty, "full").findings == ()
    report = verify(empty, "deep")
    assert report.exit_code == 1
    assert any(told in finding.problem for finding in report.findings)


def test_scores_of_another_version_of_the_fitness_are_told_and_not_compared(root, monkeypatch):
    def other_scores(genomes, n_points, formula):
        scores = evaluate(genomes, n_points, formula)
        return replace(scores, fitness=scores.fitness / 2)

    monkeypatch.setattr(content, "evaluate", other_scores)
    assert verify(root, "deep").exit_code == 1
    monkeypatch.setattr(formula, "EVALUATOR_VERSION", "scores-0")
    report = verify(root, "deep")
    assert report.exit_code == 0
    assert len(report.findings) == len(list((root / "manifest/designs").iterdir()))
    assert all("scored by another version of the fitness (scores-1-" in told.problem for told in report.findings)


def test_deep_finds_clouds_of_other_designs(empty):
    table, clouds = designs(range(4))
    clouds.points[[0, 1]] = clouds.points[[1, 0]]
    writer(empty).commit(table, clouds, records(0), (0, 0))
    assert verify(empty, "full").findings == ()
    wrong = [finding for finding in verify(empty, "deep").findings if "other points" in finding.problem]
    assert {finding.designs[0] for finding in wrong} == set(table.column("design_id").to_pylist()[:2])


def test_the_end_of_a_run_vouches_for_its_last_part(root):
    (document,) = (root / "runs").glob("*/final*")
    run_id = document.parent.name
    part = sorted((root / "manifest/designs").iterdir())[-1]
    part.unlink()
    problems = [finding.problem for finding in verify(root, "quick").findings if finding.path == f"runs/{run_id}"]
    assert len(problems) == 1
    assert problems[0].startswith("no manifest part holds epochs")


@given(st.binary(min_size=1, max_size=300), st.data())
def test_the_checksum_tells_which_bit_was_flipped(content, data):
    bit = data.draw(st.integers(0, 8 * len(content) - 1))
    assert unflipped(flipped(content, bit), crc32c(content)) == content


def test_two_flipped_bits_are_not_taken_for_one():
    content = bytes(1000)
    assert unflipped(flipped(flipped(content, 17), 4000), crc32c(content)) is None
