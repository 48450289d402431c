"""Where to look from: along the axis of least variance, tilted a little, turned so that the shape fills the frame."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

TILT = math.radians(16.0)
_SAMPLE = 1_500
_TURNS = 30
_WORTH_A_TURN = 0.9


def choose_view(points: npt.ArrayLike) -> FloatArray:
    """A good direction to look at a cloud.

    Args:
        points: (n, 3).

    Returns:
        (3, 3) float64 rotation; its rows are right, up and towards the viewer in the coordinates of the points. Long
        shapes lie in the diagonal, others stand upright on their heavier end.
    """
    places = np.asarray(points, dtype=np.float64)
    sample = places[:: max(1, len(places) // _SAMPLE)]
    centred = sample - 0.5 * (sample.min(axis=0) + sample.max(axis=0))
    _, axes = np.linalg.eigh(np.cov(centred.T, ddof=0))
    up, right = axes[:, 2], axes[:, 1]
    view = np.stack([right, up, np.cross(right, up)])
    if (centred @ view[2]).mean() < 0.0:
        view = np.stack([-right, up, -view[2]])
    if (centred @ up).mean() > 0.0:
        view = turned(view, math.pi)
    view = tilted(view)
    return turned(view, _filling_turn(centred @ view[:2].T))


def tilted(view: FloatArray, angle: float = TILT) -> FloatArray:
    """The same view from further above by `angle`."""
    c, s = math.cos(angle), math.sin(angle)
    steeper: FloatArray = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]]) @ view
    return steeper


def turned(view: FloatArray, angle: float) -> FloatArray:
    """The view turned about the line of sight: what is seen turns counter-clockwise."""
    c, s = math.cos(angle), math.sin(angle)
    other: FloatArray = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ view
    return other


def _filling_turn(flat: FloatArray) -> float:
    """The turn within a right angle that makes a flat cloud (n, 2) largest in a square, or 0 if it gains little."""
    angles = np.linspace(-math.pi / 4.0, math.pi / 4.0, _TURNS + 1)
    c, s = np.cos(angles), np.sin(angles)
    x, y = flat[:, :1], flat[:, 1:]
    extents = np.maximum(np.ptp(c * x - s * y, axis=0), np.ptp(s * x + c * y, axis=0))
    best = int(np.argmin(extents))
    return float(angles[best]) if extents[best] < _WORTH_A_TURN * extents[_TURNS // 2] else 0.0
