"""What of a catalogue belongs into its mirror, and after what.

A file goes up after everything that it relies on, so that the mirror is a sound, earlier state of the catalogue at
every instant: documents, then the clouds of a commit before its part, commits in the order of their epochs, then solids
(their list of checksums completes them) and pictures, then the ends of runs, and at last the logs.
"""

from __future__ import annotations

import enum
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from fractal_farm.catalogue.durable import PARTIAL
from fractal_farm.catalogue.layout import CLOUDS, DESIGNS, INDEX, QUARANTINE, RUNS, SNAPSHOTS, SOLIDS
from fractal_farm.catalogue.shards import ROOT
from fractal_farm.catalogue.solids import CHECKSUMS

_ENDS = re.compile(rf"{RUNS}/[^/]+/final~[^/]+")
_HERE_ALONE = (INDEX, "cache", QUARANTINE)
_ENTERED_APART = ("logs", SOLIDS, SNAPSHOTS, "manifest", RUNS, CLOUDS, *_HERE_ALONE)


class Stage(enum.IntEnum):
    """When a file goes up."""

    DOCUMENT = 0
    PART = 1
    SNAPSHOT = 2
    SOLID = 3
    SOLID_LIST = 4
    PICTURE = 5
    END = 6
    LOG = 7


@dataclass(frozen=True)
class LocalFile:
    """A file of the catalogue.

    Attributes:
        key: its path, relative to the catalogue.
        size: bytes.
        modified_ns: time of its last change.
    """

    key: str
    size: int
    modified_ns: int


def stage_of(key: str) -> Stage | None:
    """When a file goes up; None if it stays: it concerns this machine alone, or comes along with a part."""
    top, _, rest = key.partition("/")
    name = key.rpartition("/")[2]
    if top in _HERE_ALONE or name.startswith(".") or name.endswith(PARTIAL):
        return None
    if top == RUNS:
        if "." not in name or name.startswith("wish~"):
            return None  # locks and wishes of processes
        return Stage.END if _ENDS.fullmatch(key) else Stage.DOCUMENT
    if top == CLOUDS:
        return Stage.DOCUMENT if rest == ROOT else None
    if top == "logs":
        return Stage.LOG
    if top == SOLIDS:
        return Stage.SOLID_LIST if name == CHECKSUMS else Stage.SOLID
    if top == SNAPSHOTS:
        return Stage.SNAPSHOT
    if key.startswith(f"{DESIGNS}/"):
        return Stage.PART
    return Stage.PICTURE if top == "pictures" or key.endswith((".png", ".html")) else Stage.DOCUMENT


def local_files(root: Path) -> dict[Stage, list[LocalFile]]:
    """The files of a catalogue by stage, in order of their keys; a farm may be writing to it.

    What goes up late is listed first: all that it relies on is there by then, and is listed after it.
    """
    found: dict[Stage, list[LocalFile]] = {stage: [] for stage in Stage}
    _enter(found, root, RUNS, ends=True)
    for top in ("logs", ".", SOLIDS, SNAPSHOTS, "manifest", RUNS, f"{CLOUDS}/{ROOT}"):
        _enter(found, root, top)
    return found


def _enter(found: dict[Stage, list[LocalFile]], root: Path, top: str, *, ends: bool = False) -> None:
    """Enter the file `top`, or those below it; the ends of runs only if they are asked for."""
    for path in _files(root, top):
        key = path.relative_to(root).as_posix()
        stage = stage_of(key)
        if stage is None or (stage is Stage.END) != ends:
            continue
        try:
            facts = path.stat()
        except FileNotFoundError:
            continue  # an older snapshot, gone meanwhile
        found[stage].append(LocalFile(key, facts.st_size, facts.st_mtime_ns))


def _files(root: Path, top: str) -> Iterator[Path]:
    if (root / top).is_file():
        yield root / top
    for directory, folders, names in os.walk(root / top):
        apart = _ENTERED_APART if top == "." and Path(directory) == root else ()
        folders[:] = sorted(name for name in folders if not name.startswith(".") and name not in apart)
        for name in sorted(names):
            yield Path(directory) / name
