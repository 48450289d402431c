"""`farm experiment`: questions that take many runs, each answered by one command with a report."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fractal_farm.cli.output import AsJson, duration, print_json, print_table, say

if TYPE_CHECKING:
    from fractal_farm.experiments.methods.comparison import Standing, Tell

app = typer.Typer(help="Experiments of many runs, each with a report: methods.", no_args_is_help=True)

_PRESETS = "niches, niches-one, paper, best, best-plain, random, random-plain"
_FIRST_INTERVAL_S, _LAST_INTERVAL_S = 5.0, 60.0


@app.callback()
def _experiments() -> None:
    """Experiments of many runs, each with a report."""


@app.command()
def methods(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Directory of the experiment; goes on in it.")
    ],
    seeds: Annotated[int, typer.Option(min=1, max=1000, help="Runs of each method.")] = 5,
    evaluations: Annotated[int, typer.Option(min=100, max=1_000_000_000, help="Of each run.")] = 20_000,
    names: Annotated[
        str,
        typer.Option(
            "--methods",
            metavar="NAME,...",
            help=f"Of {_PRESETS}.",
        ),
    ] = "niches,paper,best,random",
    workers: Annotated[
        int | None, typer.Option(min=1, max=1024, help="Processes; default: the cores.", show_default=False)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare ways to search at equal evaluations.

    Counted are designs that differ, print in one piece and are crisp, all of it measured again after the run. The same
    command goes on after an interruption, and extends: more seeds, evaluations or methods.
    """
    from fractal_farm.experiments.methods import chosen_presets, compare

    with _progress() as tell:
        report = compare(out, chosen_presets(names), seeds, evaluations, workers, tell)
    if as_json:
        print_json(report)
        return
    _print(report)
    for text in [*(aim["text"] for aim in report["aims"]), report["in_seconds"]]:
        if text is not None:
            typer.echo(text)
    say(f"the report: {out / 'report.html'}")


def _print(report: dict[str, Any]) -> None:
    plain = report["strongest_plain"]
    columns = ["method", "qualified", "distinct", "printable", "crisp", "sd", "N = 3", "x paper"]
    columns += [f"x {plain}"] if plain else []
    rows = []
    for name, method in report["methods"].items():
        last, ratios = method["milestones"][-1], report["ratios"][name]
        counts = [f"{last[key]['mean']:,.0f}" for key in ("qualified", "distinct", "printable", "crisp")]
        share = last["three_maps"]["mean"]
        times = [f"{found['mean']:.1f}" if (found := ratios.get(over)) else "-" for over in ("paper", "plain")]
        row = [name, *counts, f"{last['crisp']['sd']:,.0f}", "-" if share is None else f"{100 * share:.0f} %", *times]
        rows.append(row[: len(columns)])
    print_table(columns, rows)


@contextlib.contextmanager
def _progress() -> Iterator[Tell]:
    """Shows on stderr, in one line, how far it is: live on a terminal, now and then elsewhere."""
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    line = _Line()
    if not console.is_terminal:
        last = float("-inf")

        def tell(standing: Standing) -> None:
            nonlocal last
            interval = min(_LAST_INTERVAL_S, max(_FIRST_INTERVAL_S, line.elapsed_s() / 20))
            if time.monotonic() - last >= interval or standing.trials == standing.of_trials:
                last = time.monotonic()
                console.print(line.text(standing))

        yield tell
        return
    with Live(Text("starting"), console=console, refresh_per_second=4, transient=True) as live:
        yield lambda standing: live.update(Text(line.text(standing)))


class _Line:
    """The state of an experiment in one line, with the time that is left at the pace so far."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._first: int | None = None

    def elapsed_s(self) -> float:
        return time.monotonic() - self._began

    def text(self, standing: Standing) -> str:
        if self._first is None:
            self._first = standing.evaluations
        parts = [
            f"{standing.trials} of {standing.of_trials} runs",
            f"{standing.evaluations:,} of {standing.of_evaluations:,} evaluations",
            duration(self.elapsed_s()),
        ]
        done = standing.evaluations - self._first
        missing = standing.of_evaluations - standing.evaluations
        if done and missing:
            parts.append(f"{duration(self.elapsed_s() * missing / done)} left")
        return ", ".join(parts)
