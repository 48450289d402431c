"""What a resumed run needs: the committed records in order, a clean slate, snapshots of the islands' state.

A record is committed together with its designs, in the footer of one manifest part. Snapshots only shorten
the replay of records; a lost or damaged one costs time, not content.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from fractal_farm.catalogue.durable import PARTIAL, Durability, put, remove_dead_directory, sync_directory
from fractal_farm.catalogue.layout import (
    CLOUDS,
    DESIGNS,
    SNAPSHOTS,
    SOLIDS,
    PartName,
    checked_run_id,
    crc32c,
    run_directory,
)
from fractal_farm.catalogue.parts import Commit, list_parts, read_commits, read_of_parts, replaced_parts

_SNAPSHOT = re.compile(r"(?P<run_id>[0-9a-z]+)~(?P<epoch>\d{8})~(?P<checksum>[0-9a-f]{8})\.snapshot")
_SNAPSHOTS_KEPT = 3


def committed_records(root: Path, run_id: str, after: int | None = None) -> Iterator[tuple[tuple[int, int], bytes]]:
    """The records of a run, as they were given to `RunWriter.commit`, as far as they are without a gap.

    Where a part was lost, the records end: a run that goes on from there grows the same designs again.

    Args:
        root: directory of the catalogue.
        run_id: id of the run.
        after: leave out commits whose last epoch is not above this one.

    Yields:
        ((first epoch, last epoch), records) in order of epochs, then of commits; of commits that are equal in
        both, the first. Epochs begin at 0.

    Raises:
        FarmError: a part is missing or damaged.
    """
    yield from read_of_parts(root, run_id, lambda parts: _records(root, _without_gap(root, parts), after))


def committed_until(root: Path, run_id: str) -> int:
    """The last epoch of `committed_records`; -1 if there is none."""
    chain = read_of_parts(root, run_id, lambda parts: _without_gap(root, parts))
    return chain[-1][1].epochs[1] if chain else -1


def last_epoch(root: Path, run_id: str) -> int:
    """The last epoch that a run, or `layout.HAND`, has committed, even beyond a lost part; -1 before the first.

    Raises:
        FarmError: a part is missing or damaged.
    """

    def read(parts: list[PartName]) -> int:
        commits = (commit for part in parts for commit in read_commits(root, part, records=False))
        return max((commit.epochs[1] for commit in commits), default=-1)

    return read_of_parts(root, run_id, read)


def _without_gap(root: Path, parts: list[PartName]) -> list[tuple[PartName, Commit]]:
    """The commits that follow on each other, without their records, and the parts that hold them."""
    found = [(part, commit) for part in parts for commit in read_commits(root, part, records=False)]
    chain: list[tuple[PartName, Commit]] = []
    seen = set()
    reached: tuple[int, int] = (-1, -1)
    for part, commit in sorted(found, key=lambda item: (item[1].epochs, item[1].seq, item[0].writer)):
        epochs = commit.epochs
        if epochs[0] > reached[1] + 1:
            break
        if epochs[1] < reached[1] or (epochs[1] == reached[1] and epochs != reached):
            continue  # committed before a part was lost, and again with those after it
        reached = epochs
        if (epochs, commit.checksum) not in seen:
            seen.add((epochs, commit.checksum))
            chain.append((part, commit))
    return chain


def _records(
    root: Path, chain: list[tuple[PartName, Commit]], after: int | None
) -> list[tuple[tuple[int, int], bytes]]:
    """Epochs and records of the commits of a chain whose last epoch is above `after`."""
    wanted = [(part, commit) for part, commit in chain if after is None or commit.epochs[1] > after]
    numbers: dict[PartName, set[int]] = {}
    for part, commit in wanted:
        numbers.setdefault(part, set()).add(commit.seq)
    blobs = {
        (part, commit.seq): commit.records
        for part, chosen in numbers.items()
        for commit in read_commits(root, part, records=chosen)
    }
    return [(commit.epochs, blobs[part, commit.seq]) for part, commit in wanted]


def remove_orphans(root: Path, run_id: str) -> int:
    """Remove what dead writers of this run left unfinished; the caller holds the run's lock.

    Args:
        root: directory of the catalogue.
        run_id: id of the run. Files of other runs stay.

    Returns:
        Number of files removed: partial files, cloud files that no part refers to, parts that were merged.

    Raises:
        FarmError: a part of the run is missing or damaged; then nothing is removed.
    """
    if (root / DESIGNS).is_dir():
        sync_directory(root / DESIGNS)  # what is relied on from here on must not vanish in a power cut
    commits = (commit for part in list_parts(root, run_id) for commit in read_commits(root, part, records=False))
    referenced = {key for commit in commits for key in commit.files}
    removed = 0
    for writer in (root / CLOUDS).glob(f"{run_id}-*"):
        files = [path for path in writer.rglob("*") if path.is_file()]
        orphans = [path for path in files if path.relative_to(root).as_posix() not in referenced]
        removed += len(orphans)
        if len(orphans) == len(files):
            shutil.rmtree(writer)
            continue
        for path in orphans:
            path.unlink()
    partials = [
        *(root / DESIGNS / part.file_name for part in replaced_parts(root, run_id)),
        *(root / DESIGNS).glob(f".{run_id}-*{PARTIAL}"),
        *(root / SNAPSHOTS).glob(f".{run_id}~*{PARTIAL}"),
        *run_directory(root, run_id).glob(f".*{PARTIAL}"),
    ]
    for path in partials:
        path.unlink()
    dead = [path for path in (root / SOLIDS).glob(f"*/.*{PARTIAL}") if remove_dead_directory(path)]
    return removed + len(partials) + len(dead)


def write_snapshot(root: Path, run_id: str, epoch: int, state: bytes, durability: Durability = "full") -> None:
    """Store the islands' state after an epoch; the newest three of a run are kept.

    Args:
        root: directory of the catalogue.
        run_id: id of the run.
        epoch: last epoch that the state contains, from 0; its records are committed.
        state: opaque bytes.
        durability: see `durable.put_all`.

    Raises:
        FarmError: the file system failed.
    """
    name = f"{checked_run_id(run_id)}~{epoch:08d}~{crc32c(state):08x}.snapshot"
    put(root / SNAPSHOTS / name, state, durability)
    for _, path, _ in _snapshots(root, run_id)[_SNAPSHOTS_KEPT:]:
        path.unlink(missing_ok=True)


def latest_snapshot(root: Path, run_id: str, at_or_before: int | None = None) -> tuple[int, bytes] | None:
    """The newest sound snapshot of a run, at or before an epoch: (epoch, state), or None."""
    for epoch, path, checksum in _snapshots(root, run_id):
        if at_or_before is None or epoch <= at_or_before:
            state = path.read_bytes()
            if crc32c(state) == checksum:
                return epoch, state
    return None


def _snapshots(root: Path, run_id: str) -> list[tuple[int, Path, int]]:
    """(epoch, path, checksum), newest first."""
    found = []
    for path in (root / SNAPSHOTS).glob(f"{run_id}~*.snapshot"):
        if name := _SNAPSHOT.fullmatch(path.name):
            found.append((int(name["epoch"]), path, int(name["checksum"], 16)))
    return sorted(found, reverse=True)
