"""All of it, or some figures: what is not there yet is run in processes side by side, then the report is written.

DIR/experiment.json     what it is, and with which sources and how much
DIR/runs/               see `trial`
DIR/<figure>/           pictures, solids and facts.json of a figure
DIR/results.json        all that was found
DIR/report.html         the page
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fractal_farm import __version__
from fractal_farm.bench.stopwatch import this_machine
from fractal_farm.catalogue.documents import read_document
from fractal_farm.catalogue.durable import put
from fractal_farm.config import RunConfig
from fractal_farm.errors import InputError
from fractal_farm.experiments.methods.comparison import sources
from fractal_farm.experiments.paper import findings
from fractal_farm.experiments.paper.cases import CASES, OURS, READINGS, Reading, Scale
from fractal_farm.experiments.paper.shapes import SCENE, shape_figure
from fractal_farm.experiments.paper.trial import figures, run_trial
from fractal_farm.experiments.side_by_side import claim, in_processes

FIGURES = ("fig4", "fig5", "table1", "fig7", "fig8", "fig10", "sensitivity")
_SHAPES = ("table1", "fig7", "fig8", "fig10")
Tell = Callable[[int, int], None]


def remake(
    root: Path,
    wanted: Sequence[str] = FIGURES,
    scale: Scale | None = None,
    *,
    workers: int | None = None,
    scene: Path = SCENE,
    readings: Sequence[Reading] = READINGS,
    tell: Tell | None = None,
) -> dict[str, Any]:
    """Make what is missing of some figures, and the report of all that are there.

    Args:
        root: a new directory, or one that this function made; it goes on in it.
        wanted: of `FIGURES`.
        scale: how much is run; the paper's numbers if None.
        workers: processes; None for the cores of this machine, 1 for this process alone.
        scene: file of the scene for fig 7.
        readings: what sensitivity compares, the default reading among them.
        tell: hears every second or so how many parts are done, and of how many.

    Returns:
        What results.json holds.

    Raises:
        InputError: no such figure; or the directory holds something else, other sources or another scale.
        FarmError: the work failed; the same call goes on.
    """
    if unknown := [name for name in wanted if name not in FIGURES]:
        raise InputError(f"figure is {unknown[0]!r}; choose from {', '.join(FIGURES)}, all")
    scale = scale or Scale()
    claim(root, {"experiment": "paper", "version": __version__, "sources": _sources(), "scale": asdict(scale)})
    runs: dict[str, RunConfig] = {}
    for reading in readings if "sensitivity" in wanted else [OURS]:
        for case in (
            CASES if {"sensitivity", "fig5"} & set(wanted) else ["case3"] if {"fig4", "fig8"} & set(wanted) else []
        ):
            config = reading.config(case, scale)
            runs.setdefault(config.run_id, config)
    shapes = [name for name in _SHAPES if name in wanted]

    def look() -> None:
        done = [figures(root, config) is not None for config in runs.values()]
        done += [(root / name / "facts.json").exists() for name in shapes]
        if tell is not None:
            tell(sum(done), len(done))

    processes = workers or len(os.sched_getaffinity(0))
    look()
    in_processes(run_trial, [(root, config) for config in runs.values()], processes, look)
    in_processes(shape_figure, [(root, name, scale, scene) for name in shapes], processes, look)
    return _reported(root, scale, readings)


def _reported(root: Path, scale: Scale, readings: Sequence[Reading]) -> dict[str, Any]:
    """Everything that is there, of this and earlier calls, as results.json and report.html."""
    from fractal_farm.experiments.paper.page import write_page

    results: dict[str, Any] = {"scale": asdict(scale), "made_with": {"sources": _sources(), **asdict(this_machine())}}
    ran = {
        reading.name: {
            case: found for case in CASES if (found := figures(root, reading.config(case, scale))) is not None
        }
        for reading in readings
    }
    ours = ran[OURS.name]
    if "case3" in ours:
        results["fig4"] = findings.fig4(ours["case3"])
    if len(ours) == len(CASES):
        results["fig5"] = findings.fig5(ours)
    whole = [reading for reading in readings if len(ran[reading.name]) == len(CASES)]
    if len(whole) > 1:
        rows = [findings.compared(reading, ran[reading.name], scale) for reading in whole]
        best = findings.best_fit(rows)["name"]
        results["sensitivity"] = {"rows": rows, "best": best, "best_fig4": findings.fig4(ran[best]["case3"])}
    for name in _SHAPES:
        if (path := root / name / "facts.json").exists():
            results[name] = read_document(path)
    put(root / "results.json", json.dumps(results, indent=2).encode() + b"\n")
    write_page(root, results)
    return results


def _sources() -> str:
    """16 hex digits: a hash of all that decides what is found here."""
    digest = hashlib.blake2b(sources().encode(), digest_size=8)
    for name in ("cases.py", "trial.py", "shapes.py"):
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.hexdigest()
