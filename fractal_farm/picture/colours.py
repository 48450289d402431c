"""The paper's two colourings of a point by its place, and what makes them show on a dark ground.

Linear gradient: C = (x, y, z) / range. Dual tone: C = C1 - C2 (x, y, z) / range. x, y and z are measured from the
lowest corner of the cloud's box, so that they run over the whole colour cube.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError

Colour = tuple[float, float, float]
FloatArray = npt.NDArray[np.float64]

FIRST_TONE: Colour = (1.0, 0.88, 0.52)
SECOND_TONE: Colour = (0.35, 0.72, 0.22)
LEAST_VALUE = 0.5
_GREY = 0.12


def linear_gradient(points: npt.ArrayLike) -> FloatArray:
    """C = (x, y, z) / range.

    Args:
        points: (n, 3).

    Returns:
        (n, 3) float64 red, green, blue in [0, 1]; 0 along an axis without extent.
    """
    # Reductions along rows of three are slow; columns are worked on instead.
    columns = np.ascontiguousarray(np.asarray(points, dtype=np.float64).T)
    extent = np.ptp(columns, axis=1, keepdims=True)
    colours: FloatArray = ((columns - columns.min(axis=1, keepdims=True)) / np.where(extent > 0.0, extent, 1.0)).T
    return colours


def dual_tone(points: npt.ArrayLike, first: Colour = FIRST_TONE, second: Colour = SECOND_TONE) -> FloatArray:
    """C = C1 - C2 (x, y, z) / range, cut off at 0 and 1.

    Args:
        points: (n, 3).
        first: C1, red, green, blue in [0, 1].
        second: C2, the same.

    Returns:
        (n, 3) float64 red, green, blue in [0, 1].
    """
    colours: FloatArray = np.clip(np.asarray(first) - np.asarray(second) * linear_gradient(points), 0.0, 1.0)
    return colours


def coloured(points: npt.ArrayLike, colouring: str) -> FloatArray:
    """One of the two colourings by name; raises InputError for another name."""
    painters = {"gradient": linear_gradient, "dual": dual_tone}
    if colouring not in painters:
        raise InputError(f"colouring is {colouring!r}; choose one of {', '.join(painters)}")
    return painters[colouring](points)


def legible(colours: FloatArray) -> FloatArray:
    """The colours, (n, 3), with the dark ones brightened in their own hue, so that none sinks into a dark ground."""
    value = colours.max(axis=1, keepdims=True)
    wanted = LEAST_VALUE + (1.0 - LEAST_VALUE) * value
    # Black has no hue: what little is added makes it grey.
    brightened: FloatArray = (colours + _GREY) * (wanted / (value + _GREY))
    return brightened
