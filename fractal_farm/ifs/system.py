"""From the rows of a genome to everything that iteration needs, in compiled code (eqs 2.1, 3.2 to 3.4 in NOTES).

`build_system` puts rows into canonical order, checks them, and fills a `System`: resolved maps, floored probabilities
with integer thresholds, a starting point on the attractor and the content keys of the random stream. A `System` is
allocated once and filled for one genome after the other.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.genome import MAX_MAPS, Phenotype, Refusal
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.linear_algebra import determinant, largest_singular_value
from fractal_farm.ifs.symmetry import MAX_COPIES

# Constants of a 32-bit mixer of low bias (Wellons' hash prospecting), shared with the random iteration.
FIRST_SHIFT = np.uint32(16)
NEXT_SHIFT = np.uint32(15)
FIRST_FACTOR = np.uint32(0x21F0AAAD)
NEXT_FACTOR = np.uint32(0x735A2D97)
INCREMENT = np.uint32(0x9E3779B9)  # 2^32 over the golden ratio: a counter visits all words
_FIRST_SEED = np.uint32(0x8F1BBCDC)
_SECOND_SEED = np.uint32(0xCA62C1D6)
_WORDS = 2.0**32  # number of 32-bit words
_NOT_FINITE = int(Refusal.NOT_FINITE)
_NOT_A_CONTRACTION = int(Refusal.NOT_A_CONTRACTION)
_determinant = kernel(determinant)
_largest_singular_value = kernel(largest_singular_value)


class System(NamedTuple):
    """Working space for one genome; the first n_maps entries of each array count.

    Attributes:
        rows: (MAX_MAPS, 12) float64, genes in canonical order.
        words: (MAX_MAPS, 24) uint32, the same memory as `rows`.
        order: (MAX_MAPS,) int64, order[i] is the stored row that canonical row i came from.
        maps: (MAX_MAPS, 12) float64, row-major 3 x 4 affine maps.
        probabilities: (MAX_MAPS,) float64, floored selection probabilities.
        thresholds: (MAX_MAPS,) uint32, cumulative probabilities times 2^32; the last one is never consulted.
        start: (3,) float64, the fixed point of the most probable map: a point of the attractor.
        keys: (2,) uint32, content hash of the genome.
        copies: (MAX_COPIES, 12) float64, isometries that make the shape out of the attractor, the identity first; see
            `copies.place_copies`.
        n_copies: (1,) int64, how many of them count.
    """

    rows: npt.NDArray[np.float64]
    words: npt.NDArray[np.uint32]
    order: npt.NDArray[np.int64]
    maps: npt.NDArray[np.float64]
    probabilities: npt.NDArray[np.float64]
    thresholds: npt.NDArray[np.uint32]
    start: npt.NDArray[np.float64]
    keys: npt.NDArray[np.uint32]
    copies: npt.NDArray[np.float64]
    n_copies: npt.NDArray[np.int64]


class Reading(NamedTuple):
    """A `Phenotype` in the plain numbers that kernels take."""

    affine: bool
    offset_inside: bool
    rotation_sign: float
    influence: float


def reading_of(phenotype: Phenotype) -> Reading:
    """The phenotype as plain numbers."""
    return Reading(
        phenotype.family == "affine",
        phenotype.map_form == "rho R (x + d)",
        float(phenotype.rotation_sign),
        float(phenotype.influence),
    )


def new_system() -> System:
    """An empty working space."""
    rows = np.zeros((MAX_MAPS, 12))
    copies = np.zeros((MAX_COPIES, 12))
    copies[0, [0, 5, 10]] = 1.0
    return System(
        rows,
        rows.view(np.uint32),
        np.zeros(MAX_MAPS, np.int64),
        np.zeros((MAX_MAPS, 12)),
        np.zeros(MAX_MAPS),
        np.zeros(MAX_MAPS, np.uint32),
        np.zeros(3),
        np.zeros(2, np.uint32),
        copies,
        np.ones(1, np.int64),
    )


@kernel
def build_system(genes, n_maps, reading, by_hand, system):  # type: ignore[no-untyped-def]
    """Fill `system` from one genome.

    Args:
        genes: (M, K) float64, the first n_maps rows count; K is 7, or 12 for the affine family.
        n_maps: number of maps.
        reading: `Reading` of the phenotype.
        by_hand: (M,) float64 probabilities set by hand in stored row order; by_hand[0] < 0 for none.
        system: `System` to fill.

    Returns:
        A `Refusal` code; other than NONE leaves `system` unfit for use.
    """
    columns = 12 if reading.affine else 7
    for i in range(n_maps):
        for j in range(columns):
            if not math.isfinite(genes[i, j]):
                return _NOT_FINITE
    _canonical_order(genes, n_maps, columns, system)
    for i in range(n_maps):
        row = system.rows[i]
        if reading.affine:
            norm = _largest_singular_value(row[0], row[1], row[2], row[4], row[5], row[6], row[8], row[9], row[10])
            if not 0.0 < norm < 1.0:
                return _NOT_A_CONTRACTION
            system.maps[i, :] = row
        else:
            if not 0.0 < row[3] < 1.0:
                return _NOT_A_CONTRACTION
            resolve_similarity(row, reading.offset_inside, reading.rotation_sign, system.maps[i])
    if by_hand[0] >= 0.0:
        for i in range(n_maps):
            system.probabilities[i] = by_hand[system.order[i]]
    else:
        floored_probabilities(system.maps, n_maps, reading.influence, system.probabilities)
    cumulative = 0.0
    likeliest = 0
    for i in range(n_maps):
        cumulative += system.probabilities[i]
        system.thresholds[i] = np.uint32(min(cumulative * _WORDS, _WORDS - 1.0))
        if system.probabilities[i] > system.probabilities[likeliest]:
            likeliest = i
    fixed_point(system.maps[likeliest], system.start)
    _content_keys(system.words, n_maps, columns, system.keys)
    return 0


@kernel
def resolve_similarity(gene, offset_inside, rotation_sign, out):  # type: ignore[no-untyped-def]
    """Eq 3.2: out (12,) row-major [rho R | rho R d] (or [rho R | d]), R = R_z(roll) R_x(pitch) R_y(yaw)."""
    pitch = rotation_sign * gene[0]
    yaw = rotation_sign * gene[1]
    roll = rotation_sign * gene[2]
    rho = gene[3]
    cp = math.cos(pitch)
    sp = math.sin(pitch)
    cy = math.cos(yaw)
    sy = math.sin(yaw)
    cr = math.cos(roll)
    sr = math.sin(roll)
    out[0] = rho * (cr * cy - sr * sp * sy)
    out[1] = rho * (-sr * cp)
    out[2] = rho * (cr * sy + sr * sp * cy)
    out[4] = rho * (sr * cy + cr * sp * sy)
    out[5] = rho * (cr * cp)
    out[6] = rho * (sr * sy - cr * sp * cy)
    out[8] = rho * (-cp * sy)
    out[9] = rho * sp
    out[10] = rho * (cp * cy)
    for k in range(3):
        if offset_inside:
            out[4 * k + 3] = out[4 * k] * gene[4] + out[4 * k + 1] * gene[5] + out[4 * k + 2] * gene[6]
        else:
            out[4 * k + 3] = gene[4 + k]


@kernel
def floored_probabilities(maps, n_maps, influence, out):  # type: ignore[no-untyped-def]
    """Eqs 3.3 and 3.4: P_i proportional to |det A_i|, at least 1 / (influence N).

    The largest (the first if equal) gives what was added to the others; should that take it below the floor, which
    needs an influence near 1, the next largest gives the rest.

    Args:
        maps: (M, 12) float64 maps in canonical order.
        n_maps: number of maps that count.
        influence: alpha >= 1.
        out: (M,) float64, filled.
    """
    total = 0.0
    for i in range(n_maps):
        m = maps[i]
        out[i] = abs(_determinant(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]))
        total += out[i]
    floor = 1.0 / (influence * n_maps)
    debt = 0.0
    for i in range(n_maps):
        out[i] = out[i] / total if total > 0.0 else 1.0 / n_maps
        if out[i] < floor:
            debt += floor - out[i]
            out[i] = floor
    for _ in range(n_maps):
        largest = 0
        for i in range(1, n_maps):
            if out[i] > out[largest]:
                largest = i
        payment = min(debt, out[largest] - floor)
        out[largest] -= payment
        debt -= payment


@kernel
def _canonical_order(genes, n_maps, columns, system):  # type: ignore[no-untyped-def]
    """Insertion sort of the rows, lexicographic; adding 0.0 turns -0.0 into 0.0."""
    for i in range(n_maps):
        place = i
        while place > 0:
            before = False
            for j in range(columns):
                left = system.rows[place - 1, j]
                right = genes[i, j] + 0.0
                if right != left:
                    before = right < left
                    break
            if not before:
                break
            for j in range(columns):
                system.rows[place, j] = system.rows[place - 1, j]
            system.order[place] = system.order[place - 1]
            place -= 1
        for j in range(columns):
            system.rows[place, j] = genes[i, j] + 0.0
        system.order[place] = i


@kernel
def fixed_point(m, out):  # type: ignore[no-untyped-def]
    """Solve (I - A) x = b by Cramer's rule into out (3,); I - A is regular because A of m (12,) contracts."""
    a00 = 1.0 - m[0]
    a11 = 1.0 - m[5]
    a22 = 1.0 - m[10]
    whole = _determinant(a00, -m[1], -m[2], -m[4], a11, -m[6], -m[8], -m[9], a22)
    out[0] = _determinant(m[3], -m[1], -m[2], m[7], a11, -m[6], m[11], -m[9], a22) / whole
    out[1] = _determinant(a00, m[3], -m[2], -m[4], m[7], -m[6], -m[8], m[11], a22) / whole
    out[2] = _determinant(a00, -m[1], m[3], -m[4], a11, m[7], -m[8], -m[9], m[11]) / whole


@kernel
def _content_keys(words, n_maps, columns, out):  # type: ignore[no-untyped-def]
    """Two 32-bit hashes of the canonical rows, word by word, in 32-bit operations that a browser has too."""
    first = _FIRST_SEED
    second = _SECOND_SEED
    for i in range(n_maps):
        for j in range(2 * columns):
            first = scramble(first ^ words[i, j])
            second = scramble(second + words[i, j])
    out[0] = first
    out[1] = second


@kernel(inline="always")
def scramble(x):  # type: ignore[no-untyped-def]
    """A bijective 32-bit mixer."""
    x = np.uint32(x)
    x ^= x >> FIRST_SHIFT
    x = np.uint32(x * FIRST_FACTOR)
    x ^= x >> NEXT_SHIFT
    x = np.uint32(x * NEXT_FACTOR)
    return np.uint32(x ^ (x >> NEXT_SHIFT))
