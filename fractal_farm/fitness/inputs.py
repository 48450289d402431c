"""The edge of `evaluation`: whatever callers pass in becomes arrays of sound shape and type, or an `InputError`.

Numbers within genomes are not judged here: the kernel refuses what does not contract, with a code.
"""

from __future__ import annotations

import operator

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.fitness.points import real_table
from fractal_farm.ifs.genome import MAX_MAPS, ROW_LENGTH, Genome, check_probabilities
from fractal_farm.ifs.symmetry import SYMMETRIES, symmetry_code

FloatArray = npt.NDArray[np.float64]


def as_typed(value: Genome | npt.ArrayLike, name: str) -> Genome:
    """A genome of a sound shape; its numbers are judged by the kernel, which refuses instead of raising."""
    if not isinstance(value, Genome):
        value = Genome(real_table(value, f"{name}: not a table of numbers; give N rows of 7 genes"))
    width = ROW_LENGTH[value.phenotype.family]
    shape = value.genes.shape
    if len(shape) != 2 or shape[1] != width or not 1 <= shape[0] <= MAX_MAPS:
        family = value.phenotype.family
        raise InputError(f"{name}: shape {shape}; a {family} genome has 1 to {MAX_MAPS} rows of {width} numbers")
    if value.probabilities is not None:
        check_probabilities(value.probabilities, value.n_maps, name)
    symmetry_code(value.symmetry, name)
    return value


def whole_number(name: str, value: int, least: int, most: int | None = None) -> int:
    """The value as an int from `least` to `most`; `name` is what a complaint calls it."""
    try:
        number = operator.index(value)
    except TypeError:
        raise InputError(f"{name} is {value!r}; give a whole number") from None
    if number < least or (most is not None and number > most):
        raise InputError(f"{name} is {number}; it must be at least {least}" + (f", at most {most}" if most else ""))
    return number


def checked_batch(genes: FloatArray, n_maps: npt.ArrayLike, width: int) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Copies of sound shape and type; read-only arrays would be compiled for again."""
    genes = np.array(real_table(genes, f"genes: not numbers; give (B, M, {width})"), order="C")
    if genes.ndim != 3 or genes.shape[2] != width or not 1 <= genes.shape[1] <= MAX_MAPS:
        raise InputError(f"genes: shape {genes.shape}; give (B, M, {width}) with M from 1 to {MAX_MAPS}")
    counts = np.array(n_maps)
    whole = np.issubdtype(counts.dtype, np.integer) and counts.shape == genes.shape[:1]
    if (not whole and len(genes)) or not ((counts >= 1) & (counts <= genes.shape[1])).all():
        raise InputError(f"n_maps: give {len(genes)} whole numbers from 1 to {genes.shape[1]}")
    return genes, counts.astype(np.int64)


def checked_probabilities(probabilities: npt.ArrayLike, genes: FloatArray, n_maps: npt.NDArray[np.int64]) -> FloatArray:
    """Probabilities (B, M) of sound shape, those of each genome sound or left to the rule."""
    by_hand = np.array(real_table(probabilities, "probabilities: not numbers"), order="C")
    if by_hand.shape != genes.shape[:2]:
        raise InputError(f"probabilities: shape {by_hand.shape}; give {genes.shape[:2]}")
    for b in np.flatnonzero(~(by_hand[:, 0] < 0.0)).tolist():
        count = int(n_maps[b])
        check_probabilities(tuple(by_hand[b, :count].tolist()), count, f"probabilities: genome {b}")
    return by_hand


def checked_symmetries(symmetries: npt.ArrayLike | None, count: int) -> npt.NDArray[np.uint8]:
    """Codes of symmetries (count,), all 0 for None."""
    if symmetries is None:
        return np.zeros(count, np.uint8)
    codes = np.array(symmetries)
    if codes.shape != (count,) or codes.dtype.kind not in "iu" or not ((codes >= 0) & (codes < len(SYMMETRIES))).all():
        raise InputError(f"symmetries: give {count} codes from 0 to {len(SYMMETRIES) - 1}")
    return codes.astype(np.uint8)
