"""Small parts become large ones: a catalogue of a million designs is read from a dozen files.

Consecutive commits of a writer are merged into one part, sorted best first; its appearance replaces them at once, since
readers pass over parts whose commits a wider one holds. Then they are removed. Whoever dies in between leaves a sound
catalogue, and the next merge, or `farm resume`, removes what was left.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue.durable import Durability, put
from fractal_farm.catalogue.fence import take_over
from fractal_farm.catalogue.layout import DESIGNS, PartName
from fractal_farm.catalogue.parts import encoded_merged_part, list_parts, read_commits, read_rows, replaced_parts
from fractal_farm.catalogue.reader import Catalogue
from fractal_farm.catalogue.runs import run_lock
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.catalogue.shards import ROOT, is_root_document, root_documents

LARGE_ROWS = 1 << 16
"""Rows of a merged part, at most: what is held in memory to make one."""


@dataclass(frozen=True)
class Compaction:
    """What was merged.

    Attributes:
        before: parts that were replaced, or had been before and were still there.
        after: parts that replace them.
        bytes: by how much the catalogue has grown.
    """

    before: int = 0
    after: int = 0
    bytes: int = 0

    def __add__(self, other: Compaction) -> Compaction:
        return Compaction(self.before + other.before, self.after + other.after, self.bytes + other.bytes)


def compact_all(root: Path) -> Compaction:
    """Merge small parts of all runs of a catalogue.

    Raises:
        InputError: no catalogue, or a process works on one of its runs.
        StorageFullError: no space left; what is merged so far stays merged.
        FarmError: a part is damaged, or the file system failed.
    """
    done = Compaction()
    for run in Catalogue.open(root).runs():
        with run_lock(root, run.run_id):
            take_over(root, run.run_id)  # no writer of a dead session may come in between
            done += compact(root, run.run_id)
    return done


def compact(
    root: Path, run_id: str, durability: Durability = "full", writer: str | None = None, below: int = LARGE_ROWS
) -> Compaction:
    """Merge small parts of a run; the caller holds the run's lock, or its fence.

    Args:
        root: directory of the catalogue.
        run_id: id of the run.
        durability: see `durable.put_all`.
        writer: merge the parts of this writer alone.
        below: leave parts of so many rows or more as they are.

    Raises:
        StorageFullError: no space left; what is merged so far stays merged.
        FarmError: a part is damaged, or the file system failed.
    """
    done = Compaction()
    for name in replaced_parts(root, run_id):
        done += _removed(root, [name])
    for group in _groups(list_parts(root, run_id), writer, below):
        _tell_older_readers(root, durability)
        done += _merged(root, group, durability)
    return done


def best_first(rows: Any) -> Any:
    """Rows of a manifest in order of (-fitness, design_id, birth)."""
    keys = [("fitness", "descending"), *((name, "ascending") for name in ("design_id", "epoch", "island"))]
    return rows.take(pc.sort_indices(rows, keys))


def _groups(parts: Sequence[PartName], writer: str | None, below: int) -> Iterator[list[PartName]]:
    """Parts that make one: two or more, without a gap between them, not too large together."""
    group: list[PartName] = []
    for part in parts:
        small = part.rows < below and (writer is None or part.writer == writer)
        follows = bool(group) and part.writer == group[-1].writer and part.seq == group[-1].last + 1
        if not (small and follows and sum(member.rows for member in group) + part.rows <= LARGE_ROWS):
            if len(group) > 1:
                yield group
            group = []
        if small:
            group.append(part)
    if len(group) > 1:
        yield group


def _merged(root: Path, group: Sequence[PartName], durability: Durability) -> Compaction:
    tables = [read_rows(root, part, DESIGN_SCHEMA.names) for part in group]
    commits = [commit for part in group for commit in read_commits(root, part)]
    rows = best_first(pa.concat_tables(tables).combine_chunks())
    name, content = encoded_merged_part(rows, group[0].writer, commits)
    put(root / DESIGNS / name.file_name, content, durability)
    return Compaction(0, 1, len(content)) + _removed(root, group)


def _removed(root: Path, parts: Sequence[PartName]) -> Compaction:
    size = 0
    for part in parts:
        path = root / DESIGNS / part.file_name
        size += path.stat().st_size
        path.unlink()
    return Compaction(len(parts), 0, -size)


def _tell_older_readers(root: Path, durability: Durability) -> None:
    """A catalogue that was made before parts could be merged says from now on that its readers must know of it."""
    path, content = root / ROOT, root_documents()[ROOT]
    if path.read_bytes() != content and is_root_document(ROOT, path.read_bytes()):
        put(path, content, durability)
