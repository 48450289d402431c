"""One catalogue out of several: all of their runs side by side, in a new directory (DESIGN section 5).

What a catalogue holds is immutable, under names that are its own for ever, so a merged catalogue is the union of their
files: runs stay what they were, with their records, digests and lineage, and can be resumed. Readers see each design
once, the one born first. Two things are made anew: the manifest, in large parts, and the marks of distinct shapes, from
the best design down. The order of the sources does not matter.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from fractal_farm.catalogue.compaction import LARGE_ROWS, best_first
from fractal_farm.catalogue.documents import encoded_document, opened_document
from fractal_farm.catalogue.durable import new_directory, put
from fractal_farm.catalogue.identities import id_array
from fractal_farm.catalogue.layout import (
    DESIGNS,
    HAND,
    MENDINGS,
    SNAPSHOTS,
    SOLIDS,
    PartName,
    belongs_to,
    crc32c,
    run_directory,
)
from fractal_farm.catalogue.parts import (
    Commit,
    encoded_merged_part,
    encoded_part,
    list_parts,
    read_commits,
    read_rows,
)
from fractal_farm.catalogue.reader import Catalogue
from fractal_farm.catalogue.records import last_epoch
from fractal_farm.catalogue.runs import read_run, run_ends, run_ids, run_is_live
from fractal_farm.catalogue.scan import Places, Rows
from fractal_farm.catalogue.schema import DESIGN_SCHEMA, KINDS
from fractal_farm.catalogue.settings import read_settings
from fractal_farm.catalogue.signatures import row_signatures
from fractal_farm.catalogue.steering import steering_requests
from fractal_farm.catalogue.verify.contents import own_cloud_files
from fractal_farm.distinctness import LENGTH, first_of_each_shape
from fractal_farm.errors import FarmError, InputError

_BLOCK = 1 << 16


@dataclass(frozen=True)
class Merged:
    """What a merged catalogue holds.

    Attributes:
        runs: ids of its runs.
        designs: different designs.
        distinct: of them, of different shapes.
    """

    runs: list[str]
    designs: int
    distinct: int


def merge(out: Path, sources: Sequence[Path], finish: Callable[[Path], object]) -> Merged:
    """Put catalogues together in a new directory, which appears when it is complete; the sources stay as they are.

    Args:
        out: the directory; it must not exist.
        sources: one or more catalogues; none of their runs is live.
        finish: called with the directory before it appears, for what the catalogue cannot make itself.

    Raises:
        InputError: the directory exists or lies in a source, a source is no catalogue, a run is live, or was kept in
            different ways.
        StorageFullError: no space left; nothing stays behind.
        FarmError: something in a source is missing or damaged.
    """
    roots = _checked(sources)
    with new_directory(out, roots) as place:
        Catalogue.create(place)
        for run_id in sorted({run_id for root in roots for run_id in run_ids(root)}):
            _put_run(place, run_id, [root for root in roots if run_id in run_ids(root)])
        _put_judgements(place, roots)
        parts = _standing_parts(roots)
        for root, name in parts:
            for commit in read_commits(root, name, records=False):
                _put_clouds(place, roots, name, commit)
        marks = _Marks(Rows(parts))
        for group in _groups(parts):
            _put_part(place, group, marks)
        _put_solids(place, roots)
        finish(place)
    return Merged(run_ids(out), marks.designs, marks.distinct)


def _checked(sources: Sequence[Path]) -> list[Path]:
    """The sources in an order of their own, each once."""
    roots = list(dict.fromkeys(path.resolve() for path in sources))
    keeps: dict[str, tuple[str, Path]] = {}
    for root in roots:
        Catalogue.open(root)
        for run_id in run_ids(root):
            if run_is_live(root, run_id):
                raise InputError(f"{root}: run {run_id} is at work; wait for its end, or `farm stop {root}`")
            keep = read_settings(root, run_id)["catalogue"]["keep"]
            other, where = keeps.setdefault(run_id, (keep, root))
            if other != keep:
                raise InputError(
                    f"run {run_id} keeps what is {other} in {where} and what is {keep} in {root}; merge one of them"
                )
    for run_id in keeps:
        _check_steering(run_id, [root for root in roots if run_id in run_ids(root)])
    return sorted(roots, key=lambda root: (sorted(_names(root)), str(root)))


def _check_steering(run_id: str, roots: Sequence[Path]) -> None:
    """Refuse a run that was steered in several ways: what one source is bound to must lie ahead of the others."""
    told = {root: [path.name for path in _wishes(root, run_id, "steering")] for root in roots}
    most = max(roots, key=lambda root: len(told[root]))
    requests = steering_requests(most, run_id)
    for root, own in told.items():
        last = last_epoch(root, run_id)
        if own != told[most][: len(own)] or any(request.first <= last for request in requests[len(own) :]):
            raise InputError(
                f"run {run_id} was steered in {most} otherwise than in {root}, so it is not the same; merge one of them"
            )


def _names(root: Path) -> Iterator[str]:
    """Names that are the same wherever a catalogue lies."""
    yield from (name.file_name for name in list_parts(root))
    yield from (f"{run_id}/{path.name}" for run_id in run_ids(root) for path in run_directory(root, run_id).iterdir())


def _put_run(place: Path, run_id: str, roots: list[Path]) -> None:
    """The documents of a run, from the source in which it went on longest; and how it ended in any of them."""

    def progress(root: Path) -> tuple[Any, ...]:
        return last_epoch(root, run_id), [path.read_bytes() for path in _documents(root, run_id)]

    longest = max(roots, key=progress)
    read_run(longest, run_id)
    for path in _documents(longest, run_id):
        _copied(path, run_directory(place, run_id) / path.name)
    for path in (path for root in roots for kind in ("steering", "wish") for path in _wishes(root, run_id, kind)):
        _copied(path, run_directory(place, run_id) / path.name)
    ends = {encoded_document(end): end for root in roots for end in run_ends(root, run_id)}
    ordered = sorted(ends, key=lambda content: (ends[content].get("progress", {}).get("epochs", 0), content))
    for number, content in enumerate(ordered):
        put(run_directory(place, run_id) / f"final~{number:04d}~{crc32c(content):08x}.json", content, "process")
    for path in sorted((longest / SNAPSHOTS).glob(f"{run_id}~*.snapshot")):
        _copied(path, place / SNAPSHOTS / path.name)
    log = longest / "logs" / f"{run_id}.jsonl"
    if log.is_file():
        _copied(log, place / "logs" / log.name)


def _documents(root: Path, run_id: str) -> list[Path]:
    """What a run was asked for: run.json, and the settings of later sessions."""
    directory = run_directory(root, run_id)
    return [directory / "run.json", *sorted(directory.glob("settings~*.json"))]


def _wishes(root: Path, run_id: str, kind: str) -> list[Path]:
    """What a run is wanted to breed from: requests that it is bound to ("steering"), or those that wait ("wish")."""
    return sorted(run_directory(root, run_id).glob(f"{kind}~*.json"))


def _put_judgements(place: Path, roots: Sequence[Path]) -> None:
    """What people think of the designs of any source, in the order in which they said it."""
    found = {path.read_bytes() for root in roots for path in run_directory(root, HAND).glob("judgement~*.json")}
    said = {content: document for content in found if (document := opened_document(content)) is not None}
    for number, content in enumerate(sorted(said, key=lambda content: (said[content].get("at", ""), content))):
        put(run_directory(place, HAND) / f"judgement~{number:08d}~{crc32c(content):08x}.json", content, "process")


def _copied(path: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, target)
    facts = path.stat()
    os.utime(target, ns=(facts.st_atime_ns, facts.st_mtime_ns))  # by which the latest run is known


def _standing_parts(roots: Sequence[Path]) -> list[tuple[Path, PartName]]:
    """The parts that hold each commit of any source once, in order of writers and commits."""
    found: dict[PartName, Path] = {}
    for root in roots:
        for name in list_parts(root):
            found.setdefault(name, root)
    standing: list[tuple[Path, PartName]] = []
    for name in sorted(found, key=lambda name: (name.writer, name.seq, -name.last)):
        last = standing[-1][1] if standing and standing[-1][1].writer == name.writer else None
        if last is not None and name.last <= last.last:
            continue
        if last is not None and name.seq <= last.last:
            raise FarmError(
                f"{found[name] / DESIGNS / name.file_name}: overlaps {last.file_name}; verify the catalogues first"
            )
        standing.append((found[name], name))
    return standing


def _put_clouds(place: Path, roots: Sequence[Path], name: PartName, commit: Commit) -> None:
    """The cloud files of a commit, from whichever source has them as they were written, or as they were mended."""
    for key, facts in sorted(own_cloud_files(name, [commit]).items()):
        mended: list[tuple[Path, bytes]] = []
        for root in roots:
            try:
                content = (root / key).read_bytes()
            except OSError:
                continue
            if (len(content), crc32c(content)) == facts:
                put(place / key, content, "process")
                break
            mended.append((root, content))
        else:
            _put_mended(place, key, mended)


def _put_mended(place: Path, key: str, candidates: Iterable[tuple[Path, bytes]]) -> None:
    """A cloud file that a repair grew again with other bytes, and the document that vouches for it."""
    for root, content in candidates:
        for path in sorted((root / MENDINGS).glob("*.json")):
            document = path.read_bytes()
            entry = ((opened_document(document) or {}).get("files") or {}).get(key)
            if entry and (entry["bytes"], entry["crc32c"]) == (len(content), crc32c(content)):
                put(place / key, content, "process")
                put(place / MENDINGS / path.name, document, "process")
                return
    raise FarmError(f"{key}: missing or damaged in all sources; `farm verify --repair` grows its clouds again")


class _Marks:
    """Which designs are distinct: no better one, of equal ones none with a smaller id, has their shape."""

    def __init__(self, rows: Rows) -> None:
        places = rows.best_first(rows.standing(ancestors=False))
        first = first_of_each_shape(_signatures(rows, places))
        digits = id_array(rows.read(["design_id"]).column(0))[places]
        order = np.argsort(digits)
        self._ids, self._first = digits[order], first[order]
        self.designs, self.distinct = len(places), int(first.sum())

    def of(self, table: Any) -> Any:
        """The column for a table of the manifest; null for ancestors."""
        digits = id_array(table.column("design_id"))
        place = np.searchsorted(self._ids, digits)
        ancestor = np.array([kind != KINDS[0] for kind in table.column("kind").to_pylist()], bool)
        marked = np.zeros(len(digits), bool)
        marked[~ancestor] = self._first[place[~ancestor]]
        return pa.array(marked, mask=ancestor)


def _signatures(rows: Rows, places: Places) -> npt.NDArray[np.float64]:
    """Signatures of some rows; not a number where there is no descriptor."""
    starts = range(0, len(places), _BLOCK)
    pieces = [row_signatures(rows.take(("descriptor", "d0", "d2"), places[start : start + _BLOCK])) for start in starts]
    return np.concatenate([np.zeros((0, LENGTH)), *pieces])


def _groups(parts: Sequence[tuple[Path, PartName]]) -> Iterator[list[tuple[Path, PartName]]]:
    """Parts that become one: of one writer, without a gap, not too large together."""
    group: list[tuple[Path, PartName]] = []
    for root, name in parts:
        follows = bool(group) and group[-1][1].writer == name.writer and group[-1][1].last + 1 == name.seq
        follows = follows and not belongs_to(name.writer, HAND)  # the records of each tell how it was scored
        if group and not (follows and sum(member.rows for _, member in group) + name.rows <= LARGE_ROWS):
            yield group
            group = []
        group.append((root, name))
    if group:
        yield group


def _put_part(place: Path, group: Sequence[tuple[Path, PartName]], marks: _Marks) -> None:
    tables = [read_rows(root, name, DESIGN_SCHEMA.names) for root, name in group]
    commits = [commit for root, name in group for commit in read_commits(root, name)]
    rows = pa.concat_tables(tables).combine_chunks()
    field = DESIGN_SCHEMA.field("distinct")
    rows = best_first(rows.set_column(rows.column_names.index(field.name), field, marks.of(rows)))
    writer = group[0][1].writer
    encoded = encoded_merged_part(rows, writer, commits) if len(commits) > 1 else encoded_part(rows, writer, commits[0])
    put(place / DESIGNS / encoded[0].file_name, encoded[1], "process")


def _put_solids(place: Path, roots: Sequence[Path]) -> None:
    """Finished solids; of those that several sources have, that of the first."""
    for root in roots:
        for directory in sorted((root / SOLIDS).glob("*/*")):
            target = place / SOLIDS / directory.parent.name / directory.name
            if directory.is_dir() and not directory.name.startswith(".") and not target.exists():
                shutil.copytree(directory, target)
