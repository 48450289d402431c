"""Designs as rows of a structured array: the currency of libraries, migration and the catalogue.

One row is one genome with its scores, birth place and lineage. Rows of a run share one dtype (`design_dtype`), so
selecting, joining, sending and storing them are plain array operations.
"""

from __future__ import annotations

import enum
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.distinctness import DESCRIPTOR_LENGTH, LENGTH
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.symmetry import SYMMETRIES

Designs = npt.NDArray[Any]
ESTIMATES = ("grams", "width_mm", "depth_mm")
SCORE_FIELDS = ("d0", "d2", "lle", "fitness", "d0_error", "d2_error", "gap", *ESTIMATES)


class Operator(enum.IntEnum):
    """How a genome came to be."""

    RANDOM = 0
    SEED = 1
    COPY = 2
    CROSSOVER = 3
    MUTATION = 4
    CROSSOVER_MUTATION = 5
    SYMMETRY = 6
    CROSSOVER_SYMMETRY = 7
    MUTATION_SYMMETRY = 8
    CROSSOVER_MUTATION_SYMMETRY = 9


def design_dtype(max_maps: int, row_length: int) -> np.dtype[Any]:
    """The dtype of a run's design rows.

    Args:
        max_maps: largest number of maps of any genome in the run; fewer are padded with rows of 0.
        row_length: numbers in a row of a genome (7, or 12 for the affine family).

    Returns:
        Structured dtype. `design_id` and `parents` are 32 hex digits as bytes (empty: no parent); `genes` is
        (max_maps, row_length) float64; symmetry is a code of `ifs.symmetry`; scores are float64, and nan where they
        were not asked for, as the descriptor is; foreseen is the signature that was expected before the evaluation, nan
        where none was; hits counts near-duplicates of a member of an archive; distinct says that none was nearer among
        those that the whole run had found before; the birth place is island, epoch, generation, slot.
    """
    return np.dtype(
        [
            ("design_id", "S32"),
            ("genes", "<f8", (max_maps, row_length)),
            ("n_maps", "<i4"),
            ("symmetry", "<i4"),  # together as many bytes as n_maps had in records before there were symmetries
            *((name, "<f8") for name in SCORE_FIELDS),
            ("descriptor", "<f4", (DESCRIPTOR_LENGTH,)),
            ("foreseen", "<f4", (LENGTH,)),
            ("hits", "<i4"),
            ("distinct", "?"),
            ("parents", "S32", (2,)),
            ("operator", "u1"),
            ("island", "<i4"),
            ("epoch", "<i4"),
            ("generation", "<i4"),
            ("slot", "<i4"),
        ]
    )


def genomes_of(rows: Designs, phenotype: Phenotype) -> list[Genome]:
    """The genomes of design rows."""
    return unpadded(rows["genes"], rows["n_maps"], rows["symmetry"], phenotype)


def unpadded(
    genes: npt.NDArray[np.float64], n_maps: npt.NDArray[Any], symmetries: npt.NDArray[Any], phenotype: Phenotype
) -> list[Genome]:
    """The genomes of which these are the genes (B, M, K), padded with rows of 0, maps (B,) and symmetries (B,)."""
    return [
        Genome(rows[:count], phenotype, symmetry=SYMMETRIES[code].name)
        for rows, count, code in zip(genes, n_maps.tolist(), symmetries.tolist(), strict=True)
    ]


def total_order(designs: Designs) -> npt.NDArray[np.intp]:
    """Indices that sort designs by (-fitness, island, generation, slot): the one order used for every decision."""
    return np.lexsort((designs["slot"], designs["generation"], designs["island"], -designs["fitness"]))


def without_repeats(designs: Designs, known: Designs) -> Designs:
    """The designs whose identity is neither in `known` nor earlier in `designs`, in their order."""
    return unseen(designs, set(known["design_id"].tolist()))


def unseen(designs: Designs, seen: set[bytes]) -> Designs:
    """The designs whose identity is neither in `seen` nor earlier in `designs`, in their order; now they are seen."""
    keep = []
    for index, identity in enumerate(designs["design_id"].tolist()):
        if identity not in seen:
            seen.add(identity)
            keep.append(index)
    return designs[keep]
