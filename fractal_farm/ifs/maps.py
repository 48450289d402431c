"""Resolved maps and selection probabilities of one genome, in the order in which its rows are stored."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.ifs.random_iteration import system_of


def resolved_maps(genome: Genome | npt.ArrayLike) -> npt.NDArray[np.float64]:
    """The affine maps x -> A x + b of a genome (eq 3.2, or eq 2.1 for the affine family).

    Args:
        genome: a `Genome` or an (N, 7) array.

    Returns:
        (N, 3, 4) float64, [A | b] for each stored row.

    Raises:
        InputError: the genome is invalid.
    """
    return resolved(genome)[0]


def selection_probabilities(genome: Genome | npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Selection probabilities (eqs 3.3 and 3.4), or those set by hand.

    Args:
        genome: a `Genome` or an (N, 7) array.

    Returns:
        (N,) float64, one for each stored row, sum 1.

    Raises:
        InputError: the genome is invalid.
    """
    return resolved(genome)[1]


def resolved(genome: Genome | npt.ArrayLike) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Both `resolved_maps` and `selection_probabilities`."""
    valid = as_genome(genome)
    system = system_of(valid)
    order = system.order[: valid.n_maps]
    maps, probabilities = np.empty((valid.n_maps, 3, 4)), np.empty(valid.n_maps)
    maps[order] = system.maps[: valid.n_maps].reshape(-1, 3, 4)
    probabilities[order] = system.probabilities[: valid.n_maps]
    return maps, probabilities
