"""Merging parts: the same rows, records and digest before, after and at any instant in between."""

import json
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pyarrow.compute as pc
import pytest

from fractal_farm.catalogue import (
    Catalogue,
    committed_records,
    committed_until,
    compaction,
    create_run,
    parts,
    remove_orphans,
    run_lock,
)
from fractal_farm.catalogue.compaction import compact, compact_all
from fractal_farm.catalogue.layout import DESIGNS, crc32c
from fractal_farm.catalogue.parts import list_parts, read_rows, replaced_parts
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.catalogue.shards import group_metadata
from fractal_farm.catalogue.verify import Remakers, repair, verify
from fractal_farm.catalogue.verify.bit_flips import flipped
from fractal_farm.errors import FarmError, InputError
from tests.catalogue import under_merging
from tests.catalogue.examples import BORN_IN_AN_EPOCH, RUN, commit_epochs, designs, files, genome, records, writer

HOUSE = Path(__file__).resolve().parents[2]
NOTHING_TO_REMAKE = Remakers({}, lambda design_id, parameters_hash: {})


def told(root):
    """All that a catalogue tells."""
    catalogue = Catalogue.open(root)
    clouds = catalogue.dense_points()
    return {
        "digest": catalogue.digest(),
        "rows": catalogue.designs(ancestors=True).to_pylist(),
        "records": list(committed_records(root, RUN)),
        "clouds": clouds[:].tobytes(),
    }


@pytest.fixture
def grown(root):
    """Twelve commits of two writers, with repetitions, ancestors and a commit without rows."""
    create_run(root, RUN, {"note": "made by hand"})
    used = commit_epochs(root, 0, 6)
    kinds = ["ancestor" if number % 3 else "design" for number in range(56, 64)]
    given, clouds = designs(range(56, 64), kind=kinds)
    kept = [number % 3 == 0 for number in range(56, 64)]
    few = type(clouds)(clouds.points[kept], clouds.origin[kept], clouds.scale[kept])
    used.commit(given, few, records(7), (7, 7))
    used.commit(*designs([]), records(8), (8, 8))
    again = writer(root, attempt=1)
    for epoch in range(8, 11):
        again.commit(*designs(range(8 * epoch - 3, 8 * epoch + 5)), records(epoch), (epoch, epoch))
    return root


def test_a_compacted_catalogue_tells_the_same_from_fewer_files(grown):
    before = told(grown)
    usage = Catalogue.open(grown).usage()
    done = compact_all(grown)
    assert (done.before, done.after) == (12, 2)
    locks = sum((grown / "runs" / RUN / name).stat().st_size for name in ("lock", "fence"))
    assert done.bytes == Catalogue.open(grown).usage().bytes - usage.bytes - locks
    assert [part.is_merged for part in list_parts(grown)] == [True, True]
    assert told(grown) == before
    assert verify(grown, "full").findings == ()
    assert committed_until(grown, RUN) == 10
    assert compact_all(grown) == compaction.Compaction()
    for number in (0, 30, 60):
        assert Catalogue.open(grown).genome(genome(number).design_id[:9]) == genome(number)


def test_a_writer_goes_on_after_its_parts_were_merged_and_merged_parts_merge_again(root):
    used = commit_epochs(root, 0, 3)
    compact(root, RUN)
    for epoch in (4, 5):
        used.commit(*designs(range(8 * epoch, 8 * epoch + 8)), records(epoch), (epoch, epoch))
    expected = told(root)
    assert [(part.seq, part.last) for part in list_parts(root)] == [(0, 3), (4, 4), (5, 5)]
    compact(root, RUN)
    assert [(part.seq, part.last) for part in list_parts(root)] == [(0, 5)]
    assert told(root) == expected


def test_parts_of_many_row_groups_are_read_where_the_wanted_rows_lie(root, monkeypatch):
    from fractal_farm.catalogue import parts, scan

    monkeypatch.setattr(parts, "ROW_GROUP", 7)
    monkeypatch.setattr(scan, "ROW_GROUP", 7)
    commit_epochs(root, 0, 9)
    expected = told(root)
    names = ["design_id", "fitness", "parents", "descriptor"]
    before = [Catalogue.open(root).select(names, limit=limit)[0].to_pylist() for limit in (1, 9, 50, 80)]
    compact(root, RUN)
    assert told(root) == expected
    assert [Catalogue.open(root).select(names, limit=limit)[0].to_pylist() for limit in (1, 9, 50, 80)] == before


def test_large_parts_are_left_alone_and_gaps_are_not_bridged(root, monkeypatch):
    monkeypatch.setattr(compaction, "LARGE_ROWS", 3 * BORN_IN_AN_EPOCH)
    commit_epochs(root, 0, 9)
    lost = list_parts(root)[4]
    (root / DESIGNS / lost.file_name).unlink()
    compact(root, RUN)
    assert [(part.seq, part.last) for part in list_parts(root)] == [(0, 2), (3, 3), (5, 7), (8, 9)]
    assert committed_until(root, RUN) == 3


def test_what_a_dead_merge_left_is_passed_over_found_and_removed(grown):
    before, names = told(grown), [part.file_name for part in list_parts(grown)]
    kept = {name: (grown / DESIGNS / name).read_bytes() for name in names}
    compact(grown, RUN)
    for name in names[::2]:
        (grown / DESIGNS / name).write_bytes(kept[name])
    assert told(grown) == before
    report = verify(grown, "full")
    assert report.exit_code == 0
    assert {finding.path.rpartition("/")[2] for finding in report.findings} == set(names[::2])
    assert [name.file_name for name in replaced_parts(grown)] == sorted(names[::2])
    copy = shutil.copytree(grown, grown.parent / "copy")
    assert remove_orphans(grown, RUN) == len(names[::2])
    assert compact_all(copy).before == len(names[::2])
    for root in (grown, copy):
        assert verify(root, "full").findings == ()
        assert told(root) == before


def test_every_flipped_bit_of_a_merged_part_is_found_and_flipped_back(grown):
    before = told(grown)
    compact(grown, RUN)
    path = max((grown / DESIGNS).iterdir(), key=lambda path: path.stat().st_size)
    whole = path.read_bytes()
    for bit in range(5, 8 * len(whole), 8 * len(whole) // 40):
        path.write_bytes(flipped(whole, bit))
        assert verify(grown, "quick").exit_code == 1
        try:
            assert told(grown) == before  # a bit that readers do not need
        except FarmError as error:
            assert "damaged" in str(error)  # noqa: PT017
    report = repair(grown, "quick", NOTHING_TO_REMAKE)
    assert report.exit_code == 0
    assert path.read_bytes() == whole


def test_clouds_of_a_merged_part_grow_again(root):
    create_run(root, RUN, {"note": "made by hand"})
    commit_epochs(root, 0, 9)
    before = files(root)
    compact(root, RUN)
    cloud = next(root.glob("clouds/*/points/c.3.0.0"))
    whole = cloud.read_bytes()
    cloud.write_bytes(flipped(whole, 8 * (len(whole) // 3)))
    (finding,) = verify(root, "full").findings
    assert set(finding.designs) <= {genome(number).design_id for number in range(24, 32)}
    for path in root.glob("clouds/*/*/c.*"):
        path.unlink()
    assert repair(root, "quick", NOTHING_TO_REMAKE).exit_code == 0
    clouds = {name: size for name, size in before.items() if name.startswith("clouds/")}
    assert {name: size for name, size in files(root).items() if name.startswith("clouds/")} == clouds
    assert verify(root, "full").findings == ()


def test_readers_in_the_middle_see_everything_once(root, monkeypatch):
    monkeypatch.setattr(compaction, "LARGE_ROWS", 16 * BORN_IN_AN_EPOCH)
    create_run(root, RUN, {"note": "made by hand"})
    commit_epochs(root, 0, 127)
    catalogue = Catalogue.open(root)
    expected, best = catalogue.digest(), catalogue.select(["design_id"], limit=9)[0]
    until = committed_until(root, RUN)
    merging = threading.Thread(target=compact, args=(root, RUN))
    merging.start()
    looks = 0
    while merging.is_alive() or not looks:
        assert Catalogue.open(root).digest() == expected
        assert catalogue.select(["design_id"], limit=9)[0].equals(best)
        assert catalogue.points(genome(1000).design_id).shape == (32, 3)
        assert committed_until(root, RUN) == until
        assert verify(root, "quick").exit_code == 0
        looks += 1
    merging.join()
    assert len(list_parts(root)) == 8
    assert Catalogue.open(root).digest() == expected


def test_a_part_merged_away_while_it_is_checked_is_read_all_the_same(grown, monkeypatch):
    compact(grown, RUN)
    name = next(part for part in list_parts(grown) if part.is_merged)
    expected = parts.open_part(grown, name).read()

    def checked_as_another_merge_removes_it(content):
        (grown / DESIGNS / name.file_name).unlink(missing_ok=True)
        return crc32c(content)

    monkeypatch.setattr(parts, "crc32c", checked_as_another_merge_removes_it)
    file = parts.open_part(grown, name)
    assert not (grown / DESIGNS / name.file_name).exists()
    assert file.read().equals(expected)
    with pytest.raises(parts.PartGoneError, match="No such file"):
        parts.open_part(grown, name)


@pytest.mark.parametrize("kills", [8, pytest.param(60, marks=pytest.mark.slow)])
def test_a_merge_killed_again_and_again_loses_nothing_and_repeats_nothing(root, kills):
    create_run(root, RUN, {"note": "under fire"})
    commit_epochs(root, 0, under_merging.EPOCHS - 1)
    expected = told(root)
    command = [sys.executable, "-m", "tests.catalogue.under_merging", str(root), str(kills)]
    fire = subprocess.Popen(
        command, cwd=HOUSE, env=os.environ | {"PYTHONPATH": str(HOUSE)}, stdout=subprocess.PIPE, text=True
    )
    while fire.poll() is None:
        assert Catalogue.open(root).digest() == expected["digest"]
    assert fire.returncode == 0
    outcome = json.loads(fire.stdout.read().splitlines()[-1])
    assert outcome["kills"] == kills
    assert told(root) == expected
    assert verify(root, "full").exit_code == 0
    compact_all(root)
    remove_orphans(root, RUN)
    assert told(root) == expected
    assert [(part.seq, part.last) for part in list_parts(root)] == [(0, under_merging.EPOCHS - 1)]
    assert not [name for name in files(root) if name.endswith(".partial")]


def test_a_live_run_is_not_merged_by_others(grown):
    with run_lock(grown, RUN), pytest.raises(InputError, match="in the hands of"):
        compact_all(grown)


def test_a_catalogue_from_before_tells_older_readers_that_they_cannot_read_it(grown):
    old = {"format": "1.0", "min_reader": "1.0", "features": []}
    (grown / "zarr.json").write_bytes(group_metadata(old))
    assert verify(grown, "full").findings == ()
    compact(grown, RUN)
    about = json.loads((grown / "zarr.json").read_text())["attributes"]["fractal_farm"]
    assert about["features"] == ["merged-parts"]
    assert verify(grown, "full").findings == ()


def test_rows_of_a_merged_part_are_sorted_best_first(grown):
    compact(grown, RUN)
    for part in list_parts(grown):
        rows = read_rows(grown, part, DESIGN_SCHEMA.names)
        keys = rows.select(["fitness", "design_id"])
        order = pc.sort_indices(keys, [("fitness", "descending"), ("design_id", "ascending")])
        assert keys.take(order).equals(keys)
