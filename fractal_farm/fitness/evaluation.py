"""Genomes to scores: random iteration, D0, D2, LLE and eq 3.7 for a whole batch in one compiled call.

The kernel holds neither the GIL nor a lock, allocates nothing and runs no Python for a genome: working space is
allocated once a batch, and batches run side by side in threads. Refused genomes do not disturb the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.fitness.dimensions import CloudWorkspace, measure, new_cloud_workspace
from fractal_farm.fitness.formula import FitnessFormula, fitness, numbers_of
from fractal_farm.fitness.lyapunov import (
    TangentWorkspace,
    new_tangent_workspace,
    similarity_exponent,
    tangent_growth,
)
from fractal_farm.ifs.genome import MAX_MAPS, ROW_LENGTH, Genome, Phenotype, Refusal
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.random_iteration import PURPOSES, iterate, stream_keys
from fractal_farm.ifs.system import System, build_system, new_system, reading_of

FloatArray = npt.NDArray[np.float64]

_FITNESS = PURPOSES["fitness"]
_NONE = int(Refusal.NONE)
_NOT_FINITE = int(Refusal.NOT_FINITE)
_COLUMNS = ("d0", "d2", "lle", "fitness", "d0_error", "d2_error")


@dataclass(frozen=True)
class Evaluation:
    """Scores of B genomes, in the order in which they came.

    Attributes:
        d0: (B,) float64 capacity dimension in [0, 3].
        d2: (B,) float64 correlation dimension in [0, 3].
        lle: (B,) float64 largest Lyapunov exponent, nats per iteration.
        fitness: (B,) float64 in [0, 1], eq 3.7; 0 where refused.
        d0_error: (B,) float64 standard error of the slope that D0 is; nan if fewer than three scales were of use.
        d2_error: (B,) float64 standard error of the slope that D2 is.
        refusal: (B,) uint8 `Refusal` codes, 0 where scored; all values but `fitness` are nan where it is not 0.
    """

    d0: FloatArray
    d2: FloatArray
    lle: FloatArray
    fitness: FloatArray
    d0_error: FloatArray
    d2_error: FloatArray
    refusal: npt.NDArray[np.uint8]


def evaluate(
    genomes: Sequence[Genome | npt.ArrayLike],
    n_points: int = 5000,
    formula: FitnessFormula | None = None,
) -> Evaluation:
    """Score genomes.

    Args:
        genomes: `Genome`s or (N, 7) arrays, of any mixture of sizes and phenotypes.
        n_points: points of each cloud, at least 2.
        formula: constants of eq 3.7; the calibrated defaults if None.

    Returns:
        The scores. A genome whose numbers are not finite or do not contract is not scored but refused, with a code.

    Raises:
        InputError: a genome of a wrong shape, or n_points below 2.
    """
    formula = FitnessFormula() if formula is None else formula
    typed = [_as_typed(value, f"genome {number}") for number, value in enumerate(genomes)]
    values = np.empty((len(typed), len(_COLUMNS)))
    refusal = np.empty(len(typed), np.uint8)
    for phenotype in dict.fromkeys(genome.phenotype for genome in typed):
        members = [i for i, genome in enumerate(typed) if genome.phenotype == phenotype]
        genes = np.zeros((len(members), MAX_MAPS, ROW_LENGTH[phenotype.family]))
        by_hand = np.full((len(members), MAX_MAPS), -1.0)
        for row, i in enumerate(members):
            genes[row, : typed[i].n_maps] = typed[i].genes
            if typed[i].probabilities is not None:
                by_hand[row, : typed[i].n_maps] = typed[i].probabilities
        n_maps = np.array([typed[i].n_maps for i in members], np.int64)
        part = evaluate_batch(genes, n_maps, phenotype, n_points, formula, by_hand)
        values[members] = np.column_stack([getattr(part, name) for name in _COLUMNS])
        refusal[members] = part.refusal
    return _named(np.ascontiguousarray(values.T), refusal)


def evaluate_batch(
    genes: FloatArray,
    n_maps: npt.NDArray[np.int64],
    phenotype: Phenotype,
    n_points: int,
    formula: FitnessFormula,
    probabilities: FloatArray | None = None,
) -> Evaluation:
    """Score a batch of genomes of one phenotype in one call that releases the GIL.

    Args:
        genes: (B, M, K) float64, genomes padded to M <= 8 rows; K is 7, or 12 for the affine family.
        n_maps: (B,) int64 number of rows that count, 1 to M.
        phenotype: how rows become maps.
        n_points: points of each cloud, at least 2.
        formula: constants of eq 3.7.
        probabilities: (B, M) float64 selection probabilities set by hand; rows that begin with a negative number, or
            None, leave them to eqs 3.3 and 3.4.

    Returns:
        The scores.

    Raises:
        InputError: shapes that do not fit, or n_points below 2.
    """
    genes = np.array(genes, np.float64, order="C")  # a copy: read-only arrays would be compiled for again
    n_maps = np.array(n_maps, np.int64)
    width = ROW_LENGTH[phenotype.family]
    if genes.ndim != 3 or genes.shape[2] != width or not 1 <= genes.shape[1] <= MAX_MAPS:
        raise InputError(f"genes: shape {genes.shape}; give (B, M, {width}) with M from 1 to {MAX_MAPS}")
    if n_maps.shape != genes.shape[:1] or not ((n_maps >= 1) & (n_maps <= genes.shape[1])).all():
        raise InputError(f"n_maps: give {len(genes)} numbers from 1 to {genes.shape[1]}")
    if n_points < 2:
        raise InputError(f"n_points is {n_points}; dimensions need at least 2 points")
    by_hand = np.full(genes.shape[:2], -1.0) if probabilities is None else np.array(probabilities, np.float64)
    if by_hand.shape != genes.shape[:2]:
        raise InputError(f"probabilities: shape {by_hand.shape}; give {genes.shape[:2]}")
    values = np.empty((len(_COLUMNS), len(genes)))
    refusal = np.empty(len(genes), np.uint8)
    work = new_batch_workspace(n_points)
    _evaluate_genomes(genes, n_maps, by_hand, reading_of(phenotype), numbers_of(formula), work, values, refusal)
    return _named(values, refusal)


class BatchWorkspace(NamedTuple):
    """Memory for one genome at a time.

    Attributes:
        system: maps, probabilities and keys of the genome.
        cloud: (3, n) float64, its orbit.
        measures: for D0 and D2.
        tangent: for LLE of affine genomes.
    """

    system: System
    cloud: FloatArray
    measures: CloudWorkspace
    tangent: TangentWorkspace


def new_batch_workspace(n_points: int) -> BatchWorkspace:
    """Working space for clouds of n_points."""
    return BatchWorkspace(new_system(), np.empty((3, n_points)), new_cloud_workspace(n_points), new_tangent_workspace())


@kernel
def _evaluate_genomes(genes, n_maps, by_hand, reading, formula, work, values, refusal):  # type: ignore[no-untyped-def]
    """Fill values (6, B) and refusal (B,), one genome after the other."""
    system, cloud = work.system, work.cloud
    last = cloud.shape[1] - 1
    for b in range(genes.shape[0]):
        values[:, b] = np.nan
        values[3, b] = 0.0
        refusal[b] = build_system(genes[b], n_maps[b], reading, by_hand[b], system)
        if refusal[b] != _NONE:
            continue
        first, second = stream_keys(system.keys, _FITNESS)
        iterate(system.maps, system.thresholds, n_maps[b], system.start, first, second, cloud)
        if not np.isfinite(cloud[0, last] + cloud[1, last] + cloud[2, last]):  # once infinite, an orbit stays so
            refusal[b] = _NOT_FINITE
            continue
        d0, d2, d0_error, d2_error = measure(cloud, work.measures)
        if reading.affine:
            lle = tangent_growth(system, n_maps[b], work.tangent)
        else:
            lle = similarity_exponent(system, n_maps[b])
        values[0, b] = d0
        values[1, b] = d2
        values[2, b] = lle
        values[3, b] = fitness(d0, d2, lle, formula)
        values[4, b] = d0_error
        values[5, b] = d2_error


def _named(values: FloatArray, refusal: npt.NDArray[np.uint8]) -> Evaluation:
    """An `Evaluation` from its (6, B) columns."""
    d0, d2, lle, scores, d0_error, d2_error = values
    return Evaluation(d0, d2, lle, scores, d0_error, d2_error, refusal)


def _as_typed(value: Genome | npt.ArrayLike, name: str) -> Genome:
    """A genome of a sound shape; its numbers are judged by the kernel, which refuses instead of raising."""
    if not isinstance(value, Genome):
        try:
            value = Genome(np.asarray(value, dtype=np.float64))
        except (TypeError, ValueError):
            raise InputError(f"{name}: not a table of numbers; give N rows of 7 genes") from None
    width = ROW_LENGTH[value.phenotype.family]
    shape = value.genes.shape
    if len(shape) != 2 or shape[1] != width or not 1 <= shape[0] <= MAX_MAPS:
        raise InputError(f"{name}: shape {shape}; a {value.phenotype.family} genome has rows of {width} numbers")
    return value
