"""What can be known of a similarity genome without its cloud, a hundred times cheaper: to choose candidates by.

Where similarities do not overlap, D0 = s with sum rho^s = 1, D2 = t with sum p^2 rho^-t = 1, and LLE = sum p ln rho
(NOTES, 'Fitness'). The descriptor is that of a coarse measure: the largest pieces f_w(A) of the attractor, each as its
centre of mass with the probability p_w, in each copy that a symmetry asks for; mean and covariance of the invariant
measure solve linear equations. Of random qualified designs the signature is foreseen within .7 of what makes two
designs distinct, in each of its components.
Scalar compiled code throughout, since it decides who is evaluated.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.fitness.cloud_frame import FrameWorkspace, new_frame_workspace, principal_axes
from fractal_farm.fitness.descriptor import LENGTH, N_QUANTILES, quantile_means
from fractal_farm.fitness.formula import FitnessFormula, fitness, numbers_of
from fractal_farm.fitness.inputs import checked_batch, checked_symmetries
from fractal_farm.fitness.lyapunov import similarity_exponent
from fractal_farm.ifs.copies import place_copies
from fractal_farm.ifs.enclosure import compose, copy_numbers, distance, image
from fractal_farm.ifs.genome import MAX_MAPS, RHO, ROW_LENGTH, Phenotype, Refusal
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.symmetry import MAX_COPIES
from fractal_farm.ifs.system import System, build_system, fixed_point, new_system, reading_of

FloatArray = npt.NDArray[np.float64]

PIECES = 64
_PIECES_A_COPY = 24  # at least
_ROOM = _PIECES_A_COPY * MAX_COPIES
_BINS = 512
_BINS_PER_UNIT = 64.0  # a unit being the root mean square distance
_WITHIN = (0.4, 0.9, 1.4)  # distances within a piece, in units of its own root mean square
_STEPS = 100
_CONVERGED = 1e-12
_NONE = int(Refusal.NONE)


class Foreseen(NamedTuple):
    """What is foreseen of a batch; nan for those that are refused.

    Attributes:
        d0: (B,) float64 similarity dimensions, above 0, not limited to 3.
        d2: (B,) float64, at most `d0`.
        fitness: (B,) float64 in [0, 1], eq 3.7 with dimensions of at most 3.
        descriptor: (B, 14) float32, see `shape_descriptor`; nan for those of less fitness than was asked for.
        refusal: (B,) uint8 `Refusal` codes.
    """

    d0: FloatArray
    d2: FloatArray
    fitness: FloatArray
    descriptor: npt.NDArray[np.float32]
    refusal: npt.NDArray[np.uint8]


def foresee(
    genes: FloatArray,
    n_maps: npt.NDArray[np.int64],
    phenotype: Phenotype,
    formula: FitnessFormula,
    described_from: float = 0.0,
    symmetries: npt.NDArray[np.uint8] | None = None,
) -> Foreseen:
    """What a batch of genomes will come out as, without random iteration.

    Args:
        genes: (B, M, 7) float64, genomes padded to M <= 8 rows.
        n_maps: (B,) int64 number of rows that count, 1 to M.
        phenotype: how rows become maps; of the similarity family.
        formula: constants of eq 3.7.
        described_from: expected fitness from which on a genome gets a descriptor.
        symmetries: (B,) codes (`ifs.symmetry`); None: nobody has any.

    Raises:
        InputError: shapes that do not fit, or affine maps, for which there are no closed forms.
    """
    if phenotype.family != "similarity":
        raise InputError(f"phenotype.family is {phenotype.family}; only similarities can be foreseen")
    genes, n_maps = checked_batch(genes, n_maps, ROW_LENGTH[phenotype.family])
    values = np.full((3, len(genes)), np.nan)
    descriptors = np.full((len(genes), LENGTH), np.nan, np.float32)
    refusal = np.zeros(len(genes), np.uint8)
    work = new_foresight_workspace()
    _foresee(
        genes,
        n_maps,
        checked_symmetries(symmetries, len(genes)),
        reading_of(phenotype),
        numbers_of(formula),
        float(described_from),
        work,
        values,
        descriptors,
        refusal,
    )
    return Foreseen(values[0], values[1], values[2], descriptors, refusal)


class ForesightWorkspace(NamedTuple):
    """Memory for one genome at a time.

    Attributes:
        system: maps and probabilities of the genome.
        words: (288, 12) float64, the maps of the pieces.
        weights: (288,) float64, their probabilities.
        sizes: (288,) float64, their contractions; then their extents in units of that of the shape.
        centres: (288, 3) float64, their centres of mass.
        pairs: (512,) float64, the weight of the pairs in each bin of distances.
        distances: (512,) float64, and their distances, weighted.
        equations: (9, 10) float64, the linear equations of the covariance.
        frame: for the principal axes.
    """

    system: System
    words: FloatArray
    weights: FloatArray
    sizes: FloatArray
    centres: FloatArray
    pairs: FloatArray
    distances: FloatArray
    equations: FloatArray
    frame: FrameWorkspace


def new_foresight_workspace() -> ForesightWorkspace:
    """Working space for any genome."""
    return ForesightWorkspace(
        new_system(),
        np.empty((_ROOM, 12)),
        np.empty(_ROOM),
        np.empty(_ROOM),
        np.empty((_ROOM, 3)),
        np.empty(_BINS),
        np.empty(_BINS),
        np.empty((9, 10)),
        new_frame_workspace(),
    )


@kernel
def _foresee(genes, n_maps, symmetries, reading, formula, described_from, work, values, descriptors, refusal):
    """Fill values (3, B) with D0, D2 and fitness, descriptors (B, 14) and refusal (B,)."""
    system = work.system
    by_rule = np.full(MAX_MAPS, -1.0)
    for b in range(genes.shape[0]):
        n = n_maps[b]
        refusal[b] = build_system(genes[b], n, reading, by_rule, system)
        if refusal[b] != _NONE:
            continue
        d0, d2 = _dimensions(system, n)
        values[0, b] = d0
        values[1, b] = d2
        values[2, b] = fitness(min(d0, 3.0), min(d2, 3.0), similarity_exponent(system, n), formula)
        if values[2, b] >= described_from:
            place_copies(symmetries[b], n, system)
            _describe(n, _cut(n, work), work, descriptors[b])


@kernel
def _dimensions(system, n):
    """S with sum rho^s = 1, and t with sum p^2 rho^-t = 1, at least 0; both for a single map are 0."""
    weights = np.ones(MAX_MAPS)
    logarithms = np.empty(MAX_MAPS)
    if n < 2:
        return 0.0, 0.0
    for i in range(n):
        logarithms[i] = math.log(system.rows[i, RHO])
    d0 = _exponent(weights, logarithms, n, 0.0)
    for i in range(n):
        weights[i] = system.probabilities[i] * system.probabilities[i]
        logarithms[i] = -logarithms[i]
    return d0, max(_exponent(weights, logarithms, n, d0), 0.0)


@kernel
def _exponent(weights, logarithms, n, start):
    """The t with sum of weight exp(t logarithm) = 1, by Newton's steps: the sum is convex and monotonous."""
    t = start
    for _ in range(_STEPS):
        total = 0.0
        slope = 0.0
        for i in range(n):
            power = weights[i] * math.exp(t * logarithms[i])
            total += power
            slope += power * logarithms[i]
        step = (1.0 - total) / slope
        t += step
        if abs(step) <= _CONVERGED * max(abs(t), 1.0):
            break
    return t


@kernel
def _cut(n, work):
    """Cut the attractor into pieces, the one with the largest share of the second moment first, and copy them.

    Returns:
        How many pieces there are, those of the copies included.
    """
    system = work.system
    copies = system.n_copies[0]
    words, weights, sizes = work.words, work.weights, work.sizes
    parent = np.empty(12)
    for i in range(n):
        copy_numbers(system.maps[i], words[i], 12)
        weights[i] = system.probabilities[i]
        sizes[i] = system.rows[i, RHO]
    count = n
    room = max(PIECES // copies, _PIECES_A_COPY)
    while count + n - 1 <= room and n > 1:
        largest = 0
        share = -1.0
        for k in range(count):
            here = weights[k] * sizes[k] * sizes[k]
            if here > share:
                share = here
                largest = k
        copy_numbers(words[largest], parent, 12)
        weight = weights[largest]
        size = sizes[largest]
        for i in range(n):
            place = largest if i == 0 else count + i - 1
            compose(parent, system.maps[i], words[place])
            weights[place] = weight * system.probabilities[i]
            sizes[place] = size * system.rows[i, RHO]
        count += n - 1
    for c in range(1, copies):
        for k in range(count):
            compose(system.copies[c], words[k], words[c * count + k])
            weights[c * count + k] = weights[k] / copies
            sizes[c * count + k] = sizes[k]
    for k in range(count):
        weights[k] /= copies
    return copies * count


@kernel
def _describe(n, count, work, descriptor):
    """Fill a descriptor from so many pieces."""
    mean = np.zeros(3)
    covariance = np.zeros(6)
    _moments(n, work, mean, covariance)
    own_trace = covariance[0] + covariance[1] + covariance[2]
    if work.system.n_copies[0] > 1:
        _moments_of_copies(work.system, mean, covariance)
    trace = covariance[0] + covariance[1] + covariance[2]
    descriptor[:] = np.float32(0.0)
    if not trace > 0.0:
        return
    for k in range(count):
        x, y, z = image(work.words[k], mean[0], mean[1], mean[2])
        work.centres[k, 0], work.centres[k, 1], work.centres[k, 2] = x, y, z
        work.sizes[k] *= math.sqrt(own_trace / trace)
    unit = math.sqrt(2.0 * trace)
    work.pairs[:] = 0.0
    work.distances[:] = 0.0
    for i in range(count):
        a = work.centres[i]
        own = work.sizes[i] * work.sizes[i]
        for part in _WITHIN:
            _enter(part * work.sizes[i], work.weights[i] * work.weights[i] / len(_WITHIN), work)
        for j in range(i):
            b = work.centres[j]
            apart = distance(a[0], a[1], a[2], b[0], b[1], b[2]) / unit
            spread = 0.5 * (own + work.sizes[j] * work.sizes[j])
            _enter(math.sqrt(apart * apart + spread), 2.0 * work.weights[i] * work.weights[j], work)
    quantile_means(work.pairs, work.distances, 1.0, descriptor)
    principal_axes(covariance, work.frame)
    variances = work.frame.variances
    for k in range(2):
        descriptor[N_QUANTILES + k] = math.sqrt(max(variances[2 - k], 0.0) / variances[0])


@kernel
def _enter(length, weight, work):
    """Enter a pair of a distance, in units of the root mean square one, into the histogram."""
    b = min(int(length * _BINS_PER_UNIT), _BINS - 1)
    work.pairs[b] += weight
    work.distances[b] += weight * length


@kernel
def _moments(n, work, mean, covariance):
    """Mean m = sum p f(m) and covariance C = sum p (A C A^T + (f(m) - m)(f(m) - m)^T) of the invariant measure."""
    system = work.system
    average = np.zeros(12)
    for i in range(n):
        for k in range(12):
            average[k] += system.probabilities[i] * system.maps[i, k]
    fixed_point(average, mean)
    equations = work.equations
    for row in range(9):
        for column in range(10):
            equations[row, column] = 1.0 if row == column else 0.0
    moved = np.empty(3)
    for i in range(n):
        m = system.maps[i]
        p = system.probabilities[i]
        moved[0], moved[1], moved[2] = image(m, mean[0], mean[1], mean[2])
        for a in range(3):
            for b in range(3):
                equations[3 * a + b, 9] += p * (moved[a] - mean[a]) * (moved[b] - mean[b])
                for c in range(3):
                    for d in range(3):
                        equations[3 * a + b, 3 * c + d] -= p * m[4 * a + c] * m[4 * b + d]
    _solve(equations)
    covariance[0], covariance[1], covariance[2] = equations[0, 9], equations[4, 9], equations[8, 9]
    covariance[3], covariance[4], covariance[5] = equations[1, 9], equations[2, 9], equations[5, 9]


@kernel
def _moments_of_copies(system, mean, covariance):
    """Turn the covariance of the attractor, of this mean, into that of all its copies together."""
    own = np.empty((3, 3))
    own[0, 0], own[1, 1], own[2, 2] = covariance[0], covariance[1], covariance[2]
    own[0, 1] = own[1, 0] = covariance[3]
    own[0, 2] = own[2, 0] = covariance[4]
    own[1, 2] = own[2, 1] = covariance[5]
    count = system.n_copies[0]
    centre = np.zeros(3)
    for c in range(count):
        moved = image(system.copies[c], mean[0], mean[1], mean[2])
        for axis in range(3):
            centre[axis] += moved[axis] / count
    whole = np.zeros((3, 3))
    for c in range(count):
        m = system.copies[c]
        moved = image(m, mean[0], mean[1], mean[2])
        for i in range(3):
            for j in range(3):
                total = (moved[i] - centre[i]) * (moved[j] - centre[j])
                for k in range(3):
                    for h in range(3):
                        total += m[4 * i + k] * own[k, h] * m[4 * j + h]
                whole[i, j] += total / count
    covariance[0], covariance[1], covariance[2] = whole[0, 0], whole[1, 1], whole[2, 2]
    covariance[3], covariance[4], covariance[5] = whole[0, 1], whole[0, 2], whole[1, 2]


@kernel
def _solve(equations):
    """Gauss-Jordan elimination of (n, n + 1) equations with partial pivoting; the solution is in the last column."""
    n = equations.shape[0]
    for k in range(n):
        pivot = k
        for row in range(k + 1, n):
            if abs(equations[row, k]) > abs(equations[pivot, k]):
                pivot = row
        for column in range(k, n + 1):
            equations[k, column], equations[pivot, column] = equations[pivot, column], equations[k, column]
        for row in range(n):
            if row != k:
                factor = equations[row, k] / equations[k, k]
                for column in range(k, n + 1):
                    equations[row, column] -= factor * equations[k, column]
    for k in range(n):
        equations[k, n] /= equations[k, k]
