"""The constants that fitness was computed with: what run.json tells, or a part that was made by hand."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.layout import HAND
from fractal_farm.catalogue.parts import list_parts, read_commits, read_rows
from fractal_farm.catalogue.runs import read_run
from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError
from fractal_farm.fitness import FitnessFormula


def formula_of_row(root: Path, row: Mapping[str, Any]) -> FitnessFormula:
    """The constants that a design of a catalogue was scored with.

    Raises:
        FarmError: nothing tells them.
    """
    if row["run_id"] != HAND:
        formula = formula_of(read_run(root, row["run_id"]))
        if formula is not None:
            return formula
    else:
        for part in list_parts(root, HAND):
            if row["design_id"] in read_rows(root, part, ["design_id"])["design_id"].to_pylist():
                (commit,) = read_commits(root, part)
                return formula_by_hand(commit.records)
    raise FarmError(f"{root}: run.json of run {row['run_id']} has no constants of the fitness")


def formula_of(description: Mapping[str, Any] | None) -> FitnessFormula | None:
    """The constants of a run; None where run.json does not tell them."""
    try:
        constants = RunConfig.from_dict((description or {})["config"]).evolution.fitness
    except (FarmError, KeyError, TypeError, ValueError):
        return None
    return FitnessFormula(constants.amplitude, constants.baseline, constants.d0, constants.d2, constants.lle)


def formula_by_hand(records: bytes) -> FitnessFormula:
    """The constants of designs made by hand, from the records in the footer of their part."""
    return FitnessFormula(**json.loads(records)["fitness"])
