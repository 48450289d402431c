"""How `distinctness.json` was fitted, and how well it tells designs from chance.

`python -m fractal_farm.bench.discriminants` fits it again and prints it.
"""

from __future__ import annotations

import json

import numpy as np
import numpy.typing as npt

from fractal_farm.bench.genomes import random_genomes
from fractal_farm.distinctness import DISTINCT, LENGTH, signatures
from fractal_farm.fitness import FitnessFormula, evaluate_batch
from fractal_farm.fitness.evaluation import POINTS
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.similarity_dimension import similarity_dimension

FloatArray = npt.NDArray[np.float64]

QUALIFIED = 0.85
CRISP = (1.0, 3.0)  # similarity dimensions
_TRAINING = (9000, 31, 5)  # random genomes, their seed, clouds of each
_RIDGE = 1e-7  # added to the variances of the noise
_THRESHOLD = 9.5  # deviations of the noise that make two designs distinct
_DIGITS = 6
_PAIRS = 20_000


def features(candidates: int, seed: int, clouds: int) -> FloatArray:
    """Descriptor, D0 and D2 of the crisp qualified designs among random genomes.

    Returns:
        (clouds, designs, 16) float64.
    """
    genes, n_maps = random_genomes(candidates, seed)
    fitness = _evaluated(genes, n_maps, 0)[1]
    low, high = CRISP
    chosen = [
        b
        for b in np.flatnonzero(fitness > QUALIFIED).tolist()
        if low <= similarity_dimension(Genome(genes[b, : n_maps[b]])) <= high
    ]
    return np.array([_evaluated(genes[chosen], n_maps[chosen], cloud)[0] for cloud in range(clouds)])


def fit(sample: FloatArray) -> FloatArray:
    """Linear discriminants, (6, 16), of a (clouds, designs, 16) sample, in units of what makes designs distinct."""
    noise = (sample - sample.mean(axis=0)).reshape(-1, sample.shape[2])
    within = noise.T @ noise / (len(noise) - sample.shape[1]) + _RIDGE * np.eye(sample.shape[2])
    between = np.cov(sample[0].T)
    whitening = np.linalg.inv(np.linalg.cholesky(within))
    _, axes = np.linalg.eigh(whitening @ between @ whitening.T)
    rows: FloatArray = (axes.T @ whitening)[::-1][:LENGTH] / _THRESHOLD
    signs = np.sign(rows[np.arange(LENGTH), np.abs(rows).argmax(axis=1)])
    rows *= signs[:, None]
    return rows


def rates(candidates: int, seed: int, clouds: int = 4) -> tuple[float, float]:
    """Shares of the other clouds of a design that are grouped with it, and of unrelated pairs that are merged."""
    sample = features(candidates, seed, clouds)
    marks = [signatures(cloud[:, :-2], cloud[:, -2], cloud[:, -1]) for cloud in sample]
    copies = np.concatenate([np.linalg.norm(marks[0] - other, axis=1) for other in marks[1:]])
    first, second = np.random.default_rng(seed).integers(0, len(marks[0]), (2, _PAIRS))
    pairs = np.linalg.norm(marks[0][first] - marks[1][second], axis=1)[first != second]
    return float(np.mean(copies < DISTINCT)), float(np.mean(pairs < DISTINCT))


def _evaluated(genes: FloatArray, n_maps: npt.NDArray[np.int64], cloud: int) -> tuple[FloatArray, FloatArray]:
    result = evaluate_batch(genes, n_maps, Phenotype(), POINTS, FitnessFormula(), repeat=cloud)
    return np.column_stack([result.descriptor, result.d0, result.d2]), result.fitness


if __name__ == "__main__":
    print(json.dumps([[float(f"{x:.{_DIGITS}g}") for x in row] for row in fit(features(*_TRAINING))]))  # noqa: T201
