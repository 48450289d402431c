"""Pictures of point clouds: splats with depth, the paper's two colourings, and eye-dome lighting.

Points are drawn on a grid four times as fine as the picture, the nearest one wins; then each cell is darkened by how
far its neighbours stand in front of it (eye-dome lighting, Boucheny 2009), which shows depth without normals, and
2 x 2 cells make one pixel.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.ifs.kernel import kernel

FloatArray = npt.NDArray[np.float64]
Colour = tuple[float, float, float]

GROUND: Colour = (0.055, 0.06, 0.075)
_OVERSAMPLING = 2
_FRAME = 0.9
_FRAMED = (0.0015, 0.9985)
_TILT = math.radians(24.0)
_TURN = math.radians(32.0)
# Keeps the dark corner of the gradient apart from the ground.
_FLOOR = 0.16
_WORTH_A_ROLL = 0.85
_EMPTY = -np.inf


def cloud_picture(
    points: npt.ArrayLike,
    size: int = 256,
    colours: npt.ArrayLike | None = None,
    view: npt.ArrayLike | None = None,
    ground: Colour = GROUND,
) -> npt.NDArray[np.uint8]:
    """Draw a cloud.

    Args:
        points: (n, 3) numbers, IFS units.
        size: width and height, pixels, 16 .. 4096.
        colours: (n, 3) RGB in [0, 1]; `linear_gradient` of the points if None.
        view: (3, 3) rotation, rows right, up and towards the viewer; `best_view` of the points if None.
        ground: RGB of the background in [0, 1].

    Returns:
        (size, size, 3) uint8.

    Raises:
        InputError: points of another shape, not finite, or a size out of range.
    """
    cloud = np.ascontiguousarray(points, dtype=np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3 or len(cloud) == 0 or not np.isfinite(cloud).all():
        raise InputError(f"points: shape {cloud.shape}; draw (n, 3) finite numbers")
    if not 16 <= size <= 4096:
        raise InputError(f"size is {size}; draw 16 to 4096 pixels")
    paint = linear_gradient(cloud) if colours is None else np.ascontiguousarray(colours, dtype=np.float64)
    rotation = best_view(cloud) if view is None else np.ascontiguousarray(view, dtype=np.float64)
    seen = (cloud - (cloud.min(axis=0) + cloud.max(axis=0)) / 2) @ rotation.T
    # A few points far out, as on attractors that thin out for ever, must not shrink all the rest.
    low, high = np.quantile(seen[:: max(1, len(seen) // 20_000)], _FRAMED, axis=0)
    seen -= (low + high) / 2
    cells = size * _OVERSAMPLING
    scale = _FRAME * cells / max(float((high - low)[:2].max()), 1e-300)
    picture = np.empty((size, size, 3), np.uint8)
    splat(seen * scale, paint, np.array(ground), cells, picture)
    return picture


def linear_gradient(points: FloatArray) -> FloatArray:
    """The paper's linear gradient, C = (x, y, z) / range: (n, 3) RGB in [0, 1]."""
    low = points.min(axis=0)
    span = np.ptp(points, axis=0)
    return (points - low) / np.where(span > 0, span, 1.0)


def dual_tone(points: FloatArray, first: Colour = (1.0, 0.86, 0.55), second: Colour = (0.75, 0.75, 0.35)) -> FloatArray:
    """The paper's dual tone, C = C1 - C2 (x, y, z) / range, clipped: (n, 3) RGB in [0, 1]."""
    colours: FloatArray = np.clip(np.array(first) - np.array(second) * linear_gradient(points), 0.0, 1.0)
    return colours


def best_view(points: FloatArray) -> FloatArray:
    """A view that shows the shape: its longest axis upright, its shortest towards the viewer, turned a little.

    Args:
        points: (n, 3) float64.

    Returns:
        (3, 3) rotation, rows right, up and towards the viewer.
    """
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    axes *= np.where((centred @ axes).max(axis=0) < -(centred @ axes).min(axis=0), -1.0, 1.0)
    towards, right, up = axes.T
    frame = np.stack([right, up, np.cross(right, up) if np.dot(np.cross(right, up), towards) else towards])
    turn = np.array([[math.cos(_TURN), 0, math.sin(_TURN)], [0, 1, 0], [-math.sin(_TURN), 0, math.cos(_TURN)]])
    tilt = np.array([[1, 0, 0], [0, math.cos(_TILT), -math.sin(_TILT)], [0, math.sin(_TILT), math.cos(_TILT)]])
    return _rolled(points, tilt @ turn @ frame)


def _rolled(points: FloatArray, view: FloatArray) -> FloatArray:
    """Long shapes lean into the diagonal, where there is more room; others stay upright."""
    flat = points[:: max(1, len(points) // 4000)] @ view[:2].T
    angles = np.radians(np.arange(-45.0, 46.0, 5.0))
    rolls = np.stack([[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]]).transpose(2, 0, 1)
    extents = np.ptp(np.quantile(flat @ rolls.transpose(0, 2, 1), _FRAMED, axis=1), axis=0).max(axis=1)
    upright = extents[len(angles) // 2]
    chosen = int(np.argmin(extents)) if extents.min() < _WORTH_A_ROLL * upright else len(angles) // 2
    rolled = view.copy()
    rolled[:2] = rolls[chosen] @ view[:2]
    return rolled


@kernel
def splat(points, colours, ground, cells, picture):  # type: ignore[no-untyped-def]
    """Draw into `picture` (s, s, 3) uint8.

    Args:
        points: (n, 3) float64 in cells, x right, y up, z towards the viewer, around 0.
        colours: (n, 3) float64 RGB in [0, 1].
        ground: (3,) float64 RGB.
        cells: cells of a side, a multiple of s.
        picture: filled.
    """
    depth = np.full((cells, cells), _EMPTY)
    front = np.zeros((cells, cells), np.int32)
    for i in range(points.shape[0]):
        column = int(math.floor(points[i, 0] + 0.5 * cells))
        row = int(math.floor(0.5 * cells - points[i, 1]))
        for r in range(max(row - 1, 0), min(row + 2, cells)):
            for c in range(max(column - 1, 0), min(column + 2, cells)):
                if points[i, 2] > depth[r, c]:
                    depth[r, c] = points[i, 2]
                    front[r, c] = i
    side = picture.shape[0]
    step = cells // side
    for v in range(side):
        for u in range(side):
            red = 0.0
            green = 0.0
            blue = 0.0
            for r in range(v * step, (v + 1) * step):
                for c in range(u * step, (u + 1) * step):
                    if depth[r, c] == _EMPTY:
                        red += ground[0]
                        green += ground[1]
                        blue += ground[2]
                    else:
                        light = _eye_dome(depth, r, c)
                        i = front[r, c]
                        red += light * (_FLOOR + (1.0 - _FLOOR) * colours[i, 0])
                        green += light * (_FLOOR + (1.0 - _FLOOR) * colours[i, 1])
                        blue += light * (_FLOOR + (1.0 - _FLOOR) * colours[i, 2])
            share = 255.0 / (step * step)
            picture[v, u, 0] = np.uint8(min(red * share, 255.0))
            picture[v, u, 1] = np.uint8(min(green * share, 255.0))
            picture[v, u, 2] = np.uint8(min(blue * share, 255.0))


@kernel(inline="always")
def _eye_dome(depth, r, c):  # type: ignore[no-untyped-def]
    """Light of a cell in (0, 1]: it falls with the height of neighbours at 1, 3 and 9 cells above it."""
    cells = depth.shape[0]
    shade = 0.0
    for reach in (1, 3, 9):
        for direction in range(8):
            dr = (direction // 3) - 1 if direction < 4 else ((direction + 1) // 3) - 1
            dc = (direction % 3) - 1 if direction < 4 else ((direction + 1) % 3) - 1
            rr = r + dr * reach
            cc = c + dc * reach
            if 0 <= rr < cells and 0 <= cc < cells and depth[rr, cc] > depth[r, c]:
                shade += min(1.0, (depth[rr, cc] - depth[r, c]) / (6.0 * reach + 0.06 * cells))
    return math.exp(-0.085 * shade)
