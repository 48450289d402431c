"""`fetch`: bring a catalogue back from its mirror, or bring an earlier state of it up to date.

Files come in the order in which they went up, so that the directory is a sound catalogue at every instant, and a fetch
that was killed is simply started again. What comes from outside is checked: names, checksums, and what parts refer to.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fractal_farm.catalogue.documents import SEALED_PAGE, is_sealed_page, opened_document, read_document
from fractal_farm.catalogue.durable import put, put_all, put_directory
from fractal_farm.catalogue.layout import CLOUDS, DESIGNS, IDENTITY, INDEX, RUNS, PartName, crc32c, part_name
from fractal_farm.catalogue.mirror.keeping import LEASE, WRITE_TEST
from fractal_farm.catalogue.mirror.sequence import Stage, stage_of
from fractal_farm.catalogue.mirror.store import ObjectFacts, Store
from fractal_farm.catalogue.mirror.upload import etag_of, mended_files
from fractal_farm.catalogue.parts import (
    Commit,
    epochs_of,
    holds,
    list_parts,
    read_commits,
    replaced_parts,
    told_apart,
)
from fractal_farm.catalogue.reader import Catalogue
from fractal_farm.catalogue.runs import run_lock
from fractal_farm.catalogue.shards import ROOT, is_root_document
from fractal_farm.catalogue.solids import CHECKSUMS
from fractal_farm.catalogue.verify.contents import named_checksum, own_cloud_files
from fractal_farm.errors import InputError

_AT_ONCE = 8
_STAGED = f"{INDEX}/fetched"
_ENTERED_APART = (IDENTITY, LEASE, WRITE_TEST)


@dataclass
class Fetched:
    """What a fetch brought.

    Attributes:
        files: new files.
        bytes: their size.
        commits: manifest parts among them.
        damaged: keys that the mirror lacks, or has with other content than it should.
    """

    files: int = 0
    bytes: int = 0
    commits: int = 0
    damaged: list[str] = field(default_factory=list)


def fetch(url: str, root: Path, told: Callable[[Fetched, int], None]) -> Fetched:
    """Bring a catalogue back.

    Args:
        url: s3://bucket/prefix; a farm may be mirroring to it.
        root: a new or empty directory, or one with an earlier state of the same catalogue.
        told: hears how far it is, and how many commits there are to fetch in all.

    Raises:
        InputError: no mirror there, or the directory holds something else, or more than the mirror does.
        StoreError: the store did not answer; what has come stays, and the fetch may be started again.
        FarmError: the file system failed.
    """
    store = Store(url)
    # The ends of runs are listed first: the commits that they rely on are in the second listing.
    ends = {key for key in store.listing(RUNS) if stage_of(key) is Stage.END}
    listing = store.listing()
    names = set(told_apart(name for key in listing if (name := _part(key)) is not None)[0])
    identity = _checked_place(store, listing, names, root)
    with contextlib.ExitStack() as stack:
        if not (root / IDENTITY).exists():
            put(root / IDENTITY, identity)
        for run_id in sorted({key.split("/")[1] for key in listing if key.startswith(f"{RUNS}/")}):
            stack.enter_context(run_lock(root, run_id))
        journey = _Journey(store, root, listing, told)
        journey.documents(Stage.DOCUMENT)
        Catalogue.open(root)  # this version can read it
        journey.commits(names)
        journey.documents(Stage.SNAPSHOT)
        journey.solids()
        journey.documents(Stage.PICTURE)
        journey.documents(Stage.END, ends)
        journey.documents(Stage.LOG)
    shutil.rmtree(root / _STAGED, ignore_errors=True)
    return journey.fetched


def _checked_place(store: Store, listing: Mapping[str, ObjectFacts], names: set[PartName], root: Path) -> bytes:
    """The identity of the catalogue in the mirror, once the directory may receive it."""
    identity = store.get(IDENTITY)
    theirs = opened_document(identity) if identity is not None else None
    if identity is None or theirs is None or ROOT not in listing or f"{CLOUDS}/{ROOT}" not in listing:
        raise InputError(f"{store.url}: no catalogue is mirrored there; look at the URL, and at AWS_ENDPOINT_URL")
    if root.exists() and not root.is_dir():
        raise InputError(f"{root}: is a file; name a directory")
    if root.is_dir() and any(not entry.name.startswith(".") for entry in root.iterdir()):
        if not (root / IDENTITY).exists() or read_document(root / IDENTITY) != theirs:
            raise InputError(f"{root}: is not empty, and not an earlier state of {store.url}; name a new directory")
        if more := [part for part in list_parts(root) if part not in names and not any(holds(n, part) for n in names)]:
            raise InputError(
                f"{root}: has {len(more)} commits that {store.url} lacks; it is no earlier state. Bring the mirror up "
                f"to date with `farm mirror {root} {store.url}`, or name a new directory"
            )
    return identity


class _Journey:
    """One fetch, on its way."""

    def __init__(
        self, store: Store, root: Path, listing: Mapping[str, ObjectFacts], told: Callable[[Fetched, int], None]
    ) -> None:
        self._store = store
        self._root = root
        self._listing = listing
        self._told = told
        self._wanted = 0
        self.fetched = Fetched()

    def documents(self, stage: Stage, chosen: set[str] | None = None) -> None:
        """The files of a stage, each checked by what vouches for it."""
        keys = [key for key in self._listing if stage_of(key) is stage and key not in _ENTERED_APART]
        keys.sort(key=lambda key: (not key.endswith(ROOT), key))  # what makes it a catalogue comes first
        if chosen is not None:
            keys = [key for key in keys if key in chosen]
        for key, content in self._arriving([key for key in keys if not self._is_here(key, stage)]):
            if content is None and stage is Stage.SNAPSHOT:
                continue  # a newer one has taken its place meanwhile
            if content is None or not _is_whole(key, content):
                self.fetched.damaged.append(key)
                continue
            self._keep({key: content})
            if key.endswith("/run.json"):  # the latest begun is the run that is meant if none is named
                moment = self._listing[key].modified.timestamp()
                os.utime(self._root / key, (moment, moment))

    def _is_here(self, key: str, stage: Stage) -> bool:
        path = self._root / key
        written_once = stage in (Stage.DOCUMENT, Stage.SNAPSHOT, Stage.END)
        return path.exists() and (written_once or etag_of(path) == self._listing[key].etag)

    def commits(self, names: set[PartName]) -> None:
        """The parts, in the order of their epochs, each after its clouds."""
        names -= set(list_parts(self._root))
        self._wanted = len(names)
        staged = self._staged(names)
        mended = mended_files(self._root)
        epochs = {name: epochs_of(commits) for name, commits in staged.items()}
        for name in sorted(staged, key=lambda n: (n.writer.partition("-")[0], epochs[n], n.seq, n.writer)):
            self._clouds(name, staged[name], mended)
            key = f"{DESIGNS}/{name.file_name}"
            self.fetched.commits += 1
            self._keep({key: (self._root / _STAGED / key).read_bytes()})
        for name in replaced_parts(self._root):  # of an earlier state
            (self._root / DESIGNS / name.file_name).unlink()

    def _staged(self, names: set[PartName]) -> dict[PartName, list[Commit]]:
        """Commits of parts, without their records: they say the order. The parts wait in a folder that nobody reads."""
        folder = self._root / _STAGED
        waiting = {name for name in names if _is_part(folder / DESIGNS / name.file_name, name)}
        for key, content in self._arriving([f"{DESIGNS}/{name.file_name}" for name in sorted(names - waiting)]):
            name = _part(key)
            if name is None or content is None or crc32c(content) != name.checksum:
                self.fetched.damaged.append(key)
                continue
            put(folder / key, content, "process")
            waiting.add(name)
        return {name: read_commits(folder, name, records=False) for name in waiting}

    def _clouds(
        self, name: PartName, commits: Sequence[Commit], mended: Mapping[str, frozenset[tuple[int, int]]]
    ) -> None:
        accepted = own_cloud_files(name, commits)
        files = {}
        for key, content in self._arriving([key for key in accepted if not (self._root / key).exists()]):
            if content is not None:
                files[key] = content
            facts = None if content is None else (len(content), crc32c(content))
            if facts != accepted[key] and facts not in mended.get(key, ()):
                self.fetched.damaged.append(key)
        self._keep(files)

    def solids(self) -> None:
        """The solids whose list of checksums has arrived, each as a whole."""
        lists = [key for key in self._listing if stage_of(key) is Stage.SOLID_LIST]
        for key, content in self._arriving([key for key in lists if not (self._root / key).exists()]):
            folder = key.rpartition("/")[0]
            document = opened_document(content) if content is not None else None
            if content is None or document is None:
                self.fetched.damaged.append(key)
                continue
            wanted = {
                f"{folder}/{name}": (facts["bytes"], facts["crc32c"]) for name, facts in document["files"].items()
            }
            if not wanted.keys() <= self._listing.keys():
                continue  # it is being made again
            files = {CHECKSUMS: content}
            for path, part in self._arriving(list(wanted)):
                if part is not None and (len(part), crc32c(part)) == wanted[path]:
                    files[path.rpartition("/")[2]] = part
            if len(files) > len(wanted):
                put_directory(self._root / folder, files)
                self._count(files)

    def _arriving(self, keys: list[str]) -> Iterator[tuple[str, bytes | None]]:
        """Objects as they arrive, in order; a few at a time."""
        for start in range(0, len(keys), _AT_ONCE):
            few = keys[start : start + _AT_ONCE]
            yield from zip(few, self._store.get_all(few), strict=True)

    def _keep(self, files: Mapping[str, bytes]) -> None:
        if files:
            put_all({self._root / key: content for key, content in files.items()})
            self._count(files)

    def _count(self, files: Mapping[str, bytes]) -> None:
        self.fetched.files += len(files)
        self.fetched.bytes += sum(map(len, files.values()))
        self._told(self.fetched, self._wanted)


def _part(key: str) -> PartName | None:
    folder, _, name = key.rpartition("/")
    return part_name(name) if folder == DESIGNS else None


def _is_part(path: Path, name: PartName) -> bool:
    try:
        return crc32c(path.read_bytes()) == name.checksum
    except OSError:
        return False


def _is_whole(key: str, content: bytes) -> bool:
    """Whether a file is as it was written, as far as anything in it or its name vouches for that."""
    if (checksum := named_checksum(key)) is not None:
        return crc32c(content) == checksum
    if key in (ROOT, f"{CLOUDS}/{ROOT}"):
        return is_root_document(key, content)
    if key.startswith(f"{RUNS}/") and key.endswith(".json"):
        return opened_document(content) is not None
    return not key.endswith(SEALED_PAGE) or is_sealed_page(content)
