"""Which versions a run was begun with, and whether this one may go on with it."""

from __future__ import annotations

import contextlib
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

from fractal_farm import __version__
from fractal_farm.catalogue import read_run
from fractal_farm.config import RunConfig
from fractal_farm.errors import InputError


def versions() -> dict[str, str]:
    """What the bits may depend on."""
    names = ("fractal-farm", "numpy", "numba", "llvmlite", "ray", "zarr", "pyarrow")
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for name in names:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


def check_version(path: Path, run_id: str, stored: dict[str, Any]) -> None:
    """Refuse to go on with what another version has grown: it would not be the same run.

    Raises:
        InputError: its configuration is unknown here, or stands for another run.
    """
    try:
        reason = None if RunConfig.from_dict(stored).run_id == run_id else "its evolution has another identity here"
    except InputError as error:
        reason = str(error)
    if reason is not None:
        grown_by = read_run(path, run_id).get("versions", {}).get("fractal-farm", "unknown")
        raise InputError(
            f"{path}: run {run_id} was grown by another version of the farm ({grown_by}; this is {__version__}: "
            f"{reason}) and cannot go on here; it can be listed, shown, meshed and verified as ever, and `farm submit` "
            "of its configuration to another directory grows it anew"
        )
