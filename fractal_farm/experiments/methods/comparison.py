"""All methods with all seeds, several at a time in processes of their own, and the report of what they found.

    DIR/experiment.json        what is compared, and with which sources
    DIR/runs/                  one directory a method and seed, see `trial`
    DIR/sheets/<method>.jpg    designs that nobody picked
    DIR/results.json           all figures
    DIR/report.html            the page

The same call goes on where an interrupted one stopped, with more seeds, methods or evaluations too.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fractal_farm import __version__
from fractal_farm.bench.stopwatch import this_machine
from fractal_farm.catalogue.documents import read_document
from fractal_farm.catalogue.durable import put
from fractal_farm.config import RunConfig
from fractal_farm.experiments.methods import verdict
from fractal_farm.experiments.methods.presets import Preset
from fractal_farm.experiments.methods.trial import evaluated_so_far, finished, run_trial
from fractal_farm.experiments.side_by_side import ABOUT, claim, in_processes

_PACKAGE = Path(__file__).resolve().parents[2]
_DECIDING = (
    "config.py",
    "random_streams.py",
    "distinctness.*",
    "ifs/*.py",
    "fitness/*.py",
    "evolution/*.py",
    "farm/work.py",
)
_HERE = ("course.py", "remeasured.py", "trial.py")


@dataclass(frozen=True)
class Standing:
    """How far an experiment is.

    Attributes:
        trials: methods and seeds that are finished.
        of_trials: all of them.
        evaluations: committed, of those that count.
        of_evaluations: all that count.
    """

    trials: int
    of_trials: int
    evaluations: int
    of_evaluations: int


Tell = Callable[[Standing], None]


def compare(
    root: Path,
    presets: Sequence[Preset],
    seeds: int,
    evaluations: int,
    workers: int | None = None,
    tell: Tell | None = None,
) -> dict[str, Any]:
    """Run what is not there yet, and write the report.

    Args:
        root: directory of the experiment; a new one, or one that this function made.
        presets: what to compare.
        seeds: each method runs with the seeds 1 to this.
        evaluations: of each run.
        workers: processes; None for the cores of this machine, 1 for this process alone.
        tell: hears every second or so how far it is.

    Returns:
        What results.json holds: `methods`, `ratios`, `aims`, `in_seconds`, and what it was made with.

    Raises:
        InputError: the directory holds something else, or an experiment with other sources, or somebody works on it.
        FarmError: the work failed; the same call goes on.
    """
    from fractal_farm.experiments.methods.page import write_page

    claim(root, {"experiment": "methods", "version": __version__, "sources": sources()})
    trials = [(preset, preset.config(seed)) for seed in range(1, seeds + 1) for preset in presets]
    _run_all(root, [config for _, config in trials], evaluations, workers or len(os.sched_getaffinity(0)), tell)
    results: dict[str, list[dict[str, Any]]] = {preset.name: [] for preset in presets}
    for preset, config in trials:
        result = finished(root, config, evaluations)
        assert result is not None
        results[preset.name].append(result)
    summaries = {name: verdict.summary(found) for name, found in results.items()}
    report = {
        "evaluations": evaluations,
        "seeds": seeds,
        "methods": {
            preset.name: {
                "about": preset.about,
                "config": preset.config(1).evolution.model_dump(mode="json", exclude={"seed"}),
                "milestones": summaries[preset.name],
            }
            for preset in presets
        },
        "ratios": verdict.ratios(summaries),
        "strongest_plain": verdict.strongest_plain(summaries),
        "aims": verdict.held_against(verdict.AIMS, summaries),
        "in_seconds": verdict.in_seconds(summaries),
        "made_with": {**read_document(root / ABOUT), **asdict(this_machine())},
    }
    put(root / "results.json", json.dumps(report, indent=2, allow_nan=False).encode() + b"\n")
    write_page(root, report, {name: [row for one in found for row in one["sample"]] for name, found in results.items()})
    return report


def standing(root: Path, configs: Sequence[RunConfig], evaluations: int) -> Standing:
    """How far it is, by the names of files alone."""
    done = [finished(root, config, evaluations) is not None for config in configs]
    counted = [
        evaluations if is_done else min(evaluations, evaluated_so_far(root, config))
        for config, is_done in zip(configs, done, strict=True)
    ]
    return Standing(sum(done), len(configs), sum(counted), evaluations * len(configs))


def sources() -> str:
    """16 hex digits: a hash of all that decides what a run finds, and what is counted of it."""
    digest = hashlib.blake2b(digest_size=8)
    files = [path for pattern in _DECIDING for path in sorted(_PACKAGE.glob(pattern))]
    for path in [*files, *(Path(__file__).with_name(name) for name in _HERE)]:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def _run_all(root: Path, configs: Sequence[RunConfig], evaluations: int, workers: int, tell: Tell | None) -> None:
    def look() -> None:
        if tell is not None:
            tell(standing(root, configs, evaluations))

    waiting = [config for config in configs if finished(root, config, evaluations) is None]
    look()
    in_processes(run_trial, [(root, config, evaluations) for config in waiting], workers, look)
