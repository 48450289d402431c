"""Who works for a run: connected before anything is written, and replaced when all of them are lost."""

from __future__ import annotations

import contextlib
import functools
import socket
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from fractal_farm.catalogue.fence import take_over
from fractal_farm.config import RunConfig
from fractal_farm.errors import InputError
from fractal_farm.farm.events import Callback
from fractal_farm.farm.executor import Executor, SerialExecutor
from fractal_farm.farm.journal import Journal
from fractal_farm.farm.publisher import Publisher


@dataclass(frozen=True)
class Workforce:
    """Where executors come from.

    Attributes:
        new_executor: makes one for a catalogue whose run lock the caller holds; writers of earlier ones are shut out.
        replace: brings new workers in place of those that were lost; False if that is not ours to do.
        callbacks: who among them wants to hear the events of the run.
    """

    new_executor: Callable[[Path], Executor]
    replace: Callable[[], bool]
    callbacks: tuple[Callback, ...] = ()


@contextlib.contextmanager
def workforce(config: RunConfig) -> Iterator[Workforce]:
    """Connect to whoever works, as `execution` says.

    Raises:
        InputError: nothing answers at the address, or it cannot be combined with the rest.
        FarmError: Ray does not start.
    """
    execution = config.execution
    if execution.executor == "serial":
        yield Workforce(
            lambda root: SerialExecutor(config, _new_publisher(root, config), Journal(root, config.run_id)),
            lambda: False,
        )
        return
    if execution.address and execution.workers is not None:
        raise InputError(
            f"execution.workers {execution.workers}: the cluster at {execution.address} decides how many work; "
            "leave one of them out"
        )
    from fractal_farm.farm.on_ray.session import session

    with session(execution.address, execution.workers, execution.metrics) as cluster:
        from fractal_farm.farm.on_ray.executor import RayExecutor
        from fractal_farm.farm.on_ray.metrics import metrics

        with contextlib.ExitStack() as stack:
            callbacks = () if execution.metrics is None else (stack.enter_context(metrics()),)
            yield Workforce(
                lambda root: RayExecutor(config, _new_publisher(root, config), cluster), cluster.restart, callbacks
            )


def _new_publisher(root: Path, config: RunConfig) -> Callable[[], Publisher]:
    attempt = len(list((root / "clouds").glob(f"{config.run_id}-*")))
    token = take_over(root, config.run_id)
    return functools.partial(Publisher, root.resolve(), config, socket.gethostname(), attempt, token)
