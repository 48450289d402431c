"""`submit` and `resume`: one session of a run, from its preparation to the summary (DESIGN sections 4 and 5)."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from fractal_farm.catalogue import (
    Catalogue,
    begin_run,
    is_unbegun,
    last_epoch,
    record_end,
    remove_orphans,
    run_ids,
    run_lock,
    what_is_there,
)
from fractal_farm.catalogue.compaction import compact
from fractal_farm.catalogue.durable import check_place
from fractal_farm.catalogue.parts import list_parts
from fractal_farm.catalogue.settings import read_settings, record_settings
from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError, InputError, StorageFullError
from fractal_farm.farm.event_log import EventLog
from fractal_farm.farm.events import Announcer, Callback, Fault, MirrorChanged, RunEnded, RunStarted
from fractal_farm.farm.executor import ClusterLostError
from fractal_farm.farm.interrupts import interrupts
from fractal_farm.farm.mirroring import check_mirror, mirroring
from fractal_farm.farm.preflight import check_disk, disk_need
from fractal_farm.farm.report import write_report
from fractal_farm.farm.restore import known_shapes, mesh_queue, restore
from fractal_farm.farm.run import Run
from fractal_farm.farm.sheet import write_sheet
from fractal_farm.farm.stopping import chosen_run, stop_requested, withdraw_stop
from fractal_farm.farm.versions import check_version, versions
from fractal_farm.farm.workforce import Workforce, workforce

_LOSSES_WITHOUT_COMMIT = 5
_PARTS = 64  # of a run that ends, at most, before they are merged
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
        mirror: what the catalogue's mirror lacks, and why; None if there is no mirror.
    """

    run_id: str
    name: str
    path: Path
    ended: RunEnded
    sheet: Path | None
    mirror: MirrorChanged | None = None

    @property
    def exit_code(self) -> int:
        """0, or 130 after an interruption."""
        return INTERRUPTED if self.ended.interrupted else 0

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON: run_id, name, path, sheet, mirror, the fields of `RunEnded`, `Progress` under "progress"."""
        places = {"path": str(self.path), "sheet": self.sheet and str(self.sheet)}
        about = {"run_id": self.run_id, "name": self.name, **places, "mirror": self.mirror and asdict(self.mirror)}
        return about | asdict(self.ended)


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
        out: directory of the catalogue; it must not exist, be empty, or be what a submit left that was killed before
            its run had begun.
        address: Ray cluster to work on; overrides the configuration.
        executor: "ray" or "serial"; overrides the configuration.
        into: add the run to an existing catalogue instead.
        callbacks: hear the events of the run.

    Raises:
        InputError: the directory holds something else, the disk is too small, nothing answers at the address.
        FarmError: the work failed.
    """
    config = working_with(config, address, executor)
    _check_target(out, config, into)
    check_disk(config, out)
    check_mirror(config, out, new=True)
    with workforce(config) as workers:
        description = {"config": config.to_dict(), "versions": versions()}
        begin_run(out, config.run_id, description, config.catalogue.durability, into=into)
        return _session(config, out, workers, callbacks)


def resume(
    path: Path,
    *,
    run: str | None = None,
    overrides: Sequence[str] = (),
    address: str | None = None,
    executor: str | None = None,
    callbacks: Sequence[Callback] = (),
) -> RunSummary:
    """Go on with a run from its last committed epoch, or extend a finished one.

    What is changed here is remembered: the next session of the run works with it.

    Args:
        path: the catalogue.
        run: id of the run, or its first digits; the latest begun if None.
        overrides: `section.field=value`; what decides the designs cannot be changed.
        address: Ray cluster to work on; overrides the configuration.
        executor: "ray" or "serial"; overrides the configuration.
        callbacks: hear the events of the run.

    Raises:
        InputError: not a catalogue, no such run in it, another process works on it, or a forbidden override.
        FarmError: the work failed.
    """
    run_id = chosen_run(path, run)
    stored = read_settings(path, run_id)
    check_version(path, run_id, stored)
    config = RunConfig.from_dict(stored, f"{path}: run.json", overrides)
    if config.run_id != run_id:
        raise InputError(
            f"--set {' '.join(overrides)}: the evolution section decides the designs of run {run_id} and cannot "
            "change; submit a new run instead"
        )
    if config.catalogue.keep != stored["catalogue"]["keep"]:
        raise InputError(f"--set catalogue.keep={config.catalogue.keep}: it is fixed when the run begins")
    config = working_with(config, address, executor)
    check_disk(config, path, Catalogue.open(path).usage().bytes)
    check_mirror(config, path, new=False)
    with run_lock(path, run_id):
        pass  # a run that is at work is refused before anything is started for it
    with workforce(config) as workers:
        return _session(config, path, workers, callbacks)


def working_with(config: RunConfig, address: str | None, executor: str | None) -> RunConfig:
    """The configuration with other workers: an address alone means Ray, the serial executor alone no address.

    Raises:
        InputError: an address for the serial executor.
    """
    if address is None and executor is None:
        return config
    if address is not None and executor == "serial":
        raise InputError(f"--address {address}: the serial executor works in this process; leave one of them out")
    changes: dict[str, Any] = {"executor": executor or "ray"}
    if executor == "serial":
        changes |= {"address": None, "metrics": None}
    elif address is not None:
        changes["address"] = address
    execution = config.execution.model_copy(update=changes)
    return config.model_copy(update={"execution": execution})


def _session(config: RunConfig, root: Path, workers: Workforce, callbacks: Sequence[Callback]) -> RunSummary:
    """Work on a run under its lock, from where it stands to an end, with new workers when all are lost."""
    run_id = config.run_id
    with run_lock(root, run_id), contextlib.ExitStack() as stack:
        withdraw_stop(root, run_id)
        record_settings(root, run_id, config.to_dict(), config.catalogue.durability)
        log = EventLog(root, run_id)
        stack.callback(log.close)
        hearers = [log, *workers.callbacks, *callbacks]
        mirror = stack.enter_context(mirroring(config, root, Announcer(hearers)))
        announce = Announcer([*hearers, *filter(None, [mirror])])
        interrupted = stack.enter_context(interrupts())
        losses, epochs = 0, -1
        while True:
            try:
                summary = _stretch(config, root, workers, announce, interrupted)
                return replace(summary, mirror=mirror.finish() if mirror else None)
            except ClusterLostError as lost:
                where = f"go on from the last commit with `farm resume {root}`"
                so_far = last_epoch(root, run_id)
                losses = losses + 1 if so_far == epochs else 1
                epochs = so_far
                if losses == _LOSSES_WITHOUT_COMMIT or interrupted() is not None:
                    raise FarmError(f"{lost}; {where}") from None
                announce(Fault("workers", str(lost), "they are started anew, and go on from the last commit"))
                try:
                    replaced = workers.replace()
                except FarmError as error:
                    raise FarmError(f"{error}; {where}") from None
                if not replaced:
                    raise FarmError(f"{lost}; {where}, on another cluster if need be (--address)") from None


def _stretch(
    config: RunConfig,
    root: Path,
    workers: Workforce,
    announce: Announcer,
    interrupted: Callable[[], str | None],
) -> RunSummary:
    """Work on a run with one set of workers."""
    run_id = config.run_id

    def why_end() -> str | None:
        return interrupted() or ("stopped by `farm stop`" if stop_requested(root, run_id) else None)

    with contextlib.ExitStack() as stack:
        executor = workers.new_executor(root)
        stack.callback(executor.close)
        remove_orphans(root, run_id)
        schedule, progress, elapsed_s = restore(config, root)
        usage = Catalogue.open(root).usage()
        queue = mesh_queue(config, root)
        need = disk_need(config, executor.workers)
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
                need.first_hour,
                need.whole,
            )
        )
        run = Run(
            config,
            root,
            executor,
            schedule,
            progress,
            known_shapes(config, root, schedule.complete),
            queue,
            announce,
            why_end,
            (usage.files, usage.bytes),
            elapsed_s,
        )
        reason = run.evolve()
        run.mesh_the_rest()
    _tidy(config, root)
    ended = RunEnded(
        reason,
        interrupted() is not None,
        run.progress,
        run.elapsed_s,
        Catalogue.open(root).digest(run_id),
        run.meshes,
        run.mesh_failures,
    )
    sheet = None
    try:
        # The record of the end vouches for the picture; the report tells of the end.
        sheet = write_sheet(root, config)
        record_end(root, run_id, asdict(ended), config.catalogue.durability)
        write_report(root, config)
    except StorageFullError as error:
        announce(
            Fault("disk", str(error), "all designs are safe; `farm resume` makes picture and report when there is room")
        )
    announce(ended)
    return RunSummary(run_id, config.name, root, ended, sheet)


def _tidy(config: RunConfig, root: Path) -> None:
    """Merge small parts if there are many; without room on the disk they stay as they are."""
    if len(list_parts(root, config.run_id)) > _PARTS:
        with contextlib.suppress(StorageFullError):
            compact(root, config.run_id, config.catalogue.durability)


def _check_target(out: Path, config: RunConfig, into: bool) -> None:
    """Refuse before anything is started or written."""
    if into and out.exists() and not (out.is_dir() and is_unbegun(out)):
        Catalogue.open(out)
        if config.run_id in run_ids(out):
            raise InputError(f"{out}: run {config.run_id} is in this catalogue already; `farm resume {out}`")
        return
    check_place(out)
    if out.exists() and not is_unbegun(out):
        raise InputError(f"{out}: {what_is_there(out)}")
