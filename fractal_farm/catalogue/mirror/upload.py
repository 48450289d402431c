"""`Uploader`: brings a mirror up to date with its catalogue, one pass at a time (`sequence` says in which order)."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fractal_farm.catalogue.documents import opened_document
from fractal_farm.catalogue.layout import DESIGNS, MENDINGS, SNAPSHOTS, PartName, crc32c, part_name
from fractal_farm.catalogue.mirror.sequence import LocalFile, Stage, local_files
from fractal_farm.catalogue.mirror.state import Backlog
from fractal_farm.catalogue.mirror.store import Store
from fractal_farm.catalogue.parts import Commit, PartGoneError, epochs_of, holds, list_parts, read_commits
from fractal_farm.errors import FarmError

_AT_ONCE = 4
_CHANGING_SECONDS = 300.0
_SHEET = "catalogue.png"


@dataclass(frozen=True)
class _Upload:
    """A file that the mirror lacks; `accepted` are the (bytes, CRC32C) that it may have, None for any."""

    key: str
    size: int
    stamp: tuple[int, int] | None = None
    accepted: frozenset[tuple[int, int]] | None = None


class Uploader:
    """What a mirror has, and what it takes to complete it; used by one thread.

    Attributes:
        arrived: files that have arrived so far.
        arrived_bytes: their size.
    """

    def __init__(self, root: Path, store: Store, hold: Callable[[], None]) -> None:
        """List what the mirror has.

        Args:
            root: the catalogue; a farm may be writing to it.
            store: where its mirror is.
            hold: called at least once in a pass, and between uploads; it raises if they must end.

        Raises:
            InputError: the bucket or the credentials will not do.
            StoreError: the store does not answer.
        """
        self._root = root
        self._store = store
        self._hold = hold
        listing = store.listing()
        self._there = {key: facts.size for key, facts in listing.items()}
        self._etags = {key: facts.etag for key, facts in listing.items()}
        self._stamps: dict[str, tuple[int, int]] = {}
        self._commits_of: dict[PartName, list[Commit]] = {}
        self._changing_due = 0.0
        self.arrived = self.arrived_bytes = 0

    def catch_up(self, tell: Callable[[Backlog], None], *, everything: bool) -> None:
        """Upload what is new.

        Args:
            tell: hears what is still lacking, before the first upload and after each.
            everything: also what changes all the time (logs, report), which otherwise waits for some minutes.

        Raises:
            FarmError: a file of the catalogue is damaged (what may come before it is up), the store did not answer, or
                what `hold` raised.
        """
        everything = everything or time.monotonic() >= self._changing_due
        while True:
            try:
                self._catch_up(tell, everything)
                break
            except PartGoneError:
                continue  # it was merged into a larger one, which is listed now
        if everything:
            self._changing_due = time.monotonic() + _CHANGING_SECONDS
        self._remove_old_snapshots()

    def _catch_up(self, tell: Callable[[Backlog], None], everything: bool) -> None:
        self._hold()
        groups = [group for group in self._lacking(everything) if group]
        files = sum(map(len, groups))
        size = sum(upload.size for group in groups for upload in group)
        tell(Backlog(files, size))
        for group in groups:
            for start in range(0, len(group), _AT_ONCE):
                self._hold()
                few = group[start : start + _AT_ONCE]
                self._put(few)
                files -= len(few)
                size -= sum(upload.size for upload in few)
                tell(Backlog(files, size))

    def _lacking(self, everything: bool) -> Iterator[Sequence[_Upload]]:
        """Groups of uploads: what is in one may go up together, one group after the other."""
        files = local_files(self._root)
        if not any(file.key == _SHEET for file in files[Stage.PICTURE]):
            files[Stage.END] = []  # it is being drawn: a run that has ended has its picture
        yield from ([document] for document in self._changed(files[Stage.DOCUMENT]))
        yield from self._commits(files[Stage.PART])
        yield self._unknown(files[Stage.SNAPSHOT])
        solids = self._changed(files[Stage.SOLID_LIST])
        unfinished = {upload.key.rpartition("/")[0] for upload in solids}
        yield [_upload(file) for file in files[Stage.SOLID] if file.key.rpartition("/")[0] in unfinished]
        yield solids
        yield self._changed(files[Stage.PICTURE]) if everything else []
        yield self._unknown(files[Stage.END])
        yield self._changed(files[Stage.LOG]) if everything else []

    def _unknown(self, files: Sequence[LocalFile]) -> list[_Upload]:
        """Files whose names stand for their content, and which the mirror does not have."""
        return [_upload(file) for file in files if self._there.get(file.key) != file.size]

    def _changed(self, files: Sequence[LocalFile]) -> list[_Upload]:
        """Files that may change, and are not in the mirror as they are."""
        changed = []
        for file in sorted(files, key=lambda file: (file.modified_ns, file.key)):
            stamp = (file.size, file.modified_ns)
            if self._stamps.get(file.key) == stamp:
                continue
            if self._there.get(file.key) == file.size and self._etags.get(file.key) == etag_of(self._root / file.key):
                self._stamps[file.key] = stamp
            else:
                changed.append(_upload(file))
        return changed

    def _commits(self, files: Sequence[LocalFile]) -> Iterator[Sequence[_Upload]]:
        """The commits that the mirror lacks, in order of their epochs: the clouds of each, then its part.

        What was merged into a larger part does not go up any more; what of it went up before stays, unread.
        """
        standing = set(list_parts(self._root))
        unknown = [file for file in files if self._there.get(file.key) != file.size]
        lacking = {name: file for file in unknown if (name := _name(file)) in standing}
        mended = mended_files(self._root)
        for name in self._in_order_of_epochs(lacking):
            clouds = []
            for key, facts in (item for commit in self._commits_of[name] for item in commit.files.items()):
                accepted = mended.get(key, frozenset()) | {facts}
                if self._there.get(key) not in {size for size, _ in accepted}:
                    clouds.append(_Upload(key, facts[0], None, accepted))
            key, size = lacking[name].key, lacking[name].size
            yield clouds
            yield [_Upload(key, size, None, frozenset({(size, name.checksum)}))]

    def _in_order_of_epochs(self, names: Iterable[PartName]) -> list[PartName]:
        known = self._commits_of
        self._commits_of = {name: known.get(name) or read_commits(self._root, name, records=False) for name in names}
        return sorted(
            self._commits_of,
            key=lambda name: (
                name.writer.partition("-")[0],
                epochs_of(self._commits_of[name]),
                name.seq,
                name.writer,
            ),
        )

    def _put(self, uploads: Sequence[_Upload]) -> None:
        contents = {upload.key: content for upload in uploads if (content := self._content(upload)) is not None}
        self._store.put_all(contents)
        for upload in uploads:
            if upload.key in contents:
                self._there[upload.key] = len(contents[upload.key])
                self._etags.pop(upload.key, None)
                if upload.stamp is not None:
                    self._stamps[upload.key] = upload.stamp
        self.arrived += len(contents)
        self.arrived_bytes += sum(map(len, contents.values()))

    def _content(self, upload: _Upload) -> bytes | None:
        """What is to go up, if it is as it should be; None if it is gone and nobody needs it."""
        try:
            content = (self._root / upload.key).read_bytes()
        except FileNotFoundError:
            if upload.accepted is None:
                return None  # an older snapshot, or a solid that is being made again
            if upload.key.startswith(f"{DESIGNS}/") and self._is_merged(upload.key):
                raise PartGoneError(upload.key) from None
            content = b""
        if upload.accepted is not None and (len(content), crc32c(content)) not in upload.accepted:
            raise FarmError(
                f"{self._root / upload.key}: missing or damaged, so it is not mirrored; `farm verify {self._root} "
                "--repair`"
            )
        return content

    def _is_merged(self, key: str) -> bool:
        """Whether a larger part has taken the place of one that is gone."""
        name = part_name(key.removeprefix(f"{DESIGNS}/"))
        return name is not None and any(holds(part, name) for part in list_parts(self._root))

    def _remove_old_snapshots(self) -> None:
        for key in [key for key in self._there if key.startswith(f"{SNAPSHOTS}/")]:
            if not (self._root / key).exists():
                self._store.delete(key)
                del self._there[key]


def _upload(file: LocalFile) -> _Upload:
    return _Upload(file.key, file.size, (file.size, file.modified_ns))


def _name(file: LocalFile) -> PartName | None:
    return part_name(file.key.removeprefix(f"{DESIGNS}/"))


def mended_files(root: Path) -> dict[str, frozenset[tuple[int, int]]]:
    """(bytes, CRC32C) of cloud files that a repair grew again with other bytes."""
    mended: dict[str, frozenset[tuple[int, int]]] = {}
    for path in sorted((root / MENDINGS).glob("[!.]*.json")):
        for key, facts in ((opened_document(path.read_bytes()) or {}).get("files") or {}).items():
            mended[key] = mended.get(key, frozenset()) | {(facts["bytes"], facts["crc32c"])}
    return mended


def etag_of(path: Path) -> str:
    """What S3 calls an object's ETag, mostly; not a matter of trust: a file that differs is only uploaded again."""
    try:
        return hashlib.md5(path.read_bytes(), usedforsecurity=False).hexdigest()
    except OSError:
        return ""
