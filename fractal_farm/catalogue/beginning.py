"""How a run begins in a catalogue, and what is left when that is cut short.

The last step is the appearance of run.json. Whoever dies before it leaves a directory without a run, which the next
`begin_run` takes over: there is nothing in it that anybody could miss.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.durable import PARTIAL, Durability, locked, make_directory, put
from fractal_farm.catalogue.layout import CLOUDS, RUNS, run_directory
from fractal_farm.catalogue.runs import create_run, run_ids
from fractal_farm.catalogue.shards import root_documents
from fractal_farm.errors import InputError

_MADE_BEFORE = re.compile(rf"{CLOUDS}|{RUNS}(/[0-9a-z]{{4,32}})?")


def begin_run(
    root: Path, run_id: str, description: Mapping[str, Any], durability: Durability = "full", *, into: bool = False
) -> None:
    """Make a catalogue with this run in it, or enter the run into one; of several at once, one does.

    Args:
        root: a directory that is new or `is_unbegun`; with `into` also a catalogue.
        run_id: id of the run.
        description: see `create_run`.
        durability: see `durable.put_all`.
        into: whether there may be other runs.

    Raises:
        InputError: the directory holds something else, or this run.
        FarmError: the file system failed.
    """
    make_directory(root, durability)
    with locked(root):
        if is_unbegun(root):
            _clear(root)
            for key, content in root_documents().items():
                put(root / key, content, durability)
        elif not into:
            raise InputError(f"{root}: {what_is_there(root)}")
        _clear(run_directory(root, run_id))
        create_run(root, run_id, description, durability)


def is_unbegun(root: Path) -> bool:
    """Whether a directory is empty, or holds no more than what was made before the first run.json."""
    return all(
        _MADE_BEFORE.fullmatch(key) if path.is_dir() else key in root_documents() or _is_partial(path)
        for path in root.rglob("*")
        for key in [path.relative_to(root).as_posix()]
    )


def what_is_there(root: Path) -> str:
    """Why no new catalogue can be made in a directory, and what to do about it."""
    held = run_ids(root)
    return (
        f"holds run {', '.join(held)}; choose another --out, or `farm resume {root}`"
        if held
        else ("is not empty; choose another --out")
    )


def _clear(directory: Path) -> None:
    """Remove partial files, which their dead process can no longer finish."""
    for path in directory.rglob("*"):
        if _is_partial(path):
            path.unlink()


def _is_partial(path: Path) -> bool:
    return path.name.startswith(".") and path.name.endswith(PARTIAL)
