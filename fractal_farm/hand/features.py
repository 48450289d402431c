"""What a preference model sees of a design: seventeen numbers that do not depend on its place, size or orientation."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.distinctness import DESCRIPTOR_LENGTH, signatures

FloatArray = npt.NDArray[np.float64]

COLUMNS = ("design_id", "fitness", "n_maps", "d0", "d2", "lle", "gap", "similarity_dimension", "descriptor", "maps")
"""Columns of the manifest that `features_of` reads, and the identity."""

NAMED = (
    "fitness",
    "number of maps",
    "D0",
    "D2",
    "LLE",
    "gap",
    "similarity dimension",
    "smallest ratio",
    "largest ratio",
    "thickness",
    "breadth",
)
"""The first features: the smallest and middle principal deviation, over the largest, are thickness and breadth."""

_SMALLEST_GAP = 1e-4


def features_of(designs: Any) -> FloatArray:
    """Features of designs.

    Args:
        designs: table with `COLUMNS`.

    Returns:
        (n, 17) float64: those of `NAMED` (of the gap the decimal logarithm), then the signature of `distinctness`; nan
        where the manifest has no number.
    """
    descriptors = np.full((designs.num_rows, DESCRIPTOR_LENGTH), np.nan)
    known = designs.column("descriptor").is_valid().to_numpy()
    flat = designs.column("descriptor").drop_null().combine_chunks().flatten()
    descriptors[known] = np.asarray(flat, np.float64).reshape(-1, DESCRIPTOR_LENGTH)
    numbers = {
        name: np.asarray(designs.column(name).to_numpy(), np.float64)
        for name in ("fitness", "n_maps", "d0", "d2", "lle", "gap", "similarity_dimension")
    }
    ratios = _ratios(designs)
    return np.column_stack(
        [
            numbers["fitness"],
            numbers["n_maps"],
            numbers["d0"],
            numbers["d2"],
            numbers["lle"],
            np.log10(np.maximum(numbers["gap"], _SMALLEST_GAP)),
            numbers["similarity_dimension"],
            ratios,
            descriptors[:, -2:],
            signatures(descriptors, numbers["d0"], numbers["d2"]),
        ]
    )


def _ratios(designs: Any) -> FloatArray:
    """(n, 2): the smallest and the largest contraction ratio, the cube root of |det A|."""
    lengths = designs.column("maps").combine_chunks().value_lengths().to_numpy(zero_copy_only=False)
    flat = np.asarray(designs.column("maps").combine_chunks().flatten(), np.float64)
    first = np.repeat(np.cumsum(lengths) - lengths, lengths // 12) // 12
    volumes = np.abs(np.linalg.det(flat.reshape(-1, 3, 4)[:, :, :3]))
    starts = np.unique(first)
    ratios: FloatArray = np.cbrt(
        np.column_stack([np.minimum.reduceat(volumes, starts), np.maximum.reduceat(volumes, starts)])
    )
    return ratios
