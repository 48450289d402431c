"""The fence around a run's files: who may write (DESIGN section 5).

A writer may outlive the process that started it, on a cluster above all. Each session takes the fence over with a
token of its own, under the run's lock; a writer holds the fence while it writes, and only with the token of its
session. So nobody writes once a later session has taken over, and taking over waits for a write under way.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fractal_farm.catalogue.durable import make_directory
from fractal_farm.catalogue.layout import crc32c, run_directory
from fractal_farm.errors import FarmError

FENCE = "fence"
_TOKEN_BYTES = 16
_SEAL_BYTES = 4
_PATIENCE_SECONDS = 60.0


def take_over(root: Path, run_id: str) -> str:
    """Shut out the writers of all earlier sessions; the caller holds the run's lock.

    Returns:
        The token of the writers of this session.

    Raises:
        FarmError: a writer of an earlier session does not finish what it is writing.
    """
    make_directory(run_directory(root, run_id))
    with _held(root, run_id) as descriptor:
        token = secrets.token_hex(_TOKEN_BYTES - _SEAL_BYTES)
        token += f"{crc32c(token.encode()):08x}"
        os.pwrite(descriptor, token.encode(), 0)
    return token


def is_whole(content: bytes) -> bool:
    """Whether every bit of a fence is as `take_over` wrote it."""
    token, seal = content[: -2 * _SEAL_BYTES], content[-2 * _SEAL_BYTES :]
    return not content or (len(content) == 2 * _TOKEN_BYTES and seal == f"{crc32c(token):08x}".encode())


@contextmanager
def writing(root: Path, run_id: str, token: str) -> Iterator[None]:
    """Hold the fence while writing.

    Raises:
        FarmError: another session has taken over, or another writer does not finish.
    """
    with _held(root, run_id) as descriptor:
        if os.pread(descriptor, 2 * _TOKEN_BYTES, 0).decode() != token:
            raise FarmError(f"{root}: another session works on run {run_id} now; this writer may not write any more")
        yield


@contextmanager
def _held(root: Path, run_id: str) -> Iterator[int]:
    path = run_directory(root, run_id) / FENCE
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        deadline = time.monotonic() + _PATIENCE_SECONDS
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise FarmError(
                        f"{path}: a writer of an earlier session holds it and does not finish; end the processes "
                        "ray::Writer that are left, then resume"
                    ) from None
                time.sleep(0.02)
        yield descriptor
    finally:
        os.close(descriptor)
