"""Durable puts: what was acknowledged survives a kill and a power cut (research 'storage', 1.5, 4.4).

A file is written under a hidden partial name, synced, renamed, and its directory synced; so a name that can
be seen holds all of its bytes, and `put` returns only when the name is on the disk. Names are never reused
for other bytes.
"""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Literal

from fractal_farm.errors import FarmError, InputError, StorageFullError

Durability = Literal["full", "process"]
PARTIAL = ".partial"
_relied_on: set[Path] = set()
"""Directories whose entries this process has synced."""
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT)


def put(path: Path, content: bytes, durability: Durability = "full") -> None:
    """Write one file so that it is either wholly there or not at all; see `put_all`."""
    put_all({path: content}, durability)


def put_all(files: Mapping[Path, bytes], durability: Durability = "full") -> None:
    """Write files, each of them wholly or not at all, and return when they will survive.

    Args:
        files: path -> content. Directories are made as needed.
        durability: "full" syncs files and directories (survives a power cut); "process" only orders the steps
            (survives the death of the process).

    Raises:
        StorageFullError: no space left. No partial file stays behind.
        FarmError: any other failure of the file system.
    """
    staged: list[tuple[Path, Path]] = []
    with _explained(next(iter(files), Path()), sum(map(len, files.values()))):
        try:
            for path, content in files.items():
                make_directory(path.parent, durability)
                partial = partial_name(path)
                staged.append((partial, path))
                _write_new(partial, content, durability)
            for partial, path in staged:
                partial.replace(path)
        except BaseException:
            for partial, _ in staged:
                partial.unlink(missing_ok=True)
            raise
        if durability == "full":
            for directory in dict.fromkeys(path.parent for path in files):
                sync_directory(directory)


def put_directory(path: Path, files: Mapping[str, bytes], durability: Durability = "full") -> bool:
    """Make a directory that appears with all of its files at once.

    While it is being filled, its partial directory is locked, so that others can tell it from one left by a
    dead process (`remove_dead_directory`).

    Args:
        path: the directory; its parents are made as needed.
        files: plain file name -> content.
        durability: see `put_all`.

    Returns:
        False if the directory was already there; it is left as it is.

    Raises:
        StorageFullError: no space left. Nothing stays behind.
        FarmError: any other failure of the file system.
    """
    if path.is_dir():
        return False
    with _explained(path, sum(map(len, files.values()))):
        make_directory(path.parent, durability)
        partial = partial_name(path)
        try:
            with _new_and_locked(partial):
                for name, content in files.items():
                    _write_new(partial / name, content, durability)
                if durability == "full":
                    sync_directory(partial)
                try:
                    partial.rename(path)
                except OSError as error:
                    if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                        raise
                    shutil.rmtree(partial)
                    return False
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        if durability == "full":
            sync_directory(path.parent)
    return True


@contextmanager
def new_directory(path: Path, outside: Sequence[Path] = ()) -> Iterator[Path]:
    """Fill a directory beside its place, whatever its size; it appears there, durably, when the block ends.

    What a killed process left of an earlier attempt is removed first.

    Args:
        path: the directory.
        outside: directories that it must not lie in.

    Yields:
        The directory to fill.

    Raises:
        InputError: the place is taken, or cannot be written to.
        StorageFullError: no space left. Nothing stays behind.
        FarmError: any other failure of the file system.
    """
    if path.exists():
        raise InputError(f"{path}: exists already; name a new directory")
    check_place(path)
    for other in outside:
        if path.resolve().is_relative_to(other.resolve()):
            raise InputError(f"{path}: lies in {other}; name a directory outside of it")
    with _explained(path, 0):
        make_directory(path.absolute().parent)
        for left in path.parent.glob(f".{path.name}.*{PARTIAL}"):
            remove_dead_directory(left)
        partial = partial_name(path)
        partial.mkdir()
        try:
            with locked(partial):
                yield partial
                _sync_tree(partial)
                partial.rename(path)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        sync_directory(path.absolute().parent)


def check_place(path: Path) -> None:
    """Refuse a path at which nothing can be made.

    Raises:
        InputError: it lies below a file, or where we may not write.
    """
    place = path.absolute()
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        raise InputError(f"{path}: {place} is a file; name another place")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError(f"{path}: {place} is not writable; name another place")


def _sync_tree(directory: Path) -> None:
    for place, _, names in os.walk(directory):
        for name in names:
            descriptor = os.open(Path(place) / name, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        sync_directory(Path(place))


def make_directory(path: Path, durability: Durability = "full") -> None:
    """Make a directory and its missing parents, each entry synced in the directory that holds it.

    A directory that is there already may come from a process that died before it could sync the entry; so the entry
    is synced once by each process that relies on it.
    """
    missing = []
    while not path.is_dir():
        missing.append(path)
        path = path.parent
    if durability == "full" and path not in _relied_on:
        with suppress(PermissionError):  # the entry of a directory that was given to us is not ours to sync
            sync_directory(path.parent)
        _relied_on.add(path)
    for directory in reversed(missing):
        directory.mkdir(exist_ok=True)
        if durability == "full":
            sync_directory(directory.parent)
            _relied_on.add(directory)


def partial_name(path: Path) -> Path:
    """A unique name beside `path`, hidden from those who list data sets by folder."""
    return path.with_name(f".{path.name}.{uuid.uuid4().hex}{PARTIAL}")


def remove_dead_directory(partial: Path) -> bool:
    """Remove a partial directory of `put_directory`, unless a live process is filling it; whether it did."""
    try:
        with locked(partial.parent), locked(partial, blocking=False):
            shutil.rmtree(partial)
    except (BlockingIOError, FileNotFoundError):
        return False
    return True


def is_being_filled(partial: Path) -> bool:
    """Whether a live process fills a partial directory of `put_directory`, or has finished it by now."""
    try:
        with locked(partial.parent), locked(partial, blocking=False):
            return False
    except (BlockingIOError, FileNotFoundError):
        return True


def move_aside(path: Path, target: Path) -> None:
    """Rename a file or directory, durably; the directories of the target are made as needed.

    Raises:
        FarmError: the file system failed.
    """
    with _explained(path, 0):
        make_directory(target.parent)
        path.rename(target)
        sync_directory(target.parent)
        sync_directory(path.parent)


@contextmanager
def locked(directory: Path, *, blocking: bool = True) -> Iterator[None]:
    """Hold a directory's lock, which the kernel frees when its process dies.

    Raises:
        BlockingIOError: another one holds it, and `blocking` is False.
    """
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if blocking else fcntl.LOCK_NB))
        yield
    finally:
        os.close(descriptor)


def sync_directory(path: Path) -> None:
    """Make the names in a directory survive a power cut."""
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _new_and_locked(directory: Path) -> Iterator[None]:
    """Make a directory and hold its lock; who asks for it with its parent's lock in hand never sees one without."""
    with ExitStack() as stack:
        with locked(directory.parent):
            directory.mkdir()
            stack.enter_context(locked(directory))
        yield


def _write_new(path: Path, content: bytes, durability: Durability) -> None:
    with path.open("xb") as file:
        file.write(content)
        if durability == "full":
            file.flush()
            os.fsync(file.fileno())


@contextmanager
def _explained(path: Path, size: int) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno in _NO_SPACE:
            raise StorageFullError(
                f"{path}: no space left for {size} bytes; nothing that was committed is lost. Free space on "
                "this file system (solids/, pictures/ and logs/ can be made again), then resume"
            ) from error
        raise FarmError(f"{path}: cannot be written: {error.strerror}; check the file system") from error
