"""`farm submit` and `farm resume`: runs."""

from __future__ import annotations

import contextlib
import enum
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument
from fractal_farm.cli.output import AsJson, duration, print_facts, print_json, results_only_on_stdout, say
from fractal_farm.errors import InputError
from fractal_farm.farm.interrupts import listening

if TYPE_CHECKING:
    from fractal_farm.farm import RunSummary


class ExecutorName(enum.StrEnum):
    """Who works."""

    RAY = "ray"
    SERIAL = "serial"


AddressOption = Annotated[
    str | None,
    typer.Option(help="Running Ray cluster, host:port or auto; default: this machine.", show_default=False),
]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="SECTION.FIELD=VALUE", help="Override; may be repeated.")
]
DetachOption = Annotated[
    bool,
    typer.Option(
        "--detach", help="Hand the run to the cluster at --address http://HOST:8265, and return; see farm jobs."
    ),
]
ExecutorOption = Annotated[
    ExecutorName | None, typer.Option(help="ray, or serial: in this process alone.", show_default=False)
]

RunOption = Annotated[
    str | None,
    typer.Option("--run", metavar="ID", help="Run of a catalogue that holds several.", show_default=False),
]


@listening()
def submit(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="YAML file of the run.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="New directory for the catalogue; default: runs/NAME.",
            show_default=False,
        ),
    ] = None,
    address: AddressOption = None,
    executor: ExecutorOption = None,
    overrides: SetOption = None,
    into: Annotated[bool, typer.Option("--into", help="Add the run to an existing catalogue.")] = False,
    detach: DetachOption = False,
    as_json: AsJson = False,
) -> int:
    """Run a configuration to its end.

    Designs are evolved, kept and meshed. Ctrl-C ends the run cleanly; farm resume goes on.
    """
    from fractal_farm import farm
    from fractal_farm.cli.progress import progress_display
    from fractal_farm.config import RunConfig

    run = RunConfig.from_yaml(config, overrides or ())
    if detach:
        from fractal_farm.farm.on_ray import jobs

        _only_on_a_cluster(executor)
        return _detached(jobs.detach(run, str(out or Path("runs") / run.name), address, into), address, as_json)
    directory = out if out is not None else Path("runs") / run.name
    with saying_how_to_resume(directory), results_only_on_stdout(), progress_display() as display:
        summary = farm.submit(run, directory, address=address, executor=_name(executor), into=into, callbacks=[display])
    return report_end(summary, as_json)


@listening()
def resume(
    directory: DirectoryArgument,
    run: RunOption = None,
    address: AddressOption = None,
    executor: ExecutorOption = None,
    overrides: SetOption = None,
    detach: DetachOption = False,
    as_json: AsJson = False,
) -> int:
    """Go on with an interrupted run, or extend one.

    More of the same run: --set stop.epochs=40. What is set here is remembered by the next farm resume.
    """
    from fractal_farm import farm
    from fractal_farm.cli.progress import progress_display

    if detach:
        from fractal_farm.farm.on_ray import jobs

        _only_on_a_cluster(executor)
        return _detached(jobs.detach_resume(str(directory), run, overrides or (), address), address, as_json)
    with saying_how_to_resume(directory), results_only_on_stdout(), progress_display() as display:
        summary = farm.resume(
            directory,
            run=run,
            overrides=overrides or (),
            address=address,
            executor=_name(executor),
            callbacks=[display],
        )
    return report_end(summary, as_json)


def stop(directory: DirectoryArgument, run: RunOption = None) -> None:
    """End a live run at the last epoch that all islands have completed, and wait until it has.

    It may run in another terminal, or on another machine that sees the directory. farm resume goes on.
    """
    from fractal_farm import farm

    epochs = farm.stop(directory, run=run, said=lambda: say("asked to end; waiting for the last commit"))
    say(f"ended after {epochs:,} epochs; go on with: farm resume {directory}")


def _only_on_a_cluster(executor: ExecutorName | None) -> None:
    if executor is ExecutorName.SERIAL:
        raise InputError("--executor serial: a run that is handed to a cluster works there; leave --detach out")


def _detached(job: str, address: str | None, as_json: bool) -> int:
    if as_json:
        print_json({"job": job, "address": address})
        return 0
    typer.echo(job)
    say(f"follow it with: farm jobs logs {job} --follow" + (f" --address {address}" if address else ""))
    return 0


def _name(executor: ExecutorName | None) -> str | None:
    return executor.value if executor else None


@contextlib.contextmanager
def saying_how_to_resume(directory: Path) -> Iterator[None]:
    """A second Ctrl-C ends the process at once; what was committed stays."""
    try:
        yield
    except KeyboardInterrupt:
        begun = any(directory.glob("runs/*/run.json"))
        say(f"interrupted; go on from the last commit with: farm resume {directory}" if begun else "interrupted")
        raise


def report_end(summary: RunSummary, as_json: bool) -> int:
    """Print how a session ended; the exit code."""
    ended = summary.ended
    say(f"go on with: farm resume {summary.path}" if ended.interrupted else f"the best: farm list {summary.path}")
    if as_json:
        print_json(summary.as_dict())
        return summary.exit_code
    progress = ended.progress
    failed = f", {ended.mesh_failures} failed" if ended.mesh_failures else ""
    print_facts(
        {
            "run": f"{summary.name} ({summary.run_id}): {ended.reason}",
            "designs": f"{progress.designs:,} in the catalogue, {progress.kept_qualified:,} of them qualified",
            "distinct": f"{progress.distinct:,} shapes that differ by more than chance",
            "evaluated": f"{progress.evaluated:,} in {progress.epochs:,} epochs and {duration(ended.elapsed_s)}",
            "best fitness": f"{progress.best_fitness:.4f}",
            "meshes": f"{ended.meshes} made now{failed}" + (f", in {summary.path / 'solids'}" if ended.meshes else ""),
            "picture": summary.sheet,
            "report": summary.path / "report.html",
            "mirror": _mirror(summary),
            "digest": ended.digest,
        }
    )
    return summary.exit_code


def _mirror(summary: RunSummary) -> str | None:
    """Where the mirror is and what it lacks."""
    mirror = summary.mirror
    if mirror is None:
        return None
    if mirror.cause is None:
        return f"{mirror.url}, complete"
    return (
        f"{mirror.url} is {mirror.files:,} {'file' if mirror.files == 1 else 'files'} behind ({mirror.cause}); "
        f"bring it up to date with: farm mirror {summary.path} {mirror.url}"
    )
