"""Genomes to scores: random iteration, D0, D2, LLE, eq 3.7 and the descriptor for a whole batch in one compiled call.

The kernel holds neither the GIL nor a lock, allocates nothing and runs no Python for a genome: working space is
allocated once a batch, and batches run side by side in threads. Refused genomes do not disturb the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.fitness.descriptor import LENGTH, DescriptorWorkspace, describe, new_descriptor_workspace
from fractal_farm.fitness.dimensions import CloudWorkspace, measure, new_cloud_workspace
from fractal_farm.fitness.formula import FitnessFormula, FormulaNumbers, fitness, numbers_of
from fractal_farm.fitness.inputs import (
    as_typed,
    checked_batch,
    checked_probabilities,
    checked_symmetries,
    whole_number,
)
from fractal_farm.fitness.lyapunov import (
    TangentWorkspace,
    new_tangent_workspace,
    similarity_exponent,
    tangent_growth,
)
from fractal_farm.ifs.copies import place_copies
from fractal_farm.ifs.genome import MAX_MAPS, ROW_LENGTH, Genome, Phenotype, Refusal
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.random_iteration import grow, stream_keys, stream_number
from fractal_farm.ifs.symmetry import symmetry_codes
from fractal_farm.ifs.system import Reading, System, build_system, new_system, reading_of

FloatArray = npt.NDArray[np.float64]

_MOST_REPEATS = 2**30
POINTS = 5000  # of a cloud that scores are computed from (paper, section 3.2.2)
_NONE = int(Refusal.NONE)
_NOT_FINITE = int(Refusal.NOT_FINITE)
_D0, _D2, _LLE, _FITNESS, _D0_ERROR, _D2_ERROR = range(6)  # rows of the values that the kernel fills


@dataclass(frozen=True)
class Evaluation:
    """Scores of B genomes, in the order in which they came.

    Errors are standard errors. From one cloud, those of D0 and D2 are the fitted slope's (nan if fewer than three
    scales were of use), that of LLE is 0 where LLE is exact, and the others are not known (nan). From several clouds
    all of them are errors of the means over the clouds.

    Attributes:
        d0: (B,) float64 capacity dimension in [0, 3].
        d2: (B,) float64 correlation dimension in [0, 3].
        lle: (B,) float64 largest Lyapunov exponent, nats per iteration.
        fitness: (B,) float64 in [0, 1], eq 3.7; 0 where refused.
        descriptor: (B, 14) float32, see `shape_descriptor`.
        d0_error: (B,) float64.
        d2_error: (B,) float64.
        lle_error: (B,) float64.
        fitness_error: (B,) float64.
        descriptor_error: (B, 14) float32.
        refusal: (B,) uint8 `Refusal` codes, 0 where scored; all values but `fitness` are nan where it is not 0.
    """

    d0: FloatArray
    d2: FloatArray
    lle: FloatArray
    fitness: FloatArray
    descriptor: npt.NDArray[np.float32]
    d0_error: FloatArray
    d2_error: FloatArray
    lle_error: FloatArray
    fitness_error: FloatArray
    descriptor_error: npt.NDArray[np.float32]
    refusal: npt.NDArray[np.uint8]


def evaluate(
    genomes: Sequence[Genome | npt.ArrayLike],
    n_points: int = POINTS,
    formula: FitnessFormula | None = None,
    repeats: int = 1,
) -> Evaluation:
    """Score genomes.

    Args:
        genomes: `Genome`s or (N, 7) arrays, of any mixture of sizes and phenotypes.
        n_points: points of each cloud, at least 2; beyond 20,000, D2 takes a sample of the pairs.
        formula: constants of eq 3.7; the calibrated defaults if None.
        repeats: independent clouds for each genome, at least 1. Values are means over them. The first cloud is the
            one that the farm scores a design by.

    Returns:
        The scores. A genome whose numbers are not finite or do not contract is not scored but refused, with a code.

    Raises:
        InputError: a genome of a wrong shape or with bad probabilities, n_points below 2, or repeats below 1.
    """
    formula = FitnessFormula() if formula is None else formula
    repeats = whole_number("repeats", repeats, 1)
    if isinstance(genomes, Genome) or not isinstance(genomes, Iterable):
        raise InputError("genomes: not a sequence; give a list of genomes")
    typed = [as_typed(value, f"genome {number}") for number, value in enumerate(genomes)]
    result = _unscored(len(typed))
    for phenotype in dict.fromkeys(genome.phenotype for genome in typed):
        members = [i for i, genome in enumerate(typed) if genome.phenotype == phenotype]
        genes = np.zeros((len(members), MAX_MAPS, ROW_LENGTH[phenotype.family]))
        by_hand = np.full((len(members), MAX_MAPS), -1.0)
        for row, i in enumerate(members):
            genes[row, : typed[i].n_maps] = typed[i].genes
            if typed[i].probabilities is not None:
                by_hand[row, : typed[i].n_maps] = typed[i].probabilities
        n_maps = np.array([typed[i].n_maps for i in members], np.int64)
        symmetries = symmetry_codes(typed[i].symmetry for i in members)
        parts = [
            evaluate_batch(genes, n_maps, phenotype, n_points, formula, by_hand, repeat, symmetries=symmetries)
            for repeat in range(repeats)
        ]
        part = parts[0] if repeats == 1 else _mean(parts)
        for name, column in vars(result).items():
            column[members] = getattr(part, name)
    return result


def evaluate_batch(
    genes: FloatArray,
    n_maps: npt.NDArray[np.int64],
    phenotype: Phenotype,
    n_points: int,
    formula: FitnessFormula,
    probabilities: FloatArray | None = None,
    repeat: int = 0,
    described_from: float = 0.0,
    symmetries: npt.NDArray[np.uint8] | None = None,
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
        repeat: number of an independent cloud; 0 is the one that scores are computed from.
        described_from: fitness from which on a genome gets a descriptor, which takes a tenth of the time; above 1,
            none does. Those of the others are nan.
        symmetries: (B,) codes (`ifs.symmetry`); None: nobody has any. LLE is that of the maps, the rest that of the
            whole shape.

    Returns:
        The scores.

    Raises:
        InputError: shapes that do not fit, probabilities that are none, n_points below 2, or repeat below 0.
    """
    n_points, repeat = whole_number("n_points", n_points, 2), whole_number("repeat", repeat, 0, _MOST_REPEATS)
    genes, n_maps = checked_batch(genes, n_maps, ROW_LENGTH[phenotype.family])
    by_hand = (
        np.full(genes.shape[:2], -1.0) if probabilities is None else checked_probabilities(probabilities, genes, n_maps)
    )
    values = np.empty((6, len(genes)))
    result = _unscored(len(genes))
    stream = stream_number("fitness" if repeat == 0 else "repeat", repeat)
    task = Task(reading_of(phenotype), numbers_of(formula), stream, float(described_from))
    work = new_batch_workspace(n_points)
    codes = checked_symmetries(symmetries, len(genes))
    _evaluate_genomes(genes, n_maps, by_hand, codes, task, work, values, result.descriptor, result.refusal)
    for row, name in enumerate(("d0", "d2", "lle", "fitness", "d0_error", "d2_error")):
        getattr(result, name)[:] = values[row]
    if phenotype.family == "similarity":
        result.lle_error[result.refusal == _NONE] = 0.0
    return result


class Task(NamedTuple):
    """What is asked of a batch, in the plain numbers that kernels take.

    Attributes:
        reading: how rows become maps.
        formula: constants of eq 3.7.
        stream: number of the random stream.
        described_from: fitness from which on a descriptor is computed.
    """

    reading: Reading
    formula: FormulaNumbers
    stream: int
    described_from: float


class BatchWorkspace(NamedTuple):
    """Memory for one genome at a time.

    Attributes:
        system: maps, probabilities and keys of the genome.
        cloud: (3, n) float64, its orbit.
        measures: for D0 and D2.
        descriptor: for the descriptor.
        tangent: for LLE of affine genomes.
    """

    system: System
    cloud: FloatArray
    measures: CloudWorkspace
    descriptor: DescriptorWorkspace
    tangent: TangentWorkspace


def new_batch_workspace(n_points: int) -> BatchWorkspace:
    """Working space for clouds of n_points."""
    return BatchWorkspace(
        new_system(),
        np.empty((3, n_points)),
        new_cloud_workspace(n_points),
        new_descriptor_workspace(n_points),
        new_tangent_workspace(),
    )


@kernel
def _evaluate_genomes(  # type: ignore[no-untyped-def]
    genes, n_maps, by_hand, symmetries, task, work, values, descriptors, refusal
):
    """Fill values (6, B), descriptors (B, 14) and refusal (B,), one genome after the other."""
    system, cloud = work.system, work.cloud
    n = cloud.shape[1]
    for b in range(genes.shape[0]):
        values[:, b] = np.nan
        values[_FITNESS, b] = 0.0
        descriptors[b] = np.nan
        refusal[b] = build_system(genes[b], n_maps[b], task.reading, by_hand[b], system)
        if refusal[b] != _NONE:
            continue
        place_copies(symmetries[b], n_maps[b], system)
        grow(system, n_maps[b], task.stream, cloud)
        if not np.isfinite(cloud[0, n - 1] + cloud[1, n - 1] + cloud[2, n - 1]):  # once infinite, an orbit stays so
            refusal[b] = _NOT_FINITE
            continue
        d0, d2, d0_error, d2_error = measure(cloud, work.measures)
        if task.reading.affine:
            first, second = stream_keys(system.keys, task.stream)
            lle = tangent_growth(system, n_maps[b], first, second, work.tangent)
        else:
            lle = similarity_exponent(system, n_maps[b])
        values[_D0, b] = d0
        values[_D2, b] = d2
        values[_LLE, b] = lle
        values[_FITNESS, b] = fitness(d0, d2, lle, task.formula)
        values[_D0_ERROR, b] = d0_error
        values[_D2_ERROR, b] = d2_error
        if values[_FITNESS, b] >= task.described_from:
            descriptors[b] = np.float32(0.0)
            if work.measures.counts.any():  # not so if the cloud is a single point
                measures = work.measures
                describe(measures.pairs.points, n, measures.frame.variances, work.descriptor, descriptors[b])


def _unscored(count: int) -> Evaluation:
    """Room for the scores of so many genomes, all nan."""

    def column() -> FloatArray:
        return np.full(count, np.nan)

    def table() -> npt.NDArray[np.float32]:
        return np.full((count, LENGTH), np.nan, np.float32)

    return Evaluation(
        column(),
        column(),
        column(),
        column(),
        table(),
        column(),
        column(),
        column(),
        column(),
        table(),
        np.zeros(count, np.uint8),
    )


def _mean(parts: list[Evaluation]) -> Evaluation:
    """Means over independent clouds, and their standard errors."""
    result = _unscored(len(parts[0].d0))
    for name in ("d0", "d2", "lle", "fitness", "descriptor"):
        samples = np.array([getattr(part, name) for part in parts], np.float64)
        # What does not vary comes out to the last bit, -inf included.
        offsets = np.subtract(samples, samples[0], out=np.zeros_like(samples), where=samples != samples[0])
        getattr(result, name)[:] = samples[0] + offsets.mean(axis=0)
        getattr(result, f"{name}_error")[:] = offsets.std(axis=0, ddof=1) / np.sqrt(len(parts))
    result.refusal[:] = np.max([part.refusal for part in parts], axis=0)
    return result
