"""`kernel`: the numba decorator of every compiled function in the house.

Kernels release the GIL, use numpy's error model (no exceptions from inside a kernel), never fastmath (bits must not
depend on the instruction set), and are cached in a node-local directory. numba checks only the file that defines a
function, so a change in a callee of another file would go unseen: the directory is therefore keyed by a hash of all
sources that the kernels of a package can call (its own and those of `ifs`).
"""

from __future__ import annotations

import functools
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

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
    numba.config.CACHE_DIR = str(directory)  # type: ignore[attr-defined]
    njit: Any = numba.njit  # its type does not know no_cfunc_wrapper, which spares a third of the compile time
    return njit(nogil=True, cache=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)


def cache_directory(module: str) -> Path:
    """Where the compiled kernels of a module are kept: `<cache root>/<hash of the sources they can call>`."""
    parts = module.split(".")
    own = parts[1] if len(parts) > 2 and parts[0] == "fractal_farm" else "ifs"
    return cache_root() / _sources_hash(own)


@functools.cache
def cache_root() -> Path:
    """The first writable of $NUMBA_CACHE_DIR, the user's cache directory and the temporary directory."""
    candidates = []
    if given := os.environ.get("NUMBA_CACHE_DIR"):
        candidates.append(Path(given))
    home = os.environ.get("XDG_CACHE_HOME", "~/.cache")
    candidates.append(Path(home).expanduser() / "fractal_farm" / "kernels")
    for directory in candidates:
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(directory, os.W_OK | os.X_OK):
            return directory
    return Path(tempfile.gettempdir()) / f"fractal_farm-{os.getuid()}" / "kernels"


@functools.cache
def _sources_hash(own: str) -> str:
    digest = hashlib.blake2b(digest_size=8)
    for folder in sorted({"ifs", own}):
        for source in sorted((_PACKAGE / folder).glob("*.py")):
            digest.update(source.name.encode())
            digest.update(source.read_bytes())
    return f"{own}-{digest.hexdigest()}"
