"""`repair`: make whole again what verification finds, and move aside what cannot be (DESIGN, sections 5 and 10).

Every step is one atomic replacement or one rename, so that a repair may die at any instant and simply be started
again. Content is replaced only by content that its own checksum, or its genome, vouches for.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import secrets
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow.parquet as pq
from pyarrow import ArrowException, BufferReader

from fractal_farm.catalogue.documents import opened_document
from fractal_farm.catalogue.durable import move_aside, put
from fractal_farm.catalogue.fence import FENCE, take_over
from fractal_farm.catalogue.judging import fill_gaps
from fractal_farm.catalogue.layout import IDENTITY, QUARANTINE, RUNS, part_name
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.catalogue.runs import LOCK, run_lock
from fractal_farm.catalogue.shards import root_documents
from fractal_farm.catalogue.solids import add_solid
from fractal_farm.catalogue.verify.bit_flips import unflipped, unflipped_by_trial
from fractal_farm.catalogue.verify.contents import Contents, listed_contents, named_checksum
from fractal_farm.catalogue.verify.findings import Finding, Level, Report
from fractal_farm.catalogue.verify.regrowth import regrow
from fractal_farm.catalogue.verify.structure import structure_findings
from fractal_farm.catalogue.verify.verification import check_is_catalogue, verify
from fractal_farm.errors import FarmError

_BIT = "one flipped bit, restored"
_TRIAL_BYTES = 1 << 15
_TELLING = ("root", "part", "mending", "run", "end")


@dataclass(frozen=True)
class Remakers:
    """What the catalogue cannot make itself.

    Attributes:
        pictures: file name -> what makes it again.
        solid: (design_id, parameters hash) -> the files of the solid.
    """

    pictures: Mapping[str, Callable[[], object]]
    solid: Callable[[str, str], Mapping[str, bytes]]


def repair(root: Path, level: Level, remakers: Remakers) -> Report:
    """Verify, mend, and verify again.

    Args:
        root: directory of the catalogue.
        level: how thoroughly to look; see `verify`.
        remakers: see there.

    Returns:
        What was found and what was done about it; exit code 0 if all of it was restored, 3 if not.

    Raises:
        InputError: no catalogue, or a run is live.
        StorageFullError: no space left; start again once there is.
        FarmError: the file system failed.
    """
    check_is_catalogue(root)
    with _all_runs_held(root) as held:
        report = verify(root, level, held)
        outcomes: list[Finding] = []
        # What tells of other files is mended first, and then they are looked at again.
        for first in (True, False):
            chosen = [finding for finding in report.findings if (finding.kind in _TELLING) == first]
            if chosen:
                bench = _Bench(_contents(root, held), remakers)
                outcomes += [bench.mend(finding) for finding in sorted(chosen, key=_comes_last)]
                report = verify(root, level, held)
    return replace(report, repaired=True, findings=tuple(outcomes), remaining=report.findings)


def _contents(root: Path, held: frozenset[str]) -> Contents:
    contents = listed_contents(root, held)
    for _ in structure_findings(contents):
        pass  # it fills in the runs
    return contents


def _comes_last(finding: Finding) -> bool:
    """Pictures and solids are made from what is mended before."""
    return finding.kind in ("picture", "solid")


@contextlib.contextmanager
def _all_runs_held(root: Path) -> Iterator[frozenset[str]]:
    with contextlib.ExitStack() as stack:
        held = set()
        for path in sorted((root / RUNS).glob("*/")):
            for name in (LOCK, FENCE):
                if (path / name).is_dir():
                    _aside(root, f"{RUNS}/{path.name}/{name}")
            with contextlib.suppress(_NoRunError):
                stack.enter_context(_held(root, path.name))
                held.add(path.name)
        yield frozenset(held)


class _NoRunError(Exception):
    """A folder among the runs that is none."""


@contextlib.contextmanager
def _held(root: Path, run_id: str) -> Iterator[None]:
    if not (run_id.isalnum() and run_id == run_id.lower() and 4 <= len(run_id) <= 32):
        raise _NoRunError(run_id)
    with run_lock(root, run_id):
        if (root / RUNS / run_id / FENCE).is_file():
            take_over(root, run_id)  # no writer of a dead session may come in between
        yield


def _aside(root: Path, key: str) -> str:
    """Move a file or directory into the quarantine; where it lies then."""
    moment = dt.datetime.now(dt.UTC).strftime("%Y%m%dT%H%M%S")
    target = f"{QUARANTINE}/{moment}-{secrets.token_hex(4)}/{key}"
    move_aside(root / key, root / target)
    return target


class _Bench:
    """Where one finding after the other is mended."""

    def __init__(self, contents: Contents, remakers: Remakers) -> None:
        self._contents = contents
        self._root = contents.root
        self._remakers = remakers
        self._mended: dict[tuple[str, str], tuple[str, bool]] = {}

    def mend(self, finding: Finding) -> Finding:
        """Mend what a finding tells, once for each path; the finding with its outcome."""
        key = (finding.path, finding.kind)
        if key not in self._mended:
            ways = {
                "root": self._root_document,
                "part": self._part,
                "mending": self._named_document,
                "end": self._named_document,
                "run": self._run,
                "judgement": self._judgement,
                "cloud": self._cloud,
                "snapshot": self._disposable,
                "leftover": self._disposable,
                "solid": self._solid,
                "picture": self._picture,
            }
            way = ways.get(finding.kind)
            self._mended[key] = way(finding.path) if way else (f"stays; {finding.remedy}", finding.damage)
        outcome, lost = self._mended[key]
        return replace(finding, outcome=outcome, lost=lost)

    def _root_document(self, key: str) -> tuple[str, bool]:
        if key not in root_documents():
            return "stays", True
        if (self._root / key).is_dir():
            _aside(self._root, key)
        put(self._root / key, root_documents()[key])
        return "restored", False

    def _part(self, key: str) -> tuple[str, bool]:
        name = part_name(key.rpartition("/")[2])
        content = self._contents.read(key)
        if name is not None and isinstance(content, bytes):
            candidate = unflipped(content, name.checksum)
            if candidate is not None and _is_sound_part(candidate, name.rows):
                put(self._root / key, candidate)
                return _BIT, False
        return self._given_up(key, "its designs are missing until `farm resume` grows their epochs again")

    def _named_document(self, key: str) -> tuple[str, bool]:
        content, checksum = self._contents.read(key), named_checksum(key)
        if isinstance(content, bytes) and checksum is not None:
            candidate = unflipped(content, checksum)
            if candidate is not None and opened_document(candidate) is not None:
                put(self._root / key, candidate)
                return _BIT, False
        return self._given_up(key, "what it told is lost")

    def _run(self, key: str) -> tuple[str, bool]:
        content = self._contents.read(key)
        if isinstance(content, bytes) and len(content) <= _TRIAL_BYTES:
            candidate = unflipped_by_trial(content, lambda data: opened_document(data) is not None)
            if candidate is not None:
                put(self._root / key, candidate)
                return _BIT, False
        what = "the catalogue" if key == IDENTITY else "the run"
        verb = "mirrored" if key == IDENTITY else "resumed"
        return self._given_up(key, f"{what} cannot be {verb} until it is restored from a copy")

    def _judgement(self, _key: str) -> tuple[str, bool]:
        fill_gaps(self._root)
        return "what it told is lost; an empty one stands in its place", True

    def _cloud(self, key: str) -> tuple[str, bool]:
        if key not in self._contents.part_of:
            return "stays", True
        if (self._root / key).is_dir():
            _aside(self._root, key)
        before = self._contents.read(key)
        grown, lost = regrow(self._contents, key, before if isinstance(before, bytes) else None)
        if lost and (self._root / key).is_file():
            # What is left of them may be worth something to somebody.
            put(self._root / f"{QUARANTINE}/{secrets.token_hex(4)}/{key}", before if isinstance(before, bytes) else b"")
        for path, content in grown.items():
            put(self._root / path, content)
        if lost:
            return f"{lost} clouds do not grow again as they were; what there is stays readable", True
        return "grown again, bit for bit", False

    def _disposable(self, key: str) -> tuple[str, bool]:
        if not (self._root / key).exists():
            return "gone", False
        return f"moved to {_aside(self._root, key)}", False

    def _solid(self, key: str) -> tuple[str, bool]:
        _, design_id, parameters_hash = key.split("/")
        try:
            files = dict(self._remakers.solid(design_id, parameters_hash))
        except FarmError as error:
            return self._given_up(key, str(error))
        _aside(self._root, key)
        add_solid(self._root, design_id, parameters_hash, files)
        return "made again", False

    def _picture(self, key: str) -> tuple[str, bool]:
        where = self._disposable(key)[0]
        if key not in self._remakers.pictures:
            return where, False
        try:
            self._remakers.pictures[key]()
        except (FarmError, OSError) as error:
            return f"{where}; cannot be made again: {error}", True
        return "made again", False

    def _given_up(self, key: str, loss: str) -> tuple[str, bool]:
        if not (self._root / key).exists():
            return f"cannot be restored: {loss}", True
        return f"moved to {_aside(self._root, key)}: {loss}", True


def _is_sound_part(content: bytes, rows: int) -> bool:
    """Whether the pages' own checksums and the hashes of the genomes confirm a part."""
    try:
        table = pq.ParquetFile(BufferReader(content), page_checksum_verification=True).read(use_threads=False)
        for row in table.to_pylist():
            genome_of(row)
    except (ArrowException, FarmError, OSError, ValueError, TypeError, KeyError):
        return False
    return bool(table.num_rows == rows)
