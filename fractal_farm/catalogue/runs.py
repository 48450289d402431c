"""Runs in a catalogue: what they were asked for, who works on them, how they ended (DESIGN section 5).

run.json is written once. A lock, freed by the kernel when its process dies, keeps two processes from working
on one run. Each end of a run adds a record of its own, so that a run may be extended later.
"""

from __future__ import annotations

import fcntl
import os
import re
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.documents import encoded_document, read_document
from fractal_farm.catalogue.durable import Durability, make_directory, put
from fractal_farm.catalogue.layout import RUNS, crc32c, run_directory
from fractal_farm.catalogue.parts import list_parts
from fractal_farm.errors import InputError

_RUN = "run.json"
LOCK = "lock"
_END = re.compile(r"final~(\d{4})~([0-9a-f]{8})\.json")
_PATIENCE_SECONDS = 1.0


@dataclass(frozen=True)
class RunInfo:
    """One run of a catalogue.

    Attributes:
        run_id: its id.
        description: what `create_run` was given.
        ends: the records of `record_end`, oldest first; empty while the run has never ended.
        live: whether a process holds its lock now.
        commits: manifest parts.
        rows: designs in them, before duplicates are dropped.
    """

    run_id: str
    description: dict[str, Any]
    ends: tuple[dict[str, Any], ...]
    live: bool
    commits: int
    rows: int


def create_run(root: Path, run_id: str, description: Mapping[str, Any], durability: Durability = "full") -> None:
    """Write run.json, once and for all.

    Args:
        root: directory of the catalogue.
        run_id: id of the run.
        description: JSON object: configuration as given and as resolved, seed, versions.
        durability: see `durable.put_all`.

    Raises:
        InputError: the catalogue has this run already.
        FarmError: the file system failed.
    """
    path = run_directory(root, run_id) / _RUN
    if path.exists():
        raise InputError(f"{root}: run {run_id} exists already; resume it, or choose another directory")
    put(path, encoded_document(description), durability)


def read_run(root: Path, run_id: str) -> dict[str, Any]:
    """What `create_run` was given.

    Raises:
        InputError: no such run.
        FarmError: run.json is damaged.
    """
    path = run_directory(root, run_id) / _RUN
    if not path.is_file():
        raise InputError(f"{root}: no run {run_id}; the runs are {', '.join(run_ids(root)) or 'none'}")
    return read_document(path)


def run_ids(root: Path) -> list[str]:
    """The runs of a catalogue, in order of their ids."""
    return sorted(path.parent.name for path in (root / RUNS).glob(f"*/{_RUN}"))


def run_info(root: Path, run_id: str) -> RunInfo:
    """What is known of a run; see `read_run` for what is raised."""
    description = read_run(root, run_id)
    parts = list_parts(root, run_id)
    rows = sum(part.rows for part in parts)
    live = run_is_live(root, run_id)
    return RunInfo(run_id, description, tuple(run_ends(root, run_id)), live, len(parts), rows)


def run_is_live(root: Path, run_id: str) -> bool:
    """Whether a process holds the run's lock now."""
    return _is_locked(run_directory(root, run_id) / LOCK)


def record_end(root: Path, run_id: str, facts: Mapping[str, Any], durability: Durability = "full") -> None:
    """Add a record of how the run ended this time (epoch, reason, totals); the caller holds the lock.

    Raises:
        FarmError: the file system failed.
    """
    content = encoded_document(facts)
    number = len(_ends(root, run_id))
    put(run_directory(root, run_id) / f"final~{number:04d}~{crc32c(content):08x}.json", content, durability)


def run_ends(root: Path, run_id: str) -> list[dict[str, Any]]:
    """The records of `record_end`, oldest first.

    Raises:
        FarmError: one of them is damaged.
    """
    return [read_document(path) for path in _ends(root, run_id)]


@contextmanager
def run_lock(root: Path, run_id: str, patience_s: float = _PATIENCE_SECONDS) -> Iterator[None]:
    """Hold the run: only one process works on it. The kernel frees the lock when the process dies.

    Args:
        root: directory of the catalogue.
        run_id: id of the run, or `layout.HAND`.
        patience_s: how long to wait for another that holds it.

    Raises:
        InputError: another live process holds it.
    """
    path = run_directory(root, run_id) / LOCK
    make_directory(path.parent)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        if not _acquired(descriptor, patience_s):
            holder = path.read_text().partition(" #")[0].strip() or "another process"
            raise InputError(f"{root}: run {run_id} is in the hands of {holder}; wait for it, or stop it first")
        os.ftruncate(descriptor, 0)
        holder = f"process {os.getpid()} on {socket.gethostname()}"
        os.write(descriptor, f"{holder} #{crc32c(holder.encode()):08x}\n".encode())
        yield
    finally:
        os.close(descriptor)


def is_whole_lock(content: bytes) -> bool:
    """Whether every bit of a lock's text is as `run_lock` wrote it; it may be empty, and older ones have no seal."""
    holder, mark, seal = content.partition(b" #")
    if not mark:
        return not content or re.fullmatch(rb"process \d+ on [^\s#]+\n", content) is not None
    return seal == f"{crc32c(holder):08x}\n".encode()


def _acquired(descriptor: int, patience_s: float) -> bool:
    """Take the lock; a reader that tests it (`_is_locked`) holds it for an instant, so ask more than once."""
    deadline = time.monotonic() + patience_s
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > deadline:
                return False
            time.sleep(0.02)
        else:
            return True


def _is_locked(path: Path) -> bool:
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def _ends(root: Path, run_id: str) -> list[Path]:
    return sorted(path for path in run_directory(root, run_id).glob("final~*.json") if _END.fullmatch(path.name))
