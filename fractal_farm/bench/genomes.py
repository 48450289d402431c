"""Genomes to measure with: random ones, such as a run begins with, and the four that the paper prints."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

TABLE1 = {
    "06328": [
        [2.2237, 1.7187, 0.3243, 0.7794, 0.2761, 1.0610, 1.7711],
        [1.2230, -0.1873, 0.0150, 0.8465, 1.3295, 1.1357, -0.0139],
        [-2.1695, 0.9688, 0.0180, 0.2624, 1.2817, 1.0508, -1.1341],
    ],
    "06425": [
        [2.9523, 2.9343, 2.9154, 0.2095, -0.5115, 0.2966, -0.0109],
        [0.1554, -2.4184, -0.1682, 0.5514, 0.0268, -0.8664, 1.1950],
        [-0.3223, 3.0522, 2.3830, 0.8780, -0.4476, -1.2096, -0.9740],
    ],
    "06447": [
        [-1.1886, 1.2925, 2.6916, 0.0397, -1.0043, -1.9483, -1.9868],
        [0.0203, 0.1246, 1.2773, 0.9802, -0.5522, -0.4016, 0.9956],
        [-0.7206, -1.9475, 0.4351, 0.0965, 1.1693, 0.0640, 0.2261],
    ],
    "06582": [
        [-2.5900, -0.2154, 1.9586, 0.2793, -0.9179, -1.2826, 0.5331],
        [0.7182, -0.9256, 3.0556, 0.9677, 0.8829, -0.3807, 0.0029],
    ],
}
"""Of Pang and Hui 2009, table 1: the same as in `configs/table1.yaml`."""


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
