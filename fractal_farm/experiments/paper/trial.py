"""One run on the farm, and the figures that are taken from what it has committed.

    DIR/runs/<run id>/        the catalogue: `farm list`, `farm report` and all others read it
    DIR/runs/<run id>.json    its figures; written last, so a run that has them is finished

A run that was cut off goes on from its last commit, as any run of the farm.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm import farm
from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.documents import encoded_document, read_document
from fractal_farm.catalogue.durable import put
from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError, InputError
from fractal_farm.evolution.operators import RHO_RANGE
from fractal_farm.farm.history import STATISTICS, RunHistory
from fractal_farm.fitness import FitnessFormula, evaluate
from fractal_farm.ifs.genome import RHO

_TIMED = 100
_DRAWN_WITHIN = 2.0  # random offsets, and all that table 1 prints
_TABLE1 = 4


def catalogue_of(root: Path, config: RunConfig) -> Path:
    """Where the catalogue of a run is."""
    return root / "runs" / config.run_id


def figures(root: Path, config: RunConfig) -> dict[str, Any] | None:
    """What `run_trial` has kept, or None if the run is not finished."""
    path = catalogue_of(root, config).with_suffix(".json")
    return dict(read_document(path)) if path.exists() else None


def run_trial(root: Path, config: RunConfig) -> None:
    """Run on the farm what is missing, and keep the figures.

    "mean", "accepted", "qualified" and "evaluated" are lists of a list for each experiment, of a number for each
    generation; "founders" has the same of generation 0. "seconds": of the whole run, storage and all; "evaluation_s":
    processor seconds of one evaluation.
    """
    if figures(root, config) is not None:
        return
    out = catalogue_of(root, config)
    try:
        summary = farm.resume(out, run=config.run_id, executor="serial")
    except InputError:  # nothing there to go on with
        summary = farm.submit(config, out, executor="serial")
    if summary.ended.interrupted:
        raise FarmError("interrupted; the same command goes on")
    found = _statistics(out, config) | {"seconds": summary.ended.elapsed_s, "evaluation_s": _evaluation_s(out, config)}
    if config.catalogue.keep == "accepted":
        found["like_table1"] = _like_table1(out)
    put(out.with_suffix(".json"), encoded_document(found))


def _statistics(out: Path, config: RunConfig) -> dict[str, Any]:
    rows = np.concatenate([commit.statistics for commit in RunHistory(out, config.run_id, []).commits])
    islands, generation = config.evolution.islands, STATISTICS.index("generation")
    rows = rows[np.lexsort((rows[:, generation], rows[:, STATISTICS.index("island")]))]

    def table(of: npt.NDArray[np.float64]) -> dict[str, Any]:
        names = {"mean": "mean_accepted", "accepted": "accepted", "qualified": "qualified", "evaluated": "evaluated"}
        return {name: of[:, STATISTICS.index(column)].reshape(islands, -1).tolist() for name, column in names.items()}

    return table(rows[rows[:, generation] > 0]) | {"founders": table(rows[rows[:, generation] == 0])}


def _evaluation_s(out: Path, config: RunConfig) -> float:
    """Processor seconds of one evaluation, of designs that the run found."""
    catalogue = Catalogue.open(out)
    ids = catalogue.designs(["design_id"])["design_id"].to_pylist()
    genomes = [catalogue.genome(identity) for identity in ids[:: max(1, len(ids) // _TIMED)]]
    if not genomes:
        return math.nan
    formula = FitnessFormula(**config.evolution.fitness.model_dump())
    evaluate(genomes[:1], config.evolution.phenotype.points, formula)
    began = time.process_time()
    evaluate(genomes, config.evolution.phenotype.points, formula)
    return (time.process_time() - began) / len(genomes)


def _like_table1(out: Path) -> dict[str, float]:
    """How likely four accepted offspring have no gene at a bound, and none an offset beyond 2, as those of table 1."""
    rows = Catalogue.open(out).designs(["genes", "generation"])
    rows = rows.filter(np.asarray(rows["generation"]) > 0)
    genes = [np.reshape(flat, (-1, 7)) for flat in rows["genes"].to_pylist()]
    inside = [not (np.isin(g[:, RHO], RHO_RANGE).any() or (np.abs(g[:, :RHO]) >= math.pi).any()) for g in genes]
    near = [bool((np.abs(g[:, RHO + 1 :]) <= _DRAWN_WITHIN).all()) for g in genes]
    return {"inside": float(np.mean(inside) ** _TABLE1), "near": float(np.mean(near) ** _TABLE1)}
