"""Clouds as small balls in soft light: what a scene is drawn with.

Light comes from all over the sky and from a lamp. How much of it reaches a point is found by letting rays from some
sixty directions pass through the cloud: each keeps a grid of what is left of it, and the points take from it in the
order in which they are met. Balls are drawn nearest first into a depth buffer, in perspective, and shaded by their own
normals.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.kernel import kernel

FloatArray = npt.NDArray[np.float64]

SUPERSAMPLE = 2
_DIRECTIONS = 48
_CELLS = 220  # of a ray's grid, across the extent of the scene
_LAMP = np.array([-0.45, -0.65, 0.62])  # to it, from the scene: left, towards the viewer, up
_LAMP_RAYS = 12
_LAMP_SPREAD = 0.10
_SKY, _GROUND_LIGHT, _DIRECT = 0.50, 0.06, 1.0
_GLOSS, _SHARPNESS = 0.30, 24.0


def light_on(points: FloatArray, radii: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How much light reaches the points of a scene.

    Args:
        points: (n, 3) float64, z up.
        radii: (n,) of their balls.

    Returns:
        (n,) float64 share of the sky that is seen, and (n,) share of the lamp, both in [0, 1].
    """
    extent = float(np.ptp(points, axis=0).max()) or 1.0
    # A ball shades the cell that its middle is in, which must not be smaller than it.
    cell = max(extent / _CELLS, math.sqrt(math.pi) * float(np.quantile(radii, 0.75)))
    opacity = np.minimum(0.85, math.pi * radii * radii / (cell * cell))
    sky = np.zeros(len(points))
    weights = 0.0
    for direction in _spiral(_DIRECTIONS):
        weight = 0.35 + 0.65 * max(0.0, direction[2])
        sky += weight * _reaching(points, opacity, direction, cell)
        weights += weight
    lamp = np.zeros(len(points))
    for offset in _spiral(_LAMP_RAYS):
        lamp += _reaching(points, opacity, _LAMP / np.linalg.norm(_LAMP) + _LAMP_SPREAD * offset, cell)
    return sky / weights, lamp / _LAMP_RAYS


def _spiral(count: int) -> FloatArray:
    """Directions (count, 3) spread evenly over the sphere (Fibonacci's spiral)."""
    index = np.arange(count) + 0.5
    height = 1.0 - 2.0 * index / count
    angle = math.pi * (1.0 + math.sqrt(5.0)) * index
    flat = np.sqrt(1.0 - height * height)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1)


def _reaching(points: FloatArray, opacity: FloatArray, direction: FloatArray, cell: float) -> FloatArray:
    """How much of the light from one direction reaches each point."""
    towards = direction / np.linalg.norm(direction)
    aside = np.cross(towards, [0.0, 1.0, 0.0] if abs(towards[1]) < 0.9 else [1.0, 0.0, 0.0])
    aside /= np.linalg.norm(aside)
    flat = points @ np.stack([aside, np.cross(towards, aside)], axis=1)
    places = ((flat - flat.min(axis=0)) / cell).astype(np.int64)
    reached: FloatArray = _passed(places, np.argsort(-(points @ towards), kind="stable"), opacity)
    return reached


@kernel
def _passed(places, order, opacity):  # type: ignore[no-untyped-def]
    """Let light through the points (n, 2) in the order given; what each receives, (n,)."""
    width = 0
    height = 0
    for p in range(len(places)):
        width = max(width, places[p, 0] + 1)
        height = max(height, places[p, 1] + 1)
    left = np.ones((height + 2, width + 2))
    received = np.empty(len(places))
    for k in range(len(order)):
        p = order[k]
        row = places[p, 1] + 1
        column = places[p, 0] + 1
        # Half from the cell itself and half from those around it: soft borders.
        around = left[row - 1, column] + left[row + 1, column] + left[row, column - 1] + left[row, column + 1]
        received[p] = 0.5 * left[row, column] + 0.125 * around
        left[row, column] *= 1.0 - opacity[p]
    return received


def draw_balls(
    seen: FloatArray,
    radii: FloatArray,
    colours: FloatArray,
    light: FloatArray,
    glow: FloatArray,
    view: FloatArray,
    picture: npt.NDArray[np.float32],
) -> None:
    """Draw balls over what is in `picture`.

    Args:
        seen: (n, 3) float64 in subpixels: x to the right from the left edge, y down from the top, z to the viewer.
        radii: (n,) float64, subpixels.
        colours: (n, 3) float64 in [0, 1].
        light: (n, 2) float64, share of sky and lamp that reaches each ball.
        glow: (n,) float64, how far it shines by itself, 0 to 1.
        view: (3, 3) rows right, up and towards the viewer.
        picture: (h, w, 3) float32 in [0, 1]; drawn over.
    """
    lamp = view @ (_LAMP / np.linalg.norm(_LAMP))
    half = lamp + np.array([0.0, 0.0, 1.0])
    linear = np.ascontiguousarray(colours**2.2)
    _draw(seen, radii, linear, light, glow, lamp, half / np.linalg.norm(half), view[1], picture)


@kernel
def _draw(seen, radii, colours, light, glow, lamp, half, up, picture):  # type: ignore[no-untyped-def]
    height = picture.shape[0] * SUPERSAMPLE
    width = picture.shape[1] * SUPERSAMPLE
    depth = np.full((height, width), -np.inf, np.float32)
    owner = np.full((height, width), -1, np.int32)
    for p in range(len(seen)):
        x = seen[p, 0]
        y = seen[p, 1]
        radius = max(radii[p], 0.75)
        for r in range(max(0, math.ceil(y - radius)), min(height, math.floor(y + radius) + 1)):
            for c in range(max(0, math.ceil(x - radius)), min(width, math.floor(x + radius) + 1)):
                inside = radius * radius - (r - y) * (r - y) - (c - x) * (c - x)
                if inside >= 0.0:
                    z = seen[p, 2] + math.sqrt(inside)
                    if z > depth[r, c]:
                        depth[r, c] = z
                        owner[r, c] = p
    share = 1.0 / (SUPERSAMPLE * SUPERSAMPLE)
    paint = np.empty(3)
    for y in range(picture.shape[0]):
        for x in range(picture.shape[1]):
            paint[:] = 0.0
            covered = 0
            for r in range(y * SUPERSAMPLE, (y + 1) * SUPERSAMPLE):
                for c in range(x * SUPERSAMPLE, (x + 1) * SUPERSAMPLE):
                    p = owner[r, c]
                    if p < 0:
                        continue
                    covered += 1
                    radius = max(radii[p], 0.75)
                    nx = (c - seen[p, 0]) / radius
                    ny = (seen[p, 1] - r) / radius
                    nz = math.sqrt(max(0.0, 1.0 - nx * nx - ny * ny))
                    above = nx * up[0] + ny * up[1] + nz * up[2]
                    facing = max(0.0, nx * lamp[0] + ny * lamp[1] + nz * lamp[2])
                    shine = max(0.0, nx * half[0] + ny * half[1] + nz * half[2]) ** _SHARPNESS
                    sky = light[p, 0] * (_GROUND_LIGHT + _SKY * (0.5 + 0.5 * above))
                    own = sky + _DIRECT * light[p, 1] * (0.25 + 0.75 * facing)
                    own = own * (1.0 - glow[p]) + glow[p] * max(own, 0.55 + 0.45 * nz)
                    gloss = _GLOSS * light[p, 1] * shine
                    for k in range(3):
                        paint[k] += colours[p, k] * own + gloss * (0.3 + 0.7 * colours[p, k])
            if covered > 0:
                for k in range(3):
                    value = (1.0 - math.exp(-1.35 * share * paint[k])) ** (1.0 / 2.2)
                    picture[y, x, k] = value + (1.0 - covered * share) * picture[y, x, k]
