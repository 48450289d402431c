"""The constants that fitness was computed with: those of a run, or of what was made by hand."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.layout import HAND
from fractal_farm.catalogue.parts import Footer, list_parts, read_footer
from fractal_farm.catalogue.runs import read_run
from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError
from fractal_farm.fitness import FitnessFormula


def formula_of(description: Mapping[str, Any] | None) -> FitnessFormula | None:
    """The constants of a run; None where run.json does not tell them."""
    try:
        constants = RunConfig.from_dict((description or {})["config"]).evolution.fitness
    except (FarmError, KeyError, TypeError, ValueError):
        return None
    return FitnessFormula(constants.amplitude, constants.baseline, constants.d0, constants.d2, constants.lle)


def formula_by_hand(footer: Footer) -> FitnessFormula:
    """The constants that designs made by hand were scored with, which their part tells."""
    return FitnessFormula(**json.loads(footer.records)["fitness"])


def formula_of_row(root: Path, row: Mapping[str, Any]) -> FitnessFormula:
    """The constants that the fitness of a manifest row was computed with.

    Raises:
        FarmError: they are not to be found, or what should tell them is damaged.
    """
    if row["run_id"] == HAND:
        for part in list_parts(root, HAND):
            if part.writer == row["writer"]:
                return formula_by_hand(read_footer(root, part))
    elif (formula := formula_of(read_run(root, row["run_id"]))) is not None:
        return formula
    raise FarmError(f"{root}: nothing tells the fitness constants of run {row['run_id']}; restore it from a copy")
