"""Distances to a level of a voxel field, finer than a voxel, and the closing of a solid that they allow.

The exact Euclidean feature transform (scipy) names the nearest sample beyond the level; what samples there lie beyond
it is taken off the distance, so that surfaces that were moved out and back in again have no steps.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from fractal_farm.ifs.kernel import kernel

_NEAR = 2.0  # voxels from the surface in which it is told finely

Field = npt.NDArray[np.float32]


def close_slits(field: Field, radius: float, least: float = 0.0) -> None:
    """Morphological closing by a ball, in place: what no ball of `radius` outside of the solid reaches joins it.

    Nothing is taken away, and the box does not grow: a closing stays within the convex hull. A hole hardly narrower
    than the ball would be closed by a film; what is too thin for a ball of `least` does not join.

    Args:
        field: (nx, ny, nz) float32, signed distance in voxels, negative inside, exact up to `radius` + 1 outside.
        radius: voxels, above 0.
        least: voxels; 0: whatever its thickness.
    """
    before = field.copy() if least else field
    depth = distance_to(field, radius, radius + _NEAR)
    np.subtract(np.float32(radius), depth, out=depth)
    # Beyond the reach of the ball nothing changes.
    np.minimum(field, depth, out=field, where=field < radius)
    if least:
        del depth
        np.minimum(before, opened(field, least), out=field)


def opened(field: Field, radius: float) -> Field:
    """Morphological opening by a ball: of a solid, what a ball of `radius` inside of it reaches.

    Args:
        field: (nx, ny, nz) float32, signed distance in voxels, negative inside; exact near the surface.
        radius: voxels, above 0.

    Returns:
        (nx, ny, nz) float32, signed distance in voxels, exact near the surface.
    """
    depth = distance_to(field, 0.0, radius + _NEAR)
    out = distance_to(depth, radius, radius + _NEAR)
    out -= np.float32(radius)
    return np.maximum(out, field, out=out)


def distance_to(field: Field, level: float, reach: float = math.inf) -> Field:
    """How far each sample below a level is from where the field reaches it, in voxels; 0 for the others.

    Args:
        field: (nx, ny, nz) float32, that grows by about 1 a voxel near the level.
        level: somewhere above it.
        reach: distances up to which a fraction of a voxel matters; those beyond may be up to 1 too large.

    Returns:
        (nx, ny, nz) float32.
    """
    below = field < level
    nearest = ndimage.distance_transform_edt(below, return_distances=False, return_indices=True)
    out = np.zeros(field.shape, np.float32)
    _measure(nearest, field, level, reach, out)
    return out


@kernel
def _measure(nearest, field, level, reach, out):  # type: ignore[no-untyped-def]
    """Distances from the indices (3, nx, ny, nz) of the nearest samples beyond the level.

    A sample q that lies b beyond the level bounds the distance of p from above by |pq| - b, closely if q lies straight
    outwards. The least of these bounds is taken, over the nearest sample and those around it.
    """
    width, depth, height = out.shape
    for i in range(width):
        for j in range(depth):
            for k in range(height):
                if field[i, j, k] >= level:
                    continue
                x, y, z = nearest[0, i, j, k], nearest[1, i, j, k], nearest[2, i, j, k]
                least = math.sqrt((x - i) * (x - i) + (y - j) * (y - j) + (z - k) * (z - k))
                if least > reach + 1.0:
                    out[i, j, k] = least
                    continue
                for a in range(max(x - 1, 0), min(x + 2, width)):
                    for b in range(max(y - 1, 0), min(y + 2, depth)):
                        for c in range(max(z - 1, 0), min(z + 2, height)):
                            beyond = field[a, b, c] - level
                            if beyond >= 0.0:
                                square = (a - i) * (a - i) + (b - j) * (b - j) + (c - k) * (c - k)
                                least = min(least, math.sqrt(square) - beyond)
                out[i, j, k] = max(least, level - field[i, j, k], 0.0)
