"""`stop`: a wish for the end of a live run, from another terminal or another machine that sees the catalogue.

The wish is an empty file in the run's directory. The run looks for it, ends at the last epoch that all islands have
completed, and a later session takes it away.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from fractal_farm.catalogue import Catalogue, is_unbegun, last_epoch, run_ids, run_is_live
from fractal_farm.catalogue.layout import run_directory
from fractal_farm.errors import FarmError, InputError

_WISH = "stop"
_LOOK_SECONDS = 0.2


def stop(path: Path, *, run: str | None = None, wait_s: float = 600.0, said: Callable[[], None] = lambda: None) -> int:
    """End a live run at the last epoch that all islands have completed, and wait until it has.

    Args:
        path: the catalogue.
        run: id of the run, or its first digits; the one that is live if None.
        wait_s: how long to wait for the end.
        said: called once the run has been asked.

    Returns:
        Epochs that are committed.

    Raises:
        InputError: not a catalogue, no such run, or it is not live.
        FarmError: it has not ended in time; it will, if it lives.
    """
    if run is None:
        Catalogue.open(path)
        live = [run_id for run_id in run_ids(path) if run_is_live(path, run_id)]
        if len(live) > 1:
            raise InputError(f"{path}: runs {', '.join(live)} are live; say which with --run")
        run_id = live[0] if live else chosen_run(path, None)
    else:
        run_id = chosen_run(path, run)
    if not run_is_live(path, run_id):
        raise InputError(f"{path}: run {run_id} is not live; there is nothing to stop")
    wish = run_directory(path, run_id) / _WISH
    wish.touch()
    said()
    deadline = time.monotonic() + wait_s
    while run_is_live(path, run_id):
        if time.monotonic() > deadline:
            raise FarmError(f"{path}: run {run_id} was asked to end and has not in {wait_s:.0f} s; see its own output")
        time.sleep(_LOOK_SECONDS)
    return last_epoch(path, run_id) + 1


def stop_requested(root: Path, run_id: str) -> bool:
    """Whether somebody wishes the end of a run."""
    return (run_directory(root, run_id) / _WISH).exists()


def withdraw_stop(root: Path, run_id: str) -> None:
    """Forget the wish; a new session begins."""
    (run_directory(root, run_id) / _WISH).unlink(missing_ok=True)


def chosen_run(path: Path, run: str | None) -> str:
    """The id of one of a catalogue's runs.

    Args:
        path: the catalogue.
        run: its id, or its first digits; the latest begun if None.

    Raises:
        InputError: not a catalogue, no such run, or several.
    """
    if path.is_dir() and is_unbegun(path):
        raise InputError(f"{path}: no run has begun here; start one with `farm submit CONFIG --out {path}`")
    Catalogue.open(path)
    found = run_ids(path)
    if not found:
        raise InputError(f"{path}: no run is in it; start one with `farm submit CONFIG --into --out {path}`")
    if run is None:
        return max(found, key=lambda run_id: (run_directory(path, run_id) / "run.json").stat().st_mtime)
    named = [run_id for run_id in found if run and run_id.startswith(run)]
    if len(named) != 1:
        what = f"{len(named)} runs begin with {run}" if named else f"no run {run}"
        raise InputError(f"{path}: {what}; the runs are {', '.join(found)}")
    return named[0]
