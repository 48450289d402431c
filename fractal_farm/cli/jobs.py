"""`farm jobs`: runs that a Ray cluster keeps by itself, after `farm submit --detach` or `farm resume --detach`."""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime
from typing import Annotated

import typer

from fractal_farm.cli.output import AsJson, print_facts, print_json, print_table

app = typer.Typer(help="Runs that a Ray cluster keeps: list, status, logs, stop.", no_args_is_help=True)

DashboardOption = Annotated[
    str | None,
    typer.Option(
        "--address",
        envvar="RAY_API_SERVER_ADDRESS",
        help="The cluster's dashboard, http://HOST:8265; default: this machine's.",
        show_default=False,
    ),
]
JobArgument = Annotated[str, typer.Argument(metavar="JOB", help="Id of the job, as farm submit --detach printed it.")]


@app.command("list")
def list_jobs(address: DashboardOption = None, as_json: AsJson = False) -> None:
    """The farm's jobs that the cluster remembers, the latest first."""
    from fractal_farm.farm.on_ray.jobs import jobs

    found = jobs(address)
    if as_json:
        print_json([asdict(job) for job in found])
    else:
        rows = [[job.job, job.status, _moment(job.started), _moment(job.ended), job.catalogue] for job in found]
        print_table(["job", "status", "started", "ended", "catalogue on the head"], rows)


@app.command()
def status(identity: JobArgument, address: DashboardOption = None, as_json: AsJson = False) -> None:
    """Whether a job runs, and how it ended.

    How its run stands, farm status tells where the catalogue's directory can be seen.
    """
    from fractal_farm.farm.on_ray.jobs import job

    found = job(identity, address)
    if as_json:
        print_json(asdict(found))
        return
    print_facts(
        {
            "job": found.job,
            "status": found.status.lower(),
            "exit code": found.exit_code,
            "run": found.name,
            "catalogue": f"{found.catalogue} on the head",
            "started": _moment(found.started),
            "ended": _moment(found.ended),
            "message": found.message or None,
        }
    )


@app.command()
def logs(
    identity: JobArgument,
    address: DashboardOption = None,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on until the job ends.")] = False,
) -> None:
    """What a job has printed."""
    from fractal_farm.farm.on_ray.jobs import logs

    for text in logs(identity, address, follow):
        typer.echo(text, nl=False)


@app.command()
def stop(identity: JobArgument, address: DashboardOption = None) -> None:
    """End a job at its last complete epoch, and wait until it has ended."""
    from fractal_farm.farm.on_ray.jobs import stop

    found = stop(identity, address)
    print_facts({"job": found.job, "status": found.status.lower(), "go on with": f"farm resume {found.catalogue}"})


def _moment(at: float | None) -> str | None:
    return None if at is None else datetime.fromtimestamp(at).strftime("%Y-%m-%d %H:%M:%S")
