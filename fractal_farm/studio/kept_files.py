"""Finished solids on disk, in the user's cache directory: the oldest give way, and all may be lost without harm."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import stat
import tempfile
from pathlib import Path

MOST_BYTES = 2 << 30
_KEY = re.compile(r"[0-9a-f]{32}")
_CERTIFICATE = "certificate.json"


class KeptFiles:
    """Directories of files by key.

    Args:
        directory: where they lie; the user's cache if None.
    """

    def __init__(self, directory: Path | None = None) -> None:
        self._directory = _cache() if directory is None else directory

    def path(self, key: str) -> Path:
        """The directory of a key, 32 hex digits, whether it is there or not."""
        assert _KEY.fullmatch(key)
        return self._directory / key

    def files(self, key: str) -> tuple[str, ...] | None:
        """Names of the files of a key; None if there is none."""
        if not _KEY.fullmatch(key) or not (self.path(key) / _CERTIFICATE).is_file():
            return None
        with contextlib.suppress(OSError):
            os.utime(self.path(key))  # what is used is not the oldest
        return tuple(sorted(path.name for path in self.path(key).iterdir()))

    def prune(self) -> None:
        """Take away the longest unused until the rest is below `MOST_BYTES`."""
        sizes = {}
        for path in self._directory.iterdir():
            with contextlib.suppress(OSError):
                if _KEY.fullmatch(path.name):
                    sizes[path] = (path.stat().st_mtime, sum(file.stat().st_size for file in path.iterdir()))
        total = sum(size for _, size in sizes.values())
        for path, (_, size) in sorted(sizes.items(), key=lambda entry: entry[1])[:-1]:
            if total <= MOST_BYTES:
                break
            shutil.rmtree(path, ignore_errors=True)
            total -= size


def _cache() -> Path:
    """The user's, where he alone can write; a new one for temporary files otherwise."""
    place = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "fractal_farm" / "studio"
    with contextlib.suppress(OSError, RuntimeError):
        place = place.expanduser().absolute()
        place.mkdir(mode=stat.S_IRWXU, parents=True, exist_ok=True)
        status = place.stat()
        if status.st_uid == os.getuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            with tempfile.TemporaryFile(dir=place):
                return place
    return Path(tempfile.mkdtemp(prefix="farm-studio-"))
