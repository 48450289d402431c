"""`farm status`: how a run stands, once or until it ends; and `farm report`: its course as one HTML file.

Both read files only, so they work from any terminal that sees the catalogue.
"""

from __future__ import annotations

import json
import time
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument
from fractal_farm.cli.output import AsJson, byte_count, duration, plain, print_facts, print_json, say
from fractal_farm.cli.run_commands import RunOption
from fractal_farm.errors import FarmError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from fractal_farm.farm.run_status import RunMonitor

_FAILURES_SHOWN = 5
_ISLANDS_SHOWN = 16
_STEERING_SHOWN = 5
_SILENT_S = 120.0


def status(
    directory: DirectoryArgument,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Look again and again until the run ends.")] = False,
    run: RunOption = None,
    interval: Annotated[float, typer.Option(min=0.2, max=3600, help="Seconds between two looks.")] = 5.0,
    as_json: AsJson = False,
) -> int:
    """How a run stands: live, ended, interrupted or damaged.

    Reads files only. With --watch a terminal is redrawn, anything else gets a line at each look. The exit code is 1
    if something could not be read.
    """
    from fractal_farm.farm.run_status import RunMonitor

    monitor = RunMonitor(directory, run)
    if watch:
        _watch(monitor, interval, as_json)
        if as_json:
            return 0
    facts = monitor.look(digest=True)
    if as_json:
        print_json(facts)
    else:
        print_facts(_facts(facts))
    for line in facts["damage"]:
        say(f"damaged: {line}")
    if facts["damage"]:
        raise FarmError(f"{directory}: {len(facts['damage'])} files cannot be read")
    return 0


def report(
    directory: DirectoryArgument,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File to write; default: report.html in DIR.", show_default=False),
    ] = None,
    run: RunOption = None,
) -> None:
    """Write the course of a run as one HTML file: curves, faults, configuration, the best designs."""
    from fractal_farm.catalogue.documents import sealed_page
    from fractal_farm.cli.output import write_file
    from fractal_farm.farm.report import report_page

    path = output if output is not None else directory / "report.html"
    write_file(path, sealed_page(report_page(directory, run)))
    typer.echo(path)


def _watch(monitor: RunMonitor, interval_s: float, as_json: bool) -> None:
    """Show the run until it is no longer at work."""
    from rich.console import Console

    console = Console(highlight=False, markup=False)
    if as_json or not console.is_terminal:
        while True:
            facts = monitor.look(digest=False)
            typer.echo(json.dumps(plain(facts), allow_nan=False) if as_json else status_line(facts))
            if facts["state"] != "running":
                return
            time.sleep(interval_s)
    from rich.live import Live

    facts = monitor.look(digest=False)
    with Live(_page(facts), console=console, auto_refresh=False, transient=True) as live:
        while facts["state"] == "running":
            time.sleep(interval_s)
            facts = monitor.look(digest=False)
            live.update(_page(facts), refresh=True)


def status_line(facts: dict[str, Any]) -> str:
    """The state of a run in one line.

    Args:
        facts: what `RunMonitor.look` returns.
    """
    rate = facts["rate_now"] if facts["rate_now"] is not None else facts["rate"]
    parts = [
        facts["state"],
        f"epoch {facts['complete_epochs']}",
        f"{facts['evaluated']:,} evaluated ({rate:,.0f}/s)",
        f"{facts['designs']:,} designs",
        f"{facts['distinct']:,} distinct",
        f"best {facts['best_fitness']:.3f}",
        f"{facts['meshes']:,} meshes",
        f"{byte_count(facts['bytes'])}, {byte_count(facts['free_bytes'])} free",
        duration(facts["elapsed_s"]),
    ]
    if faults := sum(failure["count"] for failure in facts["failures"]):
        parts.append(f"{faults} {'fault' if faults == 1 else 'faults'}")
    if facts["waits"]:
        parts.append(f"waiting: {facts['waits']}")
    if facts["mirror"] and facts["mirror"]["files"]:
        parts.append(f"mirror {_behind(facts['mirror'])}")
    if facts["damage"]:
        parts.append(f"{len(facts['damage'])} damaged")
    if (left := _left(facts)) is not None:
        parts.append(left)
    return ", ".join(parts)


def _facts(facts: dict[str, Any]) -> dict[str, Any]:
    """A run's state as a person reads it."""
    reason = f", {facts['reason']}" if facts["reason"] not in (None, facts["state"]) else ""
    silent = facts["silent_s"] or 0.0
    silence = f", silent for {duration(silent)}" if silent > _SILENT_S else ""
    plural = "worker" if facts["workers"] == 1 else "workers"
    workers = f" on {facts['workers']} {plural}" if facts["state"] == "running" and facts["workers"] else ""
    counts = ", ".join(f"{number:,} of {maps} maps" for maps, number in sorted(facts["n_maps"].items()))
    failed = f", {facts['mesh_failures']} failed" if facts["mesh_failures"] else ""
    now = "" if facts["rate_now"] is None else f", now {facts['rate_now']:,.0f}/s"
    ahead = facts["complete_epochs"] - facts["epochs"]
    waiting = f", {ahead:,} more wait to be committed" if ahead > 0 and facts["state"] == "running" else ""
    return {
        "run": f"{facts['name'] or 'unknown'} ({facts['run_id']}): {facts['state']}{reason}{workers}{silence}",
        "waiting": facts["waits"],
        "designs": f"{facts['designs']:,}" + (f": {counts}" if counts else ""),
        "qualified": f"{facts['kept_qualified']:,} kept, of {facts['qualified']:,} found",
        "distinct": f"{facts['distinct']:,} shapes that differ by more than chance",
        "printable": f"{facts['printable']:,} in one piece at the run's wall",
        "evaluated": f"{facts['evaluated']:,} in {facts['epochs']:,} epochs and {duration(facts['elapsed_s'])} "
        f"({facts['rate']:,.0f}/s{now}){waiting}",
        "refused": f"{facts['refused']:,} genomes got no score" if facts["refused"] else None,
        "best fitness": f"{facts['best_fitness']:.4f}",
        "meshes": f"{facts['meshes']:,}{failed}",
        "islands": _many(map(_island, facts["islands"]), _ISLANDS_SHOWN),
        "migration": _migration(facts),
        "steering": _many(map(_steering, facts["steering"]), _STEERING_SHOWN),
        "failures": _many(map(_failure, facts["failures"]), _FAILURES_SHOWN) or "none",
        "disk": f"{byte_count(facts['bytes'])} in {facts['files']:,} files"
        + (f" of {byte_count(facts['whole_bytes'])} at most" if facts["whole_bytes"] else "")
        + f", {byte_count(facts['free_bytes'])} free"
        + ("" if facts["min_free_bytes"] is None else f"; the run waits below {byte_count(facts['min_free_bytes'])}"),
        "forecast": _forecast(facts["forecast"]),
        "mirror": f"{facts['mirror']['url']}: {_behind(facts['mirror'])}" if facts["mirror"] else None,
        "ends after": _limits(facts["stop"]),
        "time left": _left(facts),
        "digest": facts["digest"],
    }


def _page(facts: dict[str, Any]) -> RenderableType:
    """The same facts as a page for a terminal that is redrawn."""
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True, style="dim")
    grid.add_column(overflow="fold")
    for name, value in _facts(facts).items():
        if value is not None:
            grid.add_row(name, Text(value))
    for line in facts["damage"]:
        grid.add_row("damaged", Text(line, style="red"))
    page = Table.grid(expand=True)
    if (fraction := _fraction(facts)) is not None:
        page.add_row(ProgressBar(total=1.0, completed=fraction))
    page.add_row(grid)
    return page


def _fraction(facts: dict[str, Any]) -> float | None:
    """How much of the way to the limit that comes first is done."""
    if facts["left_s"] is None:
        return None
    whole = facts["elapsed_s"] + facts["left_s"]
    return facts["elapsed_s"] / whole if whole > 0 else 1.0


def _left(facts: dict[str, Any]) -> str | None:
    if facts["left_s"] is None:
        return None
    if facts["left_s"] <= 0:
        return f"{facts['left_until']} reached, finishing"
    return f"{duration(facts['left_s'])} left until {facts['left_until']}"


def _behind(mirror: dict[str, Any]) -> str:
    """How far a mirror is behind."""
    why = f": {mirror['cause']}" if mirror["cause"] else ""
    if not mirror["files"]:
        return mirror["cause"] or "up to date"
    size = byte_count(mirror["bytes"])
    return f"{mirror['files']:,} {'file' if mirror['files'] == 1 else 'files'} behind ({size}){why}"


def _limits(stop: dict[str, Any]) -> str:
    """The limits in force; whichever comes first ends the run."""
    found = [f"{limit:,g} {name}" for name, limit in stop.items() if limit is not None]
    return " or ".join(found) or "nothing but an interruption"


def _island(island: dict[str, Any]) -> str:
    return (
        f"{island['island']}: epoch {island['epoch']}, best {island['best']:.3f}, "
        f"mean of accepted {island['mean_accepted']:.3f}"
    )


def _migration(facts: dict[str, Any]) -> str | None:
    receivers = [island for island in facts["islands"] if island["received"]]
    if not receivers:
        return None
    first, last = facts["migration_epochs"]
    lines = []
    for island in receivers:
        given = " + ".join(f"{number} from {source}" for source, number in island["received"].items())
        lines.append(f"to {island['island']}: {given}, {island['settled']} settled")
    return f"epochs {first} to {last}\n" + str(_many(iter(lines), _ISLANDS_SHOWN))


def _steering(request: dict[str, Any]) -> str:
    chosen = ", ".join(identity[:8] for identity in request["design_ids"])
    return f"epochs {request['first']} to {request['last']} breed from {chosen}, too"


def _failure(failure: dict[str, Any]) -> str:
    when = datetime.fromtimestamp(failure["last"]).strftime("%H:%M:%S")
    times = f"{failure['count']} x " if failure["count"] > 1 else ""
    return f"{times}{failure['where']}: {failure['cause']}; {failure['remedy']} (last at {when})"


def _many(items: Any, shown: int) -> str | None:
    """A line each, the first so many of them; None if there are none."""
    lines = list(items)
    if len(lines) > shown:
        lines = [*lines[:shown], f"and {len(lines) - shown} more; --json shows all"]
    return "\n".join(lines) or None


def _forecast(forecast: dict[str, float] | None) -> str | None:
    """What ten hours at the present rate would take, once the rate has settled."""
    if forecast is None:
        return None
    return (
        f"after {forecast['hours']:g} hours {forecast['gigabytes']:.1f} GB in {forecast['files']:,.0f} files, "
        f"{forecast['rows']:,.0f} designs"
    )
