"""Fractal Farm grows catalogues of printable 3D fractal designs.

The public names below are loaded at first use, so that `import fractal_farm` costs nothing. A genome is a
`Genome` or an (N, 7) array, points are any (n, 3) float array; see each name's own documentation.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.config import RunConfig, load_genomes
    from fractal_farm.errors import FarmError, InputError
    from fractal_farm.fitness import (
        Evaluation,
        FitnessFormula,
        capacity_dimension,
        correlation_dimension,
        evaluate,
        lyapunov_exponent,
        pair_counts,
    )
    from fractal_farm.ifs.genome import Genome, Phenotype
    from fractal_farm.ifs.maps import selection_probabilities
    from fractal_farm.ifs.random_iteration import attractor_points
    from fractal_farm.ifs.similarity_dimension import similarity_dimension
    from fractal_farm.solid import solidify

__version__ = "0.1.0"
__all__ = [
    "Catalogue",
    "Evaluation",
    "FarmError",
    "FitnessFormula",
    "Genome",
    "InputError",
    "Phenotype",
    "RunConfig",
    "attractor_points",
    "capacity_dimension",
    "correlation_dimension",
    "evaluate",
    "load_genomes",
    "lyapunov_exponent",
    "pair_counts",
    "selection_probabilities",
    "similarity_dimension",
    "solidify",
]

_HOMES = {
    "Catalogue": "catalogue",
    "Evaluation": "fitness",
    "FarmError": "errors",
    "FitnessFormula": "fitness",
    "Genome": "ifs.genome",
    "InputError": "errors",
    "Phenotype": "ifs.genome",
    "RunConfig": "config",
    "attractor_points": "ifs.random_iteration",
    "capacity_dimension": "fitness",
    "correlation_dimension": "fitness",
    "evaluate": "fitness",
    "load_genomes": "config",
    "lyapunov_exponent": "fitness",
    "pair_counts": "fitness",
    "selection_probabilities": "ifs.maps",
    "similarity_dimension": "ifs.similarity_dimension",
    "solidify": "solid",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
