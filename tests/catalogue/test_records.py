import pytest

from fractal_farm.catalogue import (
    Catalogue,
    committed_records,
    latest_snapshot,
    remove_orphans,
    write_snapshot,
)
from fractal_farm.catalogue.durable import PARTIAL
from fractal_farm.errors import FarmError
from tests.catalogue.examples import RUN, commit_epochs, designs, files, records, writer


def test_records_come_back_in_order_of_epochs(root):
    used = writer(root)
    for first, last in [(4, 5), (0, 1), (2, 3), (6, 6)]:
        used.commit(designs([])[0], None, records(first), (first, last))
    assert list(committed_records(root, RUN)) == [
        ((0, 1), records(0)),
        ((2, 3), records(2)),
        ((4, 5), records(4)),
        ((6, 6), records(6)),
    ]
    assert [epochs for epochs, _ in committed_records(root, RUN, after=3)] == [(4, 5), (6, 6)]


def test_any_bytes_come_back_as_they_were(root):
    used = writer(root)
    blobs = [b"", b"\x00", bytes(range(256)) * 600, b"\xff\xfe not text"]
    for epoch, blob in enumerate(blobs):
        used.commit(*designs([epoch]), blob, (epoch, epoch))
    assert [blob for _, blob in committed_records(root, RUN)] == blobs


def test_two_commits_of_the_same_epochs_that_differ_are_both_given(root):
    used = writer(root)
    for blob in (b"islands 0 to 3", b"islands 4 to 7", b"islands 0 to 3"):
        used.commit(designs([])[0], None, blob, (0, 0))
    assert [blob for _, blob in committed_records(root, RUN)] == [b"islands 0 to 3", b"islands 4 to 7"]


def test_another_run_has_records_of_its_own(root):
    writer(root).commit(designs([])[0], None, b"one", (0, 0))
    writer(root, run_id="0123").commit(designs([])[0], None, b"other", (0, 0))
    assert list(committed_records(root, "0123")) == [((0, 0), b"other")]


def test_records_end_where_a_part_is_missing(root):
    commit_epochs(root, 0, 4)
    parts = sorted((root / "manifest/designs").iterdir())
    parts[2].unlink()
    assert [epochs for epochs, _ in committed_records(root, RUN)] == [(0, 0), (1, 1)]
    parts[0].unlink()
    assert list(committed_records(root, RUN)) == []


def test_epochs_that_were_committed_again_in_other_groups_are_given_once(root):
    used = writer(root)
    for first, last in [(0, 1), (4, 5), (6, 7), (2, 6), (7, 9)]:
        used.commit(designs([])[0], None, records(first), (first, last))
    assert [epochs for epochs, _ in committed_records(root, RUN)] == [(0, 1), (2, 6), (6, 7), (7, 9)]


def unfinished(root, run):
    """What a killed writer may leave: half-written files, and clouds whose part never appeared."""
    (live,) = root.glob(f"clouds/{run}-*")
    dead = root / "clouds" / f"{run}-node-9-00000000" / "points"
    dead.mkdir(parents=True)
    left = [
        live / "points" / "c.77.0.0",
        live / "points" / f".c.78.0.0.1{PARTIAL}",
        live / "transform" / "c.77.0",
        dead / "zarr.json",
        dead / "c.0.0.0",
        root / "manifest/designs" / f".{run}-node-0-x~00000009~000001~00000000.parquet.1{PARTIAL}",
        root / "snapshots" / f".{run}~00000001~00000000.snapshot.1{PARTIAL}",
    ]
    for path in left:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"half")
    return left, dead.parent


def test_orphans_of_this_run_are_removed_and_nothing_else(root):
    other = "fedcba9876543210"
    commit_epochs(root, 0, 2)
    commit_epochs(root, 0, 1, run_id=other)
    kept = files(root)
    orphans, directory = unfinished(root, RUN)
    theirs, _ = unfinished(root, other)
    assert remove_orphans(root, RUN) == len(orphans)
    assert not directory.exists()
    expected = kept | {path.relative_to(root).as_posix(): 4 for path in theirs}
    assert files(root) == expected
    assert remove_orphans(root, RUN) == 0
    Catalogue.open(root).dense_points()[:]


def test_with_a_damaged_part_nothing_is_removed(root):
    commit_epochs(root, 0, 1)
    unfinished(root, RUN)
    part = sorted((root / "manifest/designs").glob("*.parquet"))[0]
    part.write_bytes(part.read_bytes()[:-1])
    before = files(root)
    with pytest.raises(FarmError, match="damaged"):
        remove_orphans(root, RUN)
    assert files(root) == before


def test_a_solid_that_nobody_finishes_is_an_orphan(root):
    half = root / "solids" / ("0" * 32) / f".hash.1{PARTIAL}"
    half.mkdir(parents=True)
    (half / "mesh.stl").write_bytes(b"half")
    assert remove_orphans(root, RUN) == 1
    assert not half.exists()


def test_the_newest_three_snapshots_are_kept(root):
    for epoch in (2, 4, 6, 8, 10):
        write_snapshot(root, RUN, epoch, f"after {epoch}".encode())
    write_snapshot(root, "fedcba9876543210", 3, b"other")
    assert len(list((root / "snapshots").iterdir())) == 4
    assert latest_snapshot(root, RUN) == (10, b"after 10")
    assert latest_snapshot(root, RUN, at_or_before=9) == (8, b"after 8")
    assert latest_snapshot(root, RUN, at_or_before=5) is None
    assert latest_snapshot(root, "fedcba9876543210") == (3, b"other")
    assert latest_snapshot(root, "1234") is None


def test_a_damaged_snapshot_is_passed_over(root):
    write_snapshot(root, RUN, 2, b"after 2")
    write_snapshot(root, RUN, 4, b"after 4")
    newest = max((root / "snapshots").iterdir())
    newest.write_bytes(b"after 5")
    assert latest_snapshot(root, RUN) == (2, b"after 2")
