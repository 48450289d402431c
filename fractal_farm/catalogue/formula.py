"""The constants that a run computed fitness with, from what run.json tells."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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
