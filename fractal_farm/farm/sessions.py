"""`submit` and `resume`: one session of a run, from its preparation to the summary (DESIGN sections 4 and 5)."""

from __future__ import annotations

import contextlib
import functools
import os
import platform
import socket
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from fractal_farm.catalogue import (
    Catalogue,
    committed_records,
    create_run,
    latest_snapshot,
    read_run,
    record_end,
    remove_orphans,
    run_ids,
    run_lock,
)
from fractal_farm.catalogue.rows import GENOME_COLUMNS, genome_of
from fractal_farm.config import RunConfig
from fractal_farm.errors import InputError
from fractal_farm.evolution.island import IslandState, founding_state, library_after
from fractal_farm.evolution.migration import sources
from fractal_farm.farm.event_log import EventLog
from fractal_farm.farm.events import Announcer, Callback, Progress, RunEnded, RunStarted
from fractal_farm.farm.executor import Executor, SerialExecutor
from fractal_farm.farm.history import only_run
from fractal_farm.farm.interrupts import interrupts
from fractal_farm.farm.mesh_queue import MeshQueue
from fractal_farm.farm.preflight import check_disk
from fractal_farm.farm.publisher import Publisher
from fractal_farm.farm.records import unpack_ledger, unpack_states
from fractal_farm.farm.report import write_report
from fractal_farm.farm.run import Run
from fractal_farm.farm.schedule import Schedule
from fractal_farm.farm.sheet import write_sheet
from fractal_farm.farm.work import MeshOrder
from fractal_farm.solid import SolidParameters

INTERRUPTED = 130


@dataclass(frozen=True)
class RunSummary:
    """How a session ended.

    Attributes:
        run_id: id of the run.
        name: its name.
        path: the catalogue.
        ended: why it ended, the totals, the content digest.
        sheet: the picture of the best designs, or None.
    """

    run_id: str
    name: str
    path: Path
    ended: RunEnded
    sheet: Path | None

    @property
    def exit_code(self) -> int:
        """0, or 130 after an interruption."""
        return INTERRUPTED if self.ended.interrupted else 0

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: run_id, name, path, sheet, the fields of `RunEnded`, and `Progress` under "progress"."""
        places = {"path": str(self.path), "sheet": str(self.sheet) if self.sheet else None}
        return {"run_id": self.run_id, "name": self.name, **places, **asdict(self.ended)}


def submit(
    config: RunConfig,
    out: Path,
    *,
    address: str | None = None,
    executor: str | None = None,
    into: bool = False,
    callbacks: Sequence[Callback] = (),
) -> RunSummary:
    """Start a run in a new catalogue, and stay with it to its end.

    Args:
        config: what to run.
        out: directory of the catalogue; it must not exist, or be empty.
        address: Ray cluster to work on; overrides the configuration.
        executor: "ray" or "serial"; overrides the configuration.
        into: add the run to an existing catalogue instead.
        callbacks: hear the events of the run.

    Raises:
        InputError: the directory holds something else, the disk is too small, nothing answers at the address.
        FarmError: the work failed.
    """
    _check_target(out, config, into)
    check_disk(config, out)
    with _workers(config, address, executor) as new_executor:
        if not (into and out.exists()):
            Catalogue.create(out)
        description = {"config": config.to_dict(), "versions": _versions()}
        create_run(out, config.run_id, description, config.catalogue.durability)
        return _session(config, out, new_executor, callbacks)


def resume(
    path: Path,
    *,
    overrides: Sequence[str] = (),
    address: str | None = None,
    executor: str | None = None,
    callbacks: Sequence[Callback] = (),
) -> RunSummary:
    """Go on with a run from its last committed epoch, or extend a finished one.

    Args:
        path: the catalogue.
        overrides: `section.field=value`; what decides the designs cannot be changed.
        address: Ray cluster to work on; overrides the configuration.
        executor: "ray" or "serial"; overrides the configuration.
        callbacks: hear the events of the run.

    Raises:
        InputError: not a catalogue, no run in it, another process works on it, or a forbidden override.
        FarmError: the work failed.
    """
    run_id = only_run(path)
    stored = read_run(path, run_id)["config"]
    config = RunConfig.from_dict(stored, f"{path}: run.json", overrides)
    if config.run_id != run_id:
        raise InputError(
            f"--set {' '.join(overrides)}: the evolution section decides the designs of run {run_id} and cannot "
            "change; submit a new run instead"
        )
    if config.catalogue.keep != stored["catalogue"]["keep"]:
        raise InputError(f"--set catalogue.keep={config.catalogue.keep}: it is fixed when the run begins")
    check_disk(config, path, Catalogue.open(path).usage().bytes)
    with run_lock(path, run_id):
        pass  # a run that is at work is refused before anything is started for it
    with _workers(config, address, executor) as new_executor:
        return _session(config, path, new_executor, callbacks)


NewExecutor = Callable[[Path], Executor]


def _session(config: RunConfig, root: Path, new_executor: NewExecutor, callbacks: Sequence[Callback]) -> RunSummary:
    """Work on a run under its lock, from where it stands."""
    run_id = config.run_id
    with run_lock(root, run_id), contextlib.ExitStack() as stack:
        remove_orphans(root, run_id)
        schedule, progress, elapsed_s = restore(config, root)
        log = EventLog(root, run_id)
        stack.callback(log.close)
        announce = Announcer([log, *callbacks])
        executor = new_executor(root)
        stack.callback(executor.close)
        interrupted = stack.enter_context(interrupts())
        usage = Catalogue.open(root).usage()
        queue = mesh_queue(config, root)
        announce(
            RunStarted(
                run_id,
                config.name,
                str(root),
                executor.name,
                executor.workers,
                config.evolution.islands,
                progress,
                usage.files,
                usage.bytes,
                queue.started,
                config.stop.model_dump(),
            )
        )
        run = Run(
            config,
            root,
            executor,
            schedule,
            progress,
            queue,
            announce,
            interrupted,
            (usage.files, usage.bytes),
            elapsed_s,
        )
        reason = run.evolve()
        run.mesh_the_rest()
        digest = Catalogue.open(root).digest(run_id)
        ended = RunEnded(
            reason,
            interrupted() is not None,
            run.progress,
            run.elapsed_s,
            digest,
            run.meshes,
            run.mesh_failures,
        )
        record_end(root, run_id, asdict(ended), config.catalogue.durability)
        sheet = write_sheet(root, config)
        announce(ended)
        write_report(root, config)
        return RunSummary(run_id, config.name, root, ended, sheet)


def restore(config: RunConfig, root: Path) -> tuple[Schedule, Progress, float]:
    """Where a run stands, from its committed records alone.

    Returns:
        The schedule after the last committed epoch, the totals up to it, and the seconds worked so far.
    """
    evolution = config.evolution
    empty = founding_state(evolution)
    dtype = empty.library.dtype
    states = dict.fromkeys(range(evolution.islands), empty)
    committed = list(committed_records(root, config.run_id))
    last = committed[-1][0][1] if committed else -1
    lag = evolution.migration.lag
    # Emigrants of the last `lag` epochs are still under way, so the replay begins before them.
    if (snapshot := latest_snapshot(root, config.run_id, last - lag)) is not None:
        states = unpack_states(snapshot[1], dtype)
    start = states[0].epoch
    progress, elapsed_s = Progress(), 0.0
    outbox = []
    for (_, until), blob in committed:
        ledger = unpack_ledger(blob, dtype)
        progress, elapsed_s = ledger.progress, max(elapsed_s, ledger.elapsed_s)
        for record in ledger.records if until > start else ():
            before = states[record.island]
            if record.epoch == before.epoch + 1:
                state = IslandState(record.epoch, library_after(before.library, record))
                states[record.island] = state
                outbox.append((record.island, record.epoch, state.library[record.emigrants]))
    migration = evolution.migration
    links = sources(migration.topology, evolution.islands, migration.degree, evolution.seed)
    schedule = Schedule(links, lag, states)
    for island, epoch, leaving in outbox:
        if epoch > last - lag:
            schedule.remember(island, epoch, leaving)
    return schedule, progress, elapsed_s


def mesh_queue(config: RunConfig, root: Path) -> MeshQueue:
    """The designs of a run that have no solid yet."""
    settings = config.solids
    parameters = SolidParameters(size_mm=settings.size_mm, wall_mm=settings.wall_mm)
    catalogue = Catalogue.open(root)
    made = {solid.design_id for solid in catalogue.solids() if solid.parameters_hash == parameters.hash}
    designs = catalogue.designs([*GENOME_COLUMNS, "fitness", "gap"], config.run_id)
    own = made.intersection(designs.column("design_id").to_pylist())
    queue = MeshQueue(settings.max, settings.wall_mm / settings.size_mm, len(own))
    for identity in made:
        queue.skip(identity)
    designs = designs.filter(pc.greater(designs.column("fitness"), config.evolution.qualified))
    thickened = pc.greater(designs.column("gap"), settings.wall_mm / settings.size_mm)
    designs = designs.append_column("thickened", thickened).sort_by(
        [("thickened", "ascending"), ("fitness", "descending"), ("design_id", "ascending")]
    )
    wanted = None if settings.max is None else 2 * settings.max
    for row in designs.slice(0, wanted).to_pylist():
        if row["design_id"] not in made:
            queue.offer(MeshOrder(genome_of(row), parameters, settings.formats), row["fitness"], row["gap"])
    return queue


@contextlib.contextmanager
def _workers(config: RunConfig, address: str | None, executor: str | None) -> Iterator[NewExecutor]:
    """Connect to whoever will work, before anything is written."""
    address = address or config.execution.address
    kind = executor or ("ray" if address else config.execution.executor)
    if kind == "serial":
        if address:
            raise InputError(f"--address {address}: the serial executor works in this process; leave one of them out")
        yield lambda root: SerialExecutor(config, _new_publisher(root, config))
        return
    if address and config.execution.workers is not None:
        raise InputError(
            f"execution.workers {config.execution.workers}: the cluster at {address} decides how many work; "
            "leave one of them out"
        )
    from fractal_farm.farm.on_ray.session import session

    with session(address, config.execution.workers) as processors:
        from fractal_farm.farm.on_ray.executor import RayExecutor

        yield lambda root: RayExecutor(config, _new_publisher(root, config), processors)


def _new_publisher(root: Path, config: RunConfig) -> Callable[[], Publisher]:
    attempt = len(list((root / "clouds").glob(f"{config.run_id}-*")))
    return functools.partial(Publisher, root.resolve(), config, socket.gethostname(), attempt)


def _check_target(out: Path, config: RunConfig, into: bool) -> None:
    """Refuse before anything is started or written."""
    if into and out.exists():
        Catalogue.open(out)
        if config.run_id in run_ids(out):
            raise InputError(f"{out}: run {config.run_id} is in this catalogue already; `farm resume {out}`")
        return
    place = out.absolute()
    while not place.exists():
        place = place.parent
    if not place.is_dir():
        raise InputError(f"{out}: {place} is a file; choose another --out")
    if not os.access(place, os.W_OK | os.X_OK):
        raise InputError(f"{out}: {place} is not writable; choose another --out")
    if out.exists() and (held := run_ids(out)):
        raise InputError(f"{out}: holds run {', '.join(held)}; choose another --out, or `farm resume {out}`")
    if out.exists() and any(out.iterdir()):
        raise InputError(f"{out}: is not empty; choose another --out")


def _versions() -> dict[str, str]:
    """What the bits may depend on."""
    names = ("fractal-farm", "numpy", "numba", "llvmlite", "ray", "zarr", "pyarrow")
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for name in names:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found
