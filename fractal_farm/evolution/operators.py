"""Genetic operators on blocks of slots (paper section 3.3; eqs 3.5 and 3.6 in NOTES).

Every operator takes whole blocks of random numbers whose row is the slot and returns arrays with one row a slot.
Alleles that an operator does not touch keep their bits.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.genome import RHO
from fractal_farm.ifs.linear_algebra import largest_singular_value

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

RHO_RANGE = (0.001, 0.999)
OFFSET_RANGE = 2.0


def random_genes(
    rng: np.random.Generator, slots: int, max_maps: int, affine: bool, map_counts: dict[int, float]
) -> tuple[FloatArray, IntArray]:
    """Random genomes: angles in [-pi, pi], rho in `RHO_RANGE`, offsets in [-2, 2] (NOTES, 'Genome').

    Affine maps have a matrix with normal entries, rescaled to a spectral norm drawn from `RHO_RANGE`.

    Args:
        rng: stream of the block.
        slots: number of genomes.
        max_maps: rows to make room for.
        affine: whether rows are general affine maps.
        map_counts: share of each number of maps.

    Returns:
        (slots, max_maps, K) float64 genes, padded with 0, and (slots,) int64 numbers of maps.
    """
    choice = rng.random(slots)
    n_maps = np.zeros(slots, np.int64)
    cumulative = 0.0
    for count, share in sorted(map_counts.items()):
        n_maps = np.where((n_maps == 0) & (choice < cumulative + share), count, n_maps)
        cumulative += share
    n_maps = np.where(n_maps == 0, max(map_counts), n_maps)
    uniform = rng.random((slots, max_maps, 7))
    low, high = RHO_RANGE
    offsets = (2.0 * uniform[..., 4:7] - 1.0) * OFFSET_RANGE
    if affine:
        matrices = rng.standard_normal((slots, max_maps, 3, 3))
        norms = low + (high - low) * uniform[..., RHO]
        genes = np.zeros((slots, max_maps, 12))
        for slot in range(slots):
            for row in range(int(n_maps[slot])):
                matrix = matrices[slot, row]
                scale = norms[slot, row] / largest_singular_value(*matrix.ravel().tolist())
                genes[slot, row].reshape(3, 4)[:, :3] = matrix * scale
        genes[..., 3::4] = offsets
    else:
        angles = (2.0 * uniform[..., :3] - 1.0) * math.pi
        rho = low + (high - low) * uniform[..., RHO : RHO + 1]
        genes = np.concatenate([angles, rho, offsets], axis=2)
    genes[np.arange(max_maps) >= n_maps[:, None]] = 0.0
    return genes, n_maps


def proportional(weights: FloatArray, uniform: FloatArray) -> npt.NDArray[np.intp]:
    """Parents drawn with probability proportional to a weight, such as fitness; uniformly if nobody has any.

    Args:
        weights: (members,) float64, at least 0.
        uniform: any shape, float64 in [0, 1).

    Returns:
        Indices of members in the shape of `uniform`.
    """
    cumulative = np.cumsum(weights)
    if not cumulative[-1] > 0.0:
        return np.minimum((uniform * len(weights)).astype(np.intp), len(weights) - 1)
    drawn = np.searchsorted(cumulative, uniform * cumulative[-1], side="right")
    return np.asarray(np.minimum(drawn, len(weights) - 1), np.intp)


def block_crossover(
    first: FloatArray,
    second: FloatArray,
    first_maps: IntArray,
    second_maps: IntArray,
    uniform: FloatArray,
    probability: float,
    kind: str = "block",
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Eq 3.5: rows 1..i and columns 1..j of the first parent are replaced by those of the second.

    i goes up to the smaller number of maps, j up to one less than the row's length: no row is exchanged whole. Another
    reading of 'single point' takes the matrix as one sequence: rows 1..i-1 whole, and columns 1..j of row i.

    Args:
        first: (slots, M, K) genes; the offspring has this parent's number of maps.
        second: (slots, M, K) genes.
        first_maps: (slots,) numbers of maps.
        second_maps: (slots,) numbers of maps.
        uniform: (slots, 3) float64: whether, i, j.
        probability: of crossing over.
        kind: "block" or "sequence".

    Returns:
        (slots, M, K) offspring and (slots,) whether crossover took place.
    """
    crossed = uniform[:, 0] < probability
    rows = 1 + (uniform[:, 1] * np.minimum(first_maps, second_maps)).astype(np.int64)
    columns = 1 + (uniform[:, 2] * (first.shape[2] - 1)).astype(np.int64)
    row, below = np.arange(first.shape[1])[:, None], np.arange(first.shape[2]) < columns[:, None, None]
    block = (row < rows[:, None, None]) & below
    if kind == "sequence":
        block |= row < rows[:, None, None] - 1
    return np.where(block & crossed[:, None, None], second, first), crossed


def gaussian_mutation(
    genes: FloatArray,
    n_maps: IntArray,
    uniform: FloatArray,
    normal: FloatArray,
    probability: float | FloatArray,
    sigma: float | FloatArray,
    affine: bool,
    repair: str = "reflect",
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Eq 3.6: each allele moves by sigma N(0, 1) with the given probability; then the genome is repaired.

    Args:
        genes: (slots, M, K) float64.
        n_maps: (slots,) numbers of maps.
        uniform: (slots, M, K) float64 in [0, 1).
        normal: (slots, M, K) float64 standard normal.
        probability: of each allele; one for all slots, or (slots, 1, 1).
        sigma: standard deviation of a move; one for all slots, or (slots, 1, 1).
        affine: whether rows are general affine maps.
        repair: "reflect" (angles wrap), "clip", or "refuse": what does not contract is left as it is.

    Returns:
        (slots, M, K) offspring and (slots,) whether any allele moved.
    """
    real = (np.arange(genes.shape[1]) < n_maps[:, None])[:, :, None]
    moved = (uniform < probability) & real
    mutant = np.where(moved, genes + sigma * normal, genes)
    if repair != "refuse":
        clip = repair == "clip"
        mutant = _repair_affine(mutant, n_maps, clip) if affine else _repair(mutant, real, clip)
    return mutant, np.asarray(moved.any(axis=(1, 2)))


def similarity_dimension_within(
    genes: FloatArray, n_maps: IntArray, bounds: tuple[float, float]
) -> npt.NDArray[np.bool_]:
    """Whether the similarity dimension s (Moran: sum rho^s = 1) lies within bounds, without solving for it.

    sum rho^s falls with s, so low <= s <= high is sum rho^low >= 1 and sum rho^high <= 1.

    Args:
        genes: (slots, M, 7) float64.
        n_maps: (slots,) numbers of maps.
        bounds: lowest and highest dimension allowed.

    Returns:
        (slots,) bool.
    """
    ratios = [rho[:count] for rho, count in zip(genes[:, :, RHO].tolist(), n_maps.tolist(), strict=True)]
    low, high = bounds
    return np.array(
        [sum(math.pow(r, low) for r in genome) >= 1.0 >= sum(math.pow(r, high) for r in genome) for genome in ratios],
        dtype=bool,
    )


def _repair(genes: FloatArray, real: npt.NDArray[np.bool_], clip: bool) -> FloatArray:
    """Angles wrap, rho is reflected into `RHO_RANGE`, or all are clipped; what lies inside keeps its bits."""
    angles = genes[..., :RHO]
    if clip:
        genes[..., :RHO] = np.clip(angles, -math.pi, math.pi)
        genes[..., RHO] = np.where(real[..., 0], np.clip(genes[..., RHO], *RHO_RANGE), genes[..., RHO])
        return genes
    wrapped = np.remainder(angles + math.pi, 2.0 * math.pi) - math.pi
    genes[..., :RHO] = np.where(np.abs(angles) > math.pi, wrapped, angles)
    rho = genes[..., RHO]
    low, high = RHO_RANGE
    span = high - low
    folded = np.remainder(rho - low, 2.0 * span)
    folded = low + np.where(folded > span, 2.0 * span - folded, folded)
    outside = ((rho < low) | (rho > high)) & real[..., 0]
    genes[..., RHO] = np.where(outside, np.clip(folded, low, high), rho)
    return genes


def _repair_affine(genes: FloatArray, n_maps: IntArray, clip: bool) -> FloatArray:
    """A matrix whose spectral norm left `RHO_RANGE` is scaled so that the norm is reflected into it, or clipped."""
    low, high = RHO_RANGE
    span = high - low
    for slot, count in enumerate(n_maps.tolist()):
        for row in genes[slot, :count]:
            matrix = row.reshape(3, 4)[:, :3]
            norm = largest_singular_value(*matrix.ravel().tolist())
            if not low <= norm <= high:
                folded = math.fmod(abs(norm - low), 2.0 * span)
                target = norm if clip else low + (2.0 * span - folded if folded > span else folded)
                matrix *= min(max(target, low), high) / norm if norm > 0.0 else 0.0
                if norm == 0.0:
                    matrix[:] = low * np.eye(3)
    return genes
