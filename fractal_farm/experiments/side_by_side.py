"""What experiments of many parts have in common: a directory that is theirs, and processes that work side by side."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.documents import encoded_document, read_document
from fractal_farm.catalogue.durable import check_place, put
from fractal_farm.errors import FarmError, InputError

ABOUT = "experiment.json"
_LOOK_SECONDS = 1.0


def claim(root: Path, about: Mapping[str, Any]) -> None:
    """Make the directory this experiment's, or see that it is.

    Args:
        root: the directory.
        about: what the experiment is, with a hash of its "sources"; fit for JSON.

    Raises:
        InputError: the directory holds something else, or what other sources have found.
    """
    path = root / ABOUT
    if path.exists():
        if (before := read_document(path)) != about:
            raise InputError(
                f"{root}: holds an experiment of sources {before.get('sources')}, these are {about['sources']}; "
                "name a new --out"
            )
        return
    check_place(root)
    if root.exists() and any(not entry.name.startswith(".") for entry in root.iterdir()):  # of a killed attempt
        raise InputError(f"{root}: holds something else; name a new --out")
    put(path, encoded_document(about))


def in_processes(
    work: Callable[..., object], calls: Sequence[tuple[Any, ...]], workers: int, look: Callable[[], None]
) -> None:
    """Call a function with each of some arguments, several at a time, and wait for all.

    Args:
        work: a function that another process can import.
        calls: arguments, a tuple for each call.
        workers: processes; 1 for this one alone.
        look: is called every second or so.

    Raises:
        FarmError: a worker died. Whatever `work` raises ends the others, too.
    """
    if workers == 1:
        for arguments in calls:
            work(*arguments)
            look()
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_end_with_parent) as pool:
        try:
            futures = {pool.submit(work, *arguments) for arguments in calls}
            while futures:
                done, futures = wait(futures, _LOOK_SECONDS, FIRST_COMPLETED)
                for future in done:
                    future.result()
                look()
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in multiprocessing.active_children():
                child.kill()
            if isinstance(error, BrokenProcessPool):
                remedy = f"the same call goes on, perhaps with fewer --workers than {workers}"
                raise FarmError(f"a worker died ({error}); {remedy}") from None
            raise


def _end_with_parent() -> None:
    """In a worker: Ctrl-C is the parent's affair, and nobody works on when the parent is gone, however it went."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
