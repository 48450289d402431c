"""One method with one seed: run to so many evaluations, measured again as it goes, kept so that a kill loses little.

    runs/<run_id>/designs~<n>.npz            what the n-th stretch of whole epochs found, measured again
    runs/<run_id>/state~<n>~<evaluated>.npz  where the run stands after it; its appearance commits the stretch
    runs/<run_id>/result~<evaluations>.json  all figures, once the run is there

Figures depend neither on where a stretch ended nor on whether the run went on later. Memory holds one stretch, and in
the end some 300 bytes a design that qualifies.
"""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue import run_lock
from fractal_farm.catalogue.documents import encoded_document, read_document
from fractal_farm.catalogue.durable import put
from fractal_farm.catalogue.layout import run_directory
from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError
from fractal_farm.experiments.methods.course import Course, State, Totals
from fractal_farm.experiments.methods.remeasured import Counter, Measured, joined, measured_again

SAMPLE = 60  # designs of a sheet
_STRETCH, _STRETCHES = 5_000, 100  # evaluations of a stretch, at least; stretches of a run, about, at most
_FIRST_MILESTONE = 1_000
_STATE = re.compile(r"state~(\d{4})~(\d+)\.npz")


def milestones(evaluations: int) -> list[int]:
    """Evaluations after which figures are taken: 1,000, 2,000, 5,000, 10,000 and so on, and the last."""
    steps = (step * _FIRST_MILESTONE * 10**power for power in range(7) for step in (1, 2, 5))
    return [*(count for count in steps if count < evaluations), evaluations]


def evaluated_so_far(root: Path, config: RunConfig) -> int:
    """Evaluations of a run that are committed, by the names of its files alone."""
    states = _states(run_directory(root, config.run_id))
    return states[-1][1] if states else 0


def finished(root: Path, config: RunConfig, evaluations: int) -> dict[str, Any] | None:
    """The result of a trial, None while there is none; see `run_trial`.

    Raises:
        FarmError: it is damaged.
    """
    path = _result(root, config, evaluations)
    return read_document(path) if path.exists() else None


def run_trial(root: Path, config: RunConfig, evaluations: int) -> None:
    """Take a run on from where it stands, and commit its result.

    The result holds `epochs`; `milestones`, a list of figures (see `Counter.figures`) and totals (see `Totals`), the
    latter interpolated between epochs; and `sample`, distinct printable designs.

    Args:
        root: directory of the experiment.
        config: the run.
        evaluations: how many count.

    Raises:
        InputError: another process works on it.
        FarmError: the file system failed, or a file is damaged.
    """
    directory = run_directory(root, config.run_id)
    with run_lock(root, config.run_id):
        totals = _evolved(directory, config, evaluations)
        found = joined([Measured(**_read(path)) for path in sorted(directory.glob("designs~*.npz"))])
        counter = Counter(found, config.evolution.phenotype.phenotype())
        taken, printable = [], found
        for milestone in milestones(evaluations):
            counted, printable = counter.figures(milestone)
            taken.append({"evaluations": milestone, **counted, **_spent(milestone, totals)})
        result = {"epochs": len(totals) - 1, "milestones": taken, "sample": _sample(printable, counter.gaps)}
        put(_result(root, config, evaluations), encoded_document(result))


def _evolved(directory: Path, config: RunConfig, evaluations: int) -> npt.NDArray[np.float64]:
    """Run on to some whole epoch beyond `evaluations`; (epochs + 1, 4) `Totals` after each epoch."""
    states = _states(directory)
    state: State | None = _read(states[-1][2]) if states else None
    if state is not None and state["totals"][-1, 0] >= evaluations:
        return state["totals"]
    course = Course(config.evolution, state)
    number = states[-1][0] + 1 if states else 0
    while (done := int(course.totals[-1].evaluated)) < evaluations:
        goal = min(evaluations, done + max(_STRETCH, evaluations // _STRETCHES))
        found = []
        while course.totals[-1].evaluated < goal:
            found.append(measured_again(course.epoch(), config.evolution))
        older = _states(directory)
        put(directory / f"designs~{number:04d}.npz", _written(joined(found)._asdict()))
        now = int(course.totals[-1].evaluated)
        put(directory / f"state~{number:04d}~{now}.npz", _written(course.state()))
        for _, _, path in older:
            path.unlink()
        number += 1
    return np.array(course.totals)


def _spent(evaluations: int, totals: npt.NDArray[np.float64]) -> dict[str, float]:
    """The totals after so many evaluations, between those after the epochs before and behind."""
    evaluated, *costs = totals.T
    names = Totals._fields[1:]
    return {name: float(np.interp(evaluations, evaluated, cost)) for name, cost in zip(names, costs, strict=True)}


def _sample(designs: Measured, gaps: dict[int, float]) -> list[dict[str, Any]]:
    """Designs that nobody picked: those whose ids come first, since an id is a hash of the genome."""
    chosen = designs.rows(np.argsort(designs.design_id)[:SAMPLE])
    return [
        {
            "design_id": chosen.design_id[k].decode(),
            "genes": chosen.genes[k, : chosen.n_maps[k]].tolist(),
            "fitness": float(chosen.fitness[k]),
            "similarity_dimension": float(chosen.similarity_dimension[k]),
            "gap": gaps[int(chosen.number[k])],
        }
        for k in range(len(chosen.number))
    ]


def _result(root: Path, config: RunConfig, evaluations: int) -> Path:
    return run_directory(root, config.run_id) / f"result~{evaluations}.json"


def _states(directory: Path) -> list[tuple[int, int, Path]]:
    """(number of the stretch, evaluations by then, file), the latest last."""
    found = [(_STATE.fullmatch(path.name), path) for path in directory.glob("state~*.npz")]
    return sorted((int(match[1]), int(match[2]), path) for match, path in found if match)


def _written(arrays: State) -> bytes:
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    return content.getvalue()


def _read(path: Path) -> dict[str, npt.NDArray[Any]]:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return dict(arrays)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise FarmError(f"{path}: damaged ({error}); remove its directory, the run begins anew") from error
