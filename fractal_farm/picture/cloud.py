"""A cloud of points as a picture (DESIGN section 7)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.picture.colours import Colour, coloured
from fractal_farm.picture.ground import backdrop
from fractal_farm.picture.splat import SUPERSAMPLE, draw_points
from fractal_farm.picture.view import choose_view

MARGIN = 0.06
SHADING = 1.6
FOG = 0.35
MAX_SIZE = 8192
_COVERAGE = 0.1
_LARGEST_DISC = 8.0


def cloud_picture(
    points: npt.ArrayLike,
    size: int = 256,
    colours: str | npt.ArrayLike = "gradient",
    *,
    view: npt.ArrayLike | None = None,
    ground: Colour | None = None,
    point_radius: float | None = None,
    extent: float | None = None,
) -> npt.NDArray[np.uint8]:
    """Draw a cloud, with depth.

    Args:
        points: (n, 3), at least one.
        size: width and height, pixels, 16 to 8192.
        colours: "gradient" or "dual", the two of the paper, or (n, 3) red, green, blue in [0, 1].
        view: (3, 3) rotation, rows right, up and towards the viewer; chosen by `choose_view` if None.
        ground: colour behind the cloud in [0, 1]; dark with a soft light if None.
        point_radius: radius at which points are drawn, in their own unit; by their number if None.
        extent: how much the picture has room for, in the points' unit, so that several have one scale; the width or
            height of the cloud as seen if None.

    Returns:
        (size, size, 3) uint8.

    Raises:
        InputError: points or colours of another shape, not finite, a size out of range or an unknown colouring.
    """
    places = np.asarray(points, dtype=np.float64)
    if places.ndim != 2 or places.shape[1] != 3 or len(places) == 0 or not np.isfinite(places).all():
        raise InputError(f"points of shape {places.shape}; give (n, 3) finite numbers, n at least 1")
    if not 16 <= size <= MAX_SIZE:
        raise InputError(f"size is {size}; give 16 to {MAX_SIZE} pixels")
    painted = coloured(places, colours) if isinstance(colours, str) else np.asarray(colours, dtype=np.float64)
    if painted.shape != places.shape:
        raise InputError(f"colours of shape {painted.shape}; give {places.shape}, a colour for each point")
    rotation = choose_view(places) if view is None else np.asarray(view, dtype=np.float64)
    seen, scale = framed(rotation @ places.T, size, extent)
    by_number = math.sqrt(_COVERAGE / len(places)) * size * SUPERSAMPLE
    disc = min(max(by_number if point_radius is None else point_radius * scale, 1.0), _LARGEST_DISC)
    picture = backdrop(size, ground)
    draw_points(seen, np.ascontiguousarray(painted, dtype=np.float32), disc, SHADING, FOG, picture)
    return to_bytes(picture)


def framed(
    seen: npt.NDArray[np.float64], size: int, extent: float | None = None
) -> tuple[npt.NDArray[np.float32], float]:
    """Points as seen, (3, n), in a square picture: (n, 3) in subpixels, y downwards; and subpixels a unit.

    They stand in its middle and fit into it, or it has room for `extent`, at least theirs.
    """
    low, high = seen.min(axis=1), seen.max(axis=1)
    own = float((high - low)[:2].max())
    return placed(seen, 0.5 * (low + high), own if extent is None else max(extent, own), size)


def placed(
    seen: npt.NDArray[np.float64], centre: npt.NDArray[np.float64], extent: float, size: int
) -> tuple[npt.NDArray[np.float32], float]:
    """As `framed`, for a picture whose middle is `centre` (3,) and that has room for `extent`."""
    side = size * SUPERSAMPLE
    scale = side * (1.0 - 2.0 * MARGIN) / extent if extent > 0.0 else 1.0
    stretch = np.array([[scale], [-scale], [scale]])
    moved = (seen - centre[:, None]) * stretch + np.array([[0.5 * side], [0.5 * side], [0.0]])
    return np.ascontiguousarray(moved.T, dtype=np.float32), scale


def to_bytes(picture: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    """Values in [0, 1] as bytes."""
    return (np.clip(picture, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
