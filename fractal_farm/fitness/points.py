"""The edge where points come in: any (n, 3) array becomes the (3, n) working copy that the kernels take."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError


def as_cloud(points: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """A validated copy of a cloud, one coordinate after the other.

    Args:
        points: (n, 3) real array, n >= 2, finite.

    Returns:
        (3, n) float64, C-contiguous and writable.

    Raises:
        InputError: not numbers, another shape, fewer than two points, or a coordinate that is not finite.
    """
    table = real_table(points, "points: not a table of numbers; give an (n, 3) array")
    if table.ndim != 2 or table.shape[1] != 3 or table.shape[0] < 2:
        raise InputError(f"points: shape {table.shape}; give an (n, 3) array of at least 2 points")
    if not np.isfinite(table).all():
        row = int(np.argmin(np.isfinite(table).all(axis=1)))
        raise InputError(f"points: row {row} is {table[row].tolist()}; every coordinate must be a finite number")
    return np.array(table.T, order="C")


def real_table(values: npt.ArrayLike, complaint: str) -> npt.NDArray[np.float64]:
    """Values as float64, of any shape; an `InputError` with this complaint if they are not real numbers."""
    try:
        table = np.asarray(values)
        if table.dtype.kind in "biuf" or not table.size:
            return np.asarray(table, np.float64)
    except (TypeError, ValueError):
        pass
    raise InputError(complaint)
