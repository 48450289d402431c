"""Points -> pixels: a depth buffer of small discs, shaded by the depth around them, averaged down.

Points are drawn on a grid twice as fine as the picture and the nearest wins. Each place is darkened by how far its
neighbours stand in front of it (eye-dome lighting, Boucheny 2009), which shows depth without normals, and the far ones
fade into the ground.
"""

from __future__ import annotations

import numpy as np

from fractal_farm.ifs.kernel import kernel

SUPERSAMPLE = 2
_EMPTY = np.float32(-1e30)
_PAD = 12
_RINGS = ((2, 0), (-2, 0), (0, 2), (0, -2), (5, 5), (-5, 5), (5, -5), (-5, -5), (12, 0), (-12, 0), (0, 12), (0, -12))


@kernel
def draw_points(points, colours, disc, shading, fog, picture):  # type: ignore[no-untyped-def]
    """Draw a cloud over what is in `picture`.

    Args:
        points: (n, 3) float32 in subpixels: x to the right from the left edge, y down from the top, z to the viewer;
            inside of the picture.
        colours: (n, 3) float32 in [0, 1].
        disc: radius of a point in subpixels, at most 12.
        shading: how much neighbours in front darken, from 0.
        fog: how far the farthest point fades into the ground, 0 to 1.
        picture: (h, w, 3) float32 in [0, 1], the ground; drawn over.
    """
    shape = (picture.shape[0] * SUPERSAMPLE + 2 * _PAD, picture.shape[1] * SUPERSAMPLE + 2 * _PAD)
    depth = np.full(shape, _EMPTY)
    owner = np.empty(shape, np.int32)
    nearest = points[0, 2]
    farthest = points[0, 2]
    for p in range(len(points)):
        nearest = max(nearest, points[p, 2])
        farthest = min(farthest, points[p, 2])
        _draw_disc(points[p, 0], points[p, 1], points[p, 2], p, disc, depth, owner)
    haze = np.float32(fog) / max(nearest - farthest, np.float32(1e-20))
    share = np.float32(1.0 / (SUPERSAMPLE * SUPERSAMPLE))
    one = np.float32(1.0)
    for y in range(picture.shape[0]):
        for x in range(picture.shape[1]):
            top = y * SUPERSAMPLE + _PAD
            left = x * SUPERSAMPLE + _PAD
            light = np.float32(-1.0)
            red = np.float32(0.0)
            green = np.float32(0.0)
            blue = np.float32(0.0)
            covered = np.float32(0.0)
            for r in range(top, top + SUPERSAMPLE):
                for c in range(left, left + SUPERSAMPLE):
                    z = depth[r, c]
                    if z == _EMPTY:
                        continue
                    if light < 0.0:
                        light = one / (one + np.float32(shading) * _hidden(depth, r, c))
                    presence = (one - haze * (nearest - z)) * share
                    paint = colours[owner[r, c]]
                    red += presence * light * paint[0]
                    green += presence * light * paint[1]
                    blue += presence * light * paint[2]
                    covered += presence
            if covered > 0.0:
                pixel = picture[y, x]
                pixel[0] = pixel[0] * (one - covered) + red
                pixel[1] = pixel[1] * (one - covered) + green
                pixel[2] = pixel[2] * (one - covered) + blue


@kernel(inline="always")
def _draw_disc(x, y, z, p, disc, depth, owner):  # type: ignore[no-untyped-def]
    """Set the places within `disc` of a point that are empty or behind it."""
    column = int(x) + _PAD
    row = int(y) + _PAD
    reach = int(disc)
    square = disc * disc
    for r in range(row - reach, row + reach + 1):
        for c in range(column - reach, column + reach + 1):
            if (r - row) * (r - row) + (c - column) * (c - column) <= square and z > depth[r, c]:
                depth[r, c] = z
                owner[r, c] = p


@kernel(inline="always")
def _hidden(depth, row, column):  # type: ignore[no-untyped-def]
    """Mean over neighbours at three distances of how steeply they rise before a place, each 0 to 1."""
    here = depth[row, column]
    total = np.float32(0.0)
    for down, right in _RINGS:
        rise = (depth[row + down, column + right] - here) / np.float32(4 * max(abs(down), abs(right)))
        total += min(max(rise, np.float32(0.0)), np.float32(1.0))
    return total / np.float32(len(_RINGS))
