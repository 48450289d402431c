"""`farm paper`: the paper's experiments and figures, made again."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from fractal_farm.cli.output import AsJson, duration, print_json, print_table, say

_NAMES = "fig4, fig5, table1, fig7, fig8 (and 9), fig10, sensitivity, or all"
_INTERVAL_S = 10.0


def paper(
    figure: Annotated[str, typer.Argument(metavar="FIGURE", help=f"One of {_NAMES}.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Directory of the results; goes on in it.")],
    experiments: Annotated[int, typer.Option(min=2, max=1000, help="Of each case.")] = 10,
    seed: Annotated[int, typer.Option(min=0, help="Of all random numbers.")] = 2009,
    workers: Annotated[
        int | None, typer.Option(min=1, max=1024, help="Processes; default: the cores.", show_default=False)
    ] = None,
    scene: Annotated[Path, typer.Option(help="Scene of fig 7.")] = Path("configs/christmas_tree.yaml"),
    as_json: AsJson = False,
) -> None:
    """Make the figures of Pang and Hui (2009) again, and compare.

    Writes a report with plots, pictures and every difference in words. The same command goes on after an interruption.
    """
    from fractal_farm.experiments.paper import FIGURES, Scale, remake
    from fractal_farm.experiments.paper.page import side_by_side

    began, last = time.monotonic(), float("-inf")

    def tell(done: int, of: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= _INTERVAL_S or done == of:
            last = now
            say(f"{done} of {of} parts, {duration(now - began)}")

    wanted = FIGURES if figure == "all" else (figure,)
    results = remake(out, wanted, Scale(experiments, seed=seed), workers=workers, scene=scene, tell=tell)
    if as_json:
        print_json(results)
    else:
        print_table(["quantity", "paper", "here"], side_by_side(results))
    say(f"the report: {out / 'report.html'}")
