"""`kernel`: the numba decorator of every compiled function in the house.

Kernels release the GIL, use numpy's error model (no exceptions from inside a kernel), never fastmath (bits must not
depend on the instruction set), and are cached in a node-local directory. numba checks only the file that defines a
function, so a change in a callee of another file would go unseen: the directory is therefore keyed by a hash of all
sources that the kernels of a package can call (its own and those of `ifs`). Where no directory can be written to,
kernels are compiled in every process.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

from fractal_farm.ifs.kernel_cache import KernelCache

_PACKAGE = Path(__file__).resolve().parent.parent


def kernel(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function in nopython mode; use as `@kernel` or `@kernel(inline="always")`.

    Args:
        function: the function to compile.
        **options: further options of `numba.njit`.

    Returns:
        The numba dispatcher; it compiles on the first call with each signature and is cached on disk.
    """
    if function is None:
        return functools.partial(kernel, **options)
    directory = cache_directory(function.__module__)
    njit: Any = numba.njit  # its type does not know no_cfunc_wrapper, which spares a third of the compile time
    dispatcher = njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    if directory is not None:
        numba.config.CACHE_DIR = str(directory)  # type: ignore[attr-defined]
        dispatcher._cache = KernelCache(function)
    return dispatcher


def cache_directory(module: str) -> Path | None:
    """Where the compiled kernels of a module are kept: `<cache root>/<hash of the sources they can call>`."""
    parts = module.split(".")
    own = parts[1] if len(parts) > 2 and parts[0] == "fractal_farm" else "ifs"
    root = cache_root()
    return None if root is None else root / _sources_hash(own)


@functools.cache
def cache_root() -> Path | None:
    """The first writable of $NUMBA_CACHE_DIR, the user's cache directory and the temporary directory; None if none is.

    If it is not the first, one line on the log says so.
    """
    candidates = []
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        candidates.append(Path(given))
    candidates.append(Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "fractal_farm" / "kernels")
    with contextlib.suppress(FileNotFoundError):  # nowhere to put temporary files
        candidates.append(Path(tempfile.gettempdir()) / f"fractal_farm-{os.getuid()}")
    found = next((place for place in map(_expanded, candidates) if place and _is_writable(place)), None)
    if found != _expanded(candidates[0]):
        instead = f"kernels are kept in {found}" if found else "every process compiles its kernels anew (a minute)"
        logging.getLogger("fractal_farm").warning(
            "farm: cannot write to the kernel cache %s; %s. Set NUMBA_CACHE_DIR to a directory that can be written to.",
            candidates[0],
            instead,
        )
    return found


def _expanded(place: Path) -> Path | None:
    try:
        return place.expanduser().absolute()
    except RuntimeError:  # no home
        return None


def _is_writable(directory: Path) -> bool:
    """Whether files can be made there, and nobody else can.

    Root may write anywhere but on a read-only file system, so it is tried. What lies in the cache is executed: where
    others could have put it, in a directory for temporary files above all, it is not used.
    """
    try:
        directory.mkdir(mode=stat.S_IRWXU, parents=True, exist_ok=True)
        status = directory.stat()
        if status.st_uid != os.getuid() or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return False
        with tempfile.TemporaryFile(dir=directory):
            return True
    except OSError:
        return False


@functools.cache
def _sources_hash(own: str) -> str:
    digest = hashlib.blake2b(digest_size=8)
    for folder in sorted({"ifs", own}):
        for source in sorted((_PACKAGE / folder).glob("*.py")):
            digest.update(source.name.encode())
            digest.update(source.read_bytes())
    return f"{own}-{digest.hexdigest()}"
