import errno
import os
from pathlib import Path

import pytest

from fractal_farm.catalogue import durable
from fractal_farm.errors import FarmError, StorageFullError
from tests.catalogue.examples import designs, files, records, writer


@pytest.fixture
def steps(monkeypatch):
    """What the file system was asked to do, in order: (verb, path)."""
    seen = []

    def watch(verb):
        original = getattr(os, verb)

        def recorded(target, *others, **options):
            path = Path(f"/proc/self/fd/{target}").readlink() if isinstance(target, int) else Path(target)
            result = original(target, *others, **options)
            seen.append((verb, path, *map(Path, others[:1] if verb in ("replace", "rename") else ())))
            return result

        monkeypatch.setattr(os, verb, recorded)

    for verb in ("fsync", "replace", "rename", "mkdir"):
        watch(verb)
    return seen


def check_each_name_is_durable(steps):
    """Every new name: content synced before it appears, its directory after; new directories likewise."""
    for i, (verb, path, *others) in enumerate(steps):
        before, after = [step[:2] for step in steps[:i]], [step[:2] for step in steps[i + 1 :]]
        if verb in ("replace", "rename"):
            assert ("fsync", path) in before
            assert ("fsync", others[0].parent) in after
        if verb == "mkdir" and not path.name.endswith(durable.PARTIAL):
            assert ("fsync", path.parent) in after[:1]


def test_a_put_syncs_the_file_renames_it_and_syncs_the_directory(tmp_path, steps):
    target = tmp_path / "new" / "folder" / "name"
    durable.put(target, b"content")
    assert target.read_bytes() == b"content"
    assert [step[0] for step in steps] == ["fsync", "mkdir", "fsync", "mkdir", "fsync", "fsync", "replace", "fsync"]
    check_each_name_is_durable(steps)


def test_a_directory_that_another_process_made_is_synced_before_it_is_relied_on(tmp_path, steps):
    (tmp_path / "new").mkdir()
    del steps[:]
    for name in ("one", "two"):
        durable.put(tmp_path / "new" / name, b"content")
    assert steps[0] == ("fsync", tmp_path)
    assert [step[1] for step in steps].count(tmp_path) == 1


def test_a_commit_is_announced_by_its_part_only_when_all_clouds_are_durable(root, steps):
    used = writer(root, durability="full")
    for epoch, numbers in enumerate([range(5), range(5, 9)]):
        batch = designs(numbers)
        del steps[:]
        used.commit(*batch, records(epoch), (epoch, epoch))
        check_each_name_is_durable(steps)
        appeared = [i for i, step in enumerate(steps) if step[0] == "replace"]
        part = steps[appeared[-1]][2]
        assert part.suffix == ".parquet"
        clouds = {steps[i][2].parent for i in appeared[:-1]}
        assert {folder.name for folder in clouds} >= {"points", "transform", "design_id"}
        for folder in clouds:
            assert max(i for i, step in enumerate(steps) if step[:2] == ("fsync", folder)) < appeared[-1]
        assert steps[-1][:2] == ("fsync", part.parent)


def test_durability_process_never_syncs(root, steps):
    batch = designs(range(5))
    del steps[:]
    writer(root, durability="process").commit(*batch, records(0), (0, 0))
    assert {step[0] for step in steps} == {"mkdir", "replace"}


def test_a_directory_appears_with_all_its_files(tmp_path, steps):
    target = tmp_path / "solids" / "hash"
    assert durable.put_directory(target, {"a": b"1", "b": b"22"})
    assert files(target) == {"a": 1, "b": 2}
    check_each_name_is_durable(steps)
    renamed = next(i for i, step in enumerate(steps) if step[0] == "rename")
    assert [step[1].name for step in steps[:renamed] if step[0] == "fsync"][-3:-1] == ["a", "b"]


def test_a_directory_that_is_there_stays_as_it_is(tmp_path, monkeypatch):
    target = tmp_path / "hash"
    durable.put_directory(target, {"a": b"1"})
    assert not durable.put_directory(target, {"a": b"other"})
    # Another process may finish the same solid between the look and the rename.
    monkeypatch.setattr(Path, "is_dir", lambda path: path != target)
    assert not durable.put_directory(target, {"a": b"other"})
    monkeypatch.undo()
    assert (target / "a").read_bytes() == b"1"
    assert list(tmp_path.iterdir()) == [target]


def test_a_partial_directory_is_removed_only_when_nobody_fills_it(tmp_path):
    partial = tmp_path / f".hash.1{durable.PARTIAL}"
    partial.mkdir()
    (partial / "half").write_bytes(b"")
    with durable.locked(partial):
        assert not durable.remove_dead_directory(partial)
        assert partial.is_dir()
    assert durable.remove_dead_directory(partial)
    assert not partial.exists()


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
@pytest.mark.parametrize(
    "put", [lambda path: durable.put(path, b"x"), lambda path: durable.put_directory(path, {"x": b"x"})]
)
def test_a_full_disk_leaves_nothing_behind_and_says_what_to_do(tmp_path, monkeypatch, code, put):
    def full(descriptor):
        raise OSError(code, os.strerror(code))

    with monkeypatch.context() as broken:
        broken.setattr(os, "fsync", full)
        with pytest.raises(StorageFullError, match=r"no space left for 1 bytes.*Free space"):
            put(tmp_path / "name")
    assert list(tmp_path.iterdir()) == []
    put(tmp_path / "name")
    assert (tmp_path / "name").exists()


def test_other_failures_are_told_apart_from_a_full_disk(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(FarmError, match="cannot be written") as caught:
        durable.put(tmp_path / "file" / "name", b"x")
    assert not isinstance(caught.value, StorageFullError)
