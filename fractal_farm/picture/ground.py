"""What lies behind a shape."""

from __future__ import annotations

import functools

import numpy as np
import numpy.typing as npt

from fractal_farm.picture.colours import Colour

NIGHT: Colour = (0.052, 0.056, 0.072)
_GLOW = 0.042
_TINT = np.array([0.9, 0.95, 1.15], np.float32)


def backdrop(size: int, ground: Colour | None = None) -> npt.NDArray[np.float32]:
    """(size, size, 3) float32 in [0, 1]: an even colour, or by default night with a soft light in its middle."""
    return _painted(size, ground).copy()


@functools.lru_cache(maxsize=4)
def _painted(size: int, ground: Colour | None) -> npt.NDArray[np.float32]:
    if ground is not None:
        return np.full((size, size, 3), ground, np.float32)
    steps = np.linspace(-1.0, 1.0, size, dtype=np.float32)
    away = steps[None, :] ** 2 + steps[:, None] ** 2
    # The light fades out before the border, so that tiles of a sheet join without an edge.
    glow = _GLOW * np.maximum(1.0 - away, 0.0) ** 2
    painted: npt.NDArray[np.float32] = np.array(NIGHT, np.float32) + glow[..., None] * _TINT
    return painted
