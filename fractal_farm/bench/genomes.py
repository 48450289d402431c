"""Random genomes to measure with: those that a run begins with."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def random_genomes(count: int, seed: int = 0) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Genomes of 2 and 3 maps in equal parts: angles in (-pi, pi), rho in (0, 1), offsets in (-2, 2).

    Returns:
        (count, 3, 7) float64 genes, padded with zeros, and (count,) int64 numbers of maps, as `evaluate_batch` takes
        them.
    """
    generator = np.random.default_rng(seed)
    n_maps = np.arange(count) % 2 + 2
    genes = np.concatenate(
        [
            generator.uniform(-np.pi, np.pi, (count, 3, 3)),
            generator.uniform(0, 1, (count, 3, 1)),
            generator.uniform(-2, 2, (count, 3, 3)),
        ],
        axis=2,
    )
    genes[n_maps == 2, 2] = 0.0
    return genes, n_maps
