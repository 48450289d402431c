"""Points of an attractor -> the distance field of a union of balls on a voxel grid.

Only points near the surface matter: one is kept in each cell of a grid, and none where all neighbouring cells hold one
too. The distance to the nearest kept point, less the radius of the balls, is negative inside of the solid; it is exact
in a band about the surface and capped outside of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from fractal_farm.ifs.kernel import kernel

MARGIN = 4.0
_BAND = 2.0
_LOSS = 0.4
_SMOOTHING = 0.5
_SAG = 0.06
_OUTWARD = 0.4
_FILLED = 0.2


class Grid(NamedTuple):
    """A voxel grid; sample (i, j, k) lies at `origin + spacing * (i, j, k)`.

    Attributes:
        origin: (3,) float64 mm.
        spacing: edge of a voxel, mm.
        shape: samples along x, y and z.
        radius: of the balls, in voxels.
        cell: edge of the cells of which each keeps one point, in voxels; neighbouring balls then leave notches of
            cell^2 / (8 radius) = 0.06 voxels.
    """

    origin: npt.NDArray[np.float64]
    spacing: float
    shape: tuple[int, int, int]
    radius: float
    cell: float

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.shape[0] * self.shape[1] * self.shape[2]


class Skeleton(NamedTuple):
    """What balls are drawn about.

    Attributes:
        points: (n, 3) float64 mm, of which one is kept in each cell.
        fixed: (m, 3) float64 mm, all of which are kept.
    """

    points: npt.NDArray[np.float64]
    fixed: npt.NDArray[np.float64]


def grid_around(box: npt.NDArray[np.float64], radius: float, spacing: float, room: float = 0.0) -> Grid:
    """The grid that holds all balls of `radius` about points of `box` (2, 3), mm.

    It has a margin of MARGIN voxels and `room` mm.
    """
    pad = radius + MARGIN * spacing + room
    size = np.ceil((box[1] - box[0] + 2.0 * pad) / spacing).astype(int) + 1
    cell = max(1.0, math.sqrt(8.0 * _SAG * radius / spacing))
    return Grid(box[0] - pad, spacing, (int(size[0]), int(size[1]), int(size[2])), radius / spacing, cell)


def distance_field(skeleton: Skeleton, grid: Grid, beyond: float = 0.0) -> npt.NDArray[np.float32]:
    """Distance to the surface of the union of balls about points, negative inside.

    The field is smoothed over less than a voxel: that closes pinholes and creases between balls which no printer could
    make, and moves the surface outward by _OUTWARD at most, the growth of the balls included, or by _FILLED more than
    that growth. The balls are a fraction of a voxel larger than asked for, which is what smoothing, notches between
    balls and the corners that marching cubes cuts take away from a wire, the more the thinner it is.

    Args:
        skeleton: what the balls are about; inside of the box that the grid was made for.
        grid: see `grid_around`.
        beyond: voxels outside of the surface in which distances are needed too; the grid has as much room.

    Returns:
        `grid.shape` float32, in voxels; never exactly 0, where marching cubes could tear the surface.
    """
    radius = grid.radius + _SAG + _LOSS / grid.radius
    reach = radius + _BAND + beyond
    scale = 1.0 / grid.spacing
    taken = np.zeros(tuple(int(n / grid.cell) + 3 for n in grid.shape), np.bool_)
    field = np.full(grid.shape, reach * reach, np.float32)
    _splat((skeleton.fixed - grid.origin) * scale, reach, field)
    kept = _one_per_cell(skeleton.points, grid.origin, scale, grid.cell, taken)
    _splat(_drop_interior(kept, grid.cell, taken, field), reach, field)
    _to_signed_distance(radius, field)
    # The distance changes by as much as the surface moves, so the greater of the two bounds the way outward.
    smooth = ndimage.gaussian_filter(field, _SMOOTHING, truncate=2.5)
    field -= np.float32(max(_OUTWARD - _SAG - _LOSS / grid.radius, _FILLED))
    np.maximum(field, smooth, out=field)
    leave_zero(field)
    return field


@kernel
def _one_per_cell(points, origin, scale, cell, taken):  # type: ignore[no-untyped-def]
    """The first point in each cell, (m, 3) float64 in voxels; marks cells, which are offset by one, in `taken`."""
    kept = np.empty((len(points), 3))
    count = 0
    for p in range(len(points)):
        x = (points[p, 0] - origin[0]) * scale
        y = (points[p, 1] - origin[1]) * scale
        z = (points[p, 2] - origin[2]) * scale
        i = int(x / cell) + 1
        j = int(y / cell) + 1
        k = int(z / cell) + 1
        if not taken[i, j, k]:
            taken[i, j, k] = True
            kept[count, 0] = x
            kept[count, 1] = y
            kept[count, 2] = z
            count += 1
    return kept[:count]


@kernel
def _drop_interior(points, cell, taken, field):  # type: ignore[no-untyped-def]
    """Points without those whose cell has all 26 neighbours; the samples in such a cell become 0 (deep inside)."""
    kept = np.empty_like(points)
    count = 0
    for p in range(len(points)):
        i = int(points[p, 0] / cell) + 1
        j = int(points[p, 1] / cell) + 1
        k = int(points[p, 2] / cell) + 1
        if np.all(taken[i - 1 : i + 2, j - 1 : j + 2, k - 1 : k + 2]):
            for a in range(math.ceil((i - 1) * cell), math.ceil(i * cell)):
                for b in range(math.ceil((j - 1) * cell), math.ceil(j * cell)):
                    for c in range(math.ceil((k - 1) * cell), math.ceil(k * cell)):
                        field[a, b, c] = 0.0
        else:
            kept[count] = points[p]
            count += 1
    return kept[:count]


@kernel
def _splat(points, reach, field):  # type: ignore[no-untyped-def]
    """Lower the squared distances in `field` to those from each point, within `reach` of it."""
    for p in range(len(points)):
        x = points[p, 0]
        y = points[p, 1]
        z = points[p, 2]
        for i in range(math.ceil(x - reach), math.floor(x + reach) + 1):
            for j in range(math.ceil(y - reach), math.floor(y + reach) + 1):
                across = (i - x) * (i - x) + (j - y) * (j - y)
                left = reach * reach - across
                if left <= 0.0:
                    continue
                half = math.sqrt(left)
                first = math.ceil(z - half)
                line = field[i, j, first : math.floor(z + half) + 1]
                offset = np.float32(first - z)
                square = np.float32(across)
                for k in range(len(line)):
                    along = np.float32(k) + offset
                    line[k] = min(line[k], square + along * along)


@kernel
def _to_signed_distance(radius, field):  # type: ignore[no-untyped-def]
    """Squared distances to signed ones, in place."""
    flat = field.reshape(-1)
    shift = np.float32(radius)
    for k in range(len(flat)):
        flat[k] = np.sqrt(flat[k]) - shift


@kernel
def leave_zero(field):  # type: ignore[no-untyped-def]
    """What lies on the surface counts as inside, in place: marching cubes would tear it where samples are exactly 0."""
    flat = field.reshape(-1)
    for k in range(len(flat)):
        if abs(flat[k]) < np.float32(1e-4):
            flat[k] = np.float32(-1e-4)
