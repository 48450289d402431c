"""What is in a catalogue, as far as names, sizes and the manifest's footers say, however damaged it is.

`listed_contents` reads every manifest part once (its checksum stands in its name) and the small documents; whatever
else there is, it only names.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from fractal_farm.catalogue.documents import opened_document
from fractal_farm.catalogue.layout import DESIGNS, MENDINGS, RUNS, PartName, crc32c
from fractal_farm.catalogue.parts import Commit, holds, list_parts, open_part, read_commits, read_rows, replaced_parts
from fractal_farm.catalogue.runs import run_is_live
from fractal_farm.catalogue.shards import SHARD
from fractal_farm.catalogue.verify.findings import Finding
from fractal_farm.errors import FarmError

LOOSE = ("logs", "index", "cache", "quarantine")
"""Folders that nobody vouches for: they can be lost."""

_NAMED = re.compile(r"[^/]*~(?P<checksum>[0-9a-f]{8})\.[a-z]+")
_CLOUD_FILE = re.compile(r"clouds/[^/.~][^/~]*(/(points|transform|design_id))?/(zarr\.json|c(\.\d+)+)")


@dataclass(frozen=True)
class Part:
    """A sound manifest part, and the commits that it holds, without their records."""

    name: PartName
    commits: list[Commit]

    @property
    def key(self) -> str:
        """Its path, relative to the catalogue."""
        return f"{DESIGNS}/{self.name.file_name}"

    @property
    def run_id(self) -> str:
        """The run that its writer worked for."""
        return self.name.writer.partition("-")[0]


@dataclass
class Contents:
    """A catalogue, listed.

    Attributes:
        root: its directory.
        sizes: key -> bytes of every regular file that somebody vouches for.
        directories: keys of the directories.
        parts: the sound manifest parts, each commit once, in order of their names.
        replaced: keys of the parts whose commits a merged part holds too.
        part_of: key of a cloud file -> the part that refers to it.
        accepted: key of a cloud file -> the sizes and checksums that it may have.
        lost: key of a cloud file -> ids of designs whose clouds an earlier repair could not restore.
        runs: run id -> content of run.json; None if it is missing or damaged.
        live: runs that another process works on.
        findings: what was wrong so far.
        bytes_checked: bytes whose checksums were compared.
    """

    root: Path
    sizes: dict[str, int] = field(default_factory=dict)
    directories: set[str] = field(default_factory=set)
    parts: list[Part] = field(default_factory=list)
    replaced: set[str] = field(default_factory=set)
    part_of: dict[str, Part] = field(default_factory=dict)
    accepted: dict[str, set[tuple[int, int]]] = field(default_factory=dict)
    lost: dict[str, list[str]] = field(default_factory=dict)
    runs: dict[str, dict[str, Any] | None] = field(default_factory=dict)
    live: frozenset[str] = frozenset()
    findings: list[Finding] = field(default_factory=list)
    bytes_checked: int = 0

    def read(self, key: str) -> bytes | str:
        """The bytes of a file, or in words why there are none."""
        if key in self.directories:
            return "a directory stands in its place"
        try:
            content = (self.root / key).read_bytes()
        except FileNotFoundError:
            return "missing"
        except OSError as error:
            return f"cannot be read: {error.strerror}"
        self.bytes_checked += len(content)
        return content

    def rows(self, part: Part, columns: Sequence[str], shard: int | None = None) -> Any:
        """Rows of a part as a table; only those whose clouds lie in one shard, in order, if it is given."""
        table = read_rows(self.root, part.name, [*dict.fromkeys([*columns, "cloud_row"])])
        if shard is not None:
            places = table.column("cloud_row")
            inside = pc.and_(pc.greater_equal(places, shard * SHARD), pc.less(places, (shard + 1) * SHARD))
            table = table.filter(inside).sort_by("cloud_row")
        return table.select(columns)


def listed_contents(root: Path, held: frozenset[str] = frozenset()) -> Contents:
    """List a catalogue; a live one may grow meanwhile.

    Args:
        root: its directory.
        held: runs whose locks the caller holds himself.
    """
    contents = Contents(root)
    folder = root / RUNS
    run_ids = sorted(path.name for path in folder.iterdir() if path.is_dir()) if folder.is_dir() else []
    live = _live(root, run_ids, held)
    # Parts first: what a part refers to was there before it.
    names = list_parts(root)
    _walk(contents)
    contents.live = live | _live(root, run_ids, held)
    for name in names:
        _take_part(contents, name)
    contents.replaced = {f"{DESIGNS}/{name.file_name}" for name in replaced_parts(root)}
    for key in sorted(key for key in contents.sizes if key.startswith(f"{MENDINGS}/")):
        _take_mending(contents, key)
    return contents


def named_checksum(key: str) -> int | None:
    """The checksum that a file's name carries, if it carries one."""
    found = _NAMED.fullmatch(key.rpartition("/")[2])
    return int(found["checksum"], 16) if found else None


def own_cloud_files(name: PartName, commits: Sequence[Commit]) -> dict[str, tuple[int, int]]:
    """The files of a part that are clouds of its writer, as all should be: key -> (bytes, CRC32C)."""
    return {
        key: facts
        for commit in commits
        for key, facts in commit.files.items()
        if _CLOUD_FILE.fullmatch(key) and key.split("/")[1] == name.writer
    }


def _live(root: Path, run_ids: list[str], held: frozenset[str]) -> frozenset[str]:
    live = set()
    for run_id in run_ids:
        try:
            if run_id not in held and run_is_live(root, run_id):
                live.add(run_id)
        except (OSError, FarmError):
            continue  # no name of a run, or something else in place of its lock
    return frozenset(live)


def _walk(contents: Contents) -> None:
    def unreadable(error: OSError) -> None:
        if isinstance(error, FileNotFoundError):
            return  # renamed or removed since its name was read, as a solid is when it is finished
        key = Path(error.filename).relative_to(contents.root).as_posix()
        problem = f"the directory cannot be read: {error.strerror}"
        contents.findings.append(Finding(key, "root", problem, "give yourself the right to read it"))

    for directory, folders, names in os.walk(contents.root, onerror=unreadable):
        place = Path(directory)
        if place == contents.root:
            folders[:] = [name for name in folders if name not in LOOSE]
        contents.directories.update((place / name).relative_to(contents.root).as_posix() for name in folders)
        for name in names:
            try:
                facts = (place / name).stat()
            except OSError:
                continue  # gone meanwhile, or a link to nowhere
            if stat.S_ISREG(facts.st_mode):
                contents.sizes[(place / name).relative_to(contents.root).as_posix()] = facts.st_size


def _take_part(contents: Contents, name: PartName) -> None:
    """Check a part, and remember what it refers to; one that was merged meanwhile is found in its successor."""
    key = f"{DESIGNS}/{name.file_name}"
    again = "`farm verify --repair` mends it if it is one flipped bit, and otherwise moves it aside; then `farm resume`"
    content = contents.read(key)
    if isinstance(content, str):
        problem = f"{content}: {name.rows} designs"
    elif crc32c(content) != name.checksum:
        problem = f"damaged: the checksum of its {len(content)} bytes is not that of its name: {name.rows} designs"
    else:
        try:
            part = Part(name, read_commits(contents.root, name, records=False))
            rows = open_part(contents.root, name).metadata.num_rows
        except Exception as error:  # what a library makes of garbage that was given a matching name
            problem = f"not a manifest part ({type(error).__name__})"
        else:
            _take_references(contents, part)
            if rows != name.rows:
                problem = f"holds {rows} rows; its name says {name.rows}"
                contents.findings.append(Finding(key, "row", problem, "restore it from a copy"))
            return
    if not (contents.root / key).exists() and take_successor(contents, name):
        return
    contents.findings.append(Finding(key, "part", problem, again))


def take_successor(contents: Contents, name: PartName) -> bool:
    """Take in the part that holds the commits of one that is gone, once; whether there is such a part."""
    wider = next((other for other in list_parts(contents.root) if holds(other, name)), None)
    if wider is not None and wider not in [part.name for part in contents.parts]:
        _take_part(contents, wider)
    return wider is not None


def _take_references(contents: Contents, part: Part) -> None:
    contents.parts.append(part)
    own = own_cloud_files(part.name, part.commits)
    for key, facts in (item for commit in part.commits for item in commit.files.items()):
        if key in own:
            contents.part_of[key] = part
            contents.accepted.setdefault(key, set()).add(facts)
        else:
            problem = f"refers to {key}, which is no cloud of its writer"
            contents.findings.append(Finding(part.key, "part", problem, "restore it from a copy"))


def _take_mending(contents: Contents, key: str) -> None:
    """What an earlier repair put in place of cloud files."""
    content = contents.read(key)
    sound = isinstance(content, bytes) and crc32c(content) == named_checksum(key)
    document = opened_document(content) if sound and isinstance(content, bytes) else None
    if document is None:
        remedy = "`farm verify --repair` mends it, or grows the clouds again that it vouches for"
        contents.findings.append(Finding(key, "mending", "damaged: its checksum does not match", remedy))
        return
    for cloud, facts in document["files"].items():
        if cloud in contents.accepted:
            contents.accepted[cloud].add((facts["bytes"], facts["crc32c"]))
            contents.lost[cloud] = facts["lost"]
