"""numba's cache of compiled functions, made safe: what is damaged counts as missing, what cannot be saved is not.

A power cut leaves torn files, and numba reads what it finds: a torn index ends every later run, a torn function would
be executed. Here every file ends with a checksum of what comes before it, which numba's reader does not look at. A file
without the right one is compiled for again and overwritten. A full disk costs a line on the log, and the cache.
"""

# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import contextlib
import hashlib
import io
import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from numba.core.caching import FunctionCache, IndexDataCacheFile

_DIGEST_BYTES = 16
_log = logging.getLogger("fractal_farm")


class KernelCache(FunctionCache):
    """The cache of one function."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        plain = self._cache_file
        self._cache_file = _CheckedFiles(plain._cache_path, self._impl.filename_base, plain._source_stamp)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a compiled function if that is possible."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _log.warning("farm: kernels cannot be saved in %s (%s); they are compiled anew", self.cache_path, error)
            self.disable()


class _CheckedFiles(IndexDataCacheFile):
    """Index and data files that end with their checksum."""

    @contextlib.contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        content = io.BytesIO()
        with super()._open_for_write(filepath) as file:
            yield content
            file.write(content.getvalue() + _digest(content.getvalue()))

    def _load_index(self) -> dict[Any, Any]:
        overloads: dict[Any, Any] = super()._load_index() if _is_sound(Path(self._index_path)) else {}
        return overloads

    def _load_data(self, name: str) -> Any:
        path = Path(self._data_path(name))
        if not _is_sound(path):
            raise OSError(f"{path}: damaged")  # which the caller takes for a missing file
        return super()._load_data(name)


def _is_sound(path: Path) -> bool:
    try:
        content = path.read_bytes()
    except OSError:
        return False
    return len(content) > _DIGEST_BYTES and content[-_DIGEST_BYTES:] == _digest(content[:-_DIGEST_BYTES])


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_DIGEST_BYTES).digest()
