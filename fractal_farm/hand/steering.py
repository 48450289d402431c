"""Steering by hand: let a run that is under way, or was interrupted, breed from chosen designs for some epochs.

A live run binds the wish itself, to the first epoch that none of its islands has begun. Nobody works on an interrupted
one, so it is bound here, to the epoch after the last commit.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fractal_farm.catalogue import last_epoch, run_ids, run_is_live, run_lock
from fractal_farm.catalogue.fence import take_over
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.catalogue.settings import read_settings
from fractal_farm.catalogue.steering import SteeringRequest, bind_wishes, record_wish, steering_requests
from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError, InputError
from fractal_farm.farm.steering import check_steerable
from fractal_farm.farm.stopping import chosen_run
from fractal_farm.hand.breeding import chosen_rows

_LOOK_SECONDS = 0.2


@dataclass(frozen=True)
class SteeredRun:
    """A run that breeds from chosen designs.

    Attributes:
        run_id: id of the run.
        request: what it is bound to.
        live: whether it is at work.
        epochs: epochs that are committed.
        beyond: whether its limit of epochs ends it before.
    """

    run_id: str
    request: SteeringRequest
    live: bool
    epochs: int
    beyond: bool


def steer(
    root: Path,
    ids: Sequence[str],
    *,
    run: str | None = None,
    wait_s: float = 600.0,
    said: Callable[[], None] = lambda: None,
) -> SteeredRun:
    """Let all islands of a run breed from designs, beside their own parents, for ten epochs.

    Args:
        root: the catalogue.
        ids: designs, or the first digits of their ids.
        run: id of the run, or its first digits; the one that is live if None, or the latest begun.
        wait_s: how long to wait for a live run to take the wish up.
        said: called once the wish is durable.

    Returns:
        What the run is bound to.

    Raises:
        InputError: no such design or run, or designs that the run cannot breed from.
        FarmError: a live run has not taken the wish up in time; it will, or the next session does.
    """
    rows = chosen_rows(root, ids)
    run_id = _run_of(root, run)
    config = RunConfig.from_dict(read_settings(root, run_id), f"{root}: run.json")
    genomes = [genome_of(row) for row in rows]
    check_steerable(genomes, config.evolution, run_id)
    wish = record_wish(root, run_id, genomes)
    said()
    deadline = time.monotonic() + wait_s
    while (request := _bound(root, run_id, wish)) is None:
        if time.monotonic() > deadline:
            raise FarmError(
                f"{root}: run {run_id} has not taken up the wish in {wait_s:.0f} s; it will, or the next `farm resume` "
                "does"
            )
        if run_is_live(root, run_id):
            time.sleep(_LOOK_SECONDS)
        else:
            _bind_here(root, run_id)
    beyond = config.stop.epochs is not None and config.stop.epochs <= request.first
    return SteeredRun(run_id, request, run_is_live(root, run_id), last_epoch(root, run_id) + 1, beyond)


def _run_of(root: Path, run: str | None) -> str:
    if run is None:
        live = [run_id for run_id in run_ids(root) if run_is_live(root, run_id)]
        if len(live) > 1:
            raise InputError(f"{root}: runs {', '.join(live)} are live; say which with --run")
        if live:
            return live[0]
    return chosen_run(root, run)


def _bound(root: Path, run_id: str, wish: str) -> SteeringRequest | None:
    return next((request for request in steering_requests(root, run_id) if request.wish == wish), None)


def _bind_here(root: Path, run_id: str) -> None:
    """Bind the wishes of a run that nobody works on; unless somebody begins to, at this moment."""
    try:
        with run_lock(root, run_id):
            take_over(root, run_id)  # no writer of a dead session may commit epochs after this look
            bind_wishes(root, run_id, last_epoch(root, run_id) + 1)
    except InputError:
        return
