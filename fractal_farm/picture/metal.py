"""A mesh as a piece of metal, without OpenGL: triangles, a depth buffer, and a painted studio that the metal mirrors.

What polished metal shows depends on its normal alone when the viewer is far away, so the studio (two soft boxes, a rim
light, a dark horizon) is painted once, as a picture of a sphere, and looked up for each pixel.
"""

from __future__ import annotations

import math
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.ifs.kernel import kernel
from fractal_farm.picture.cloud import MAX_SIZE, framed, placed, to_bytes
from fractal_farm.picture.colours import Colour
from fractal_farm.picture.ground import backdrop
from fractal_farm.picture.splat import SUPERSAMPLE
from fractal_farm.picture.view import TILT, choose_view, tilted

Metal = Literal["gold", "silver", "copper", "steel"]

TINTS: dict[str, Colour] = {
    "gold": (1.00, 0.60, 0.13),
    "silver": (0.92, 0.93, 0.96),
    "copper": (0.96, 0.42, 0.24),
    "steel": (0.50, 0.53, 0.58),
}
_MARK: Colour = (1.0, 0.08, 0.05)
_MARK_STRENGTH = 0.8
_SPHERE = 256
_NEIGHBOURS = 14


class Mesh(Protocol):
    """What is drawn, for example a `trimesh.Trimesh`."""

    @property
    def vertices(self) -> Any:
        """(n, 3) places."""

    @property
    def faces(self) -> Any:
        """(m, 3) indices of vertices, counter-clockwise seen from outside."""

    @property
    def vertex_normals(self) -> Any:
        """(n, 3) unit normals."""


def mesh_picture(
    mesh: Mesh,
    size: int = 512,
    metal: Metal = "gold",
    *,
    view: npt.ArrayLike | None = None,
    ground: Colour | None = None,
    marked: npt.ArrayLike | None = None,
) -> npt.NDArray[np.uint8]:
    """A mesh as metal in a studio.

    Args:
        mesh: for example what `solidify` returns.
        size: width and height, pixels, 16 to 8192.
        metal: "gold", "silver", "copper" or "steel".
        view: (3, 3) rotation, rows right, up and towards the viewer; chosen by default.
        ground: colour behind the mesh, red, green, blue in [0, 1]; by default a dark one with a soft light.
        marked: (m,) bool, faces that are painted red; none by default.

    Returns:
        (size, size, 3) uint8.

    Raises:
        InputError: an unknown metal or a size out of range.
    """
    places = _checked(mesh, size, metal)
    rotation = choose_view(places) if view is None else np.asarray(view, dtype=np.float64)
    seen, _ = framed(rotation @ places.T, size)
    return _drawn(mesh, rotation, seen, size, polished_sphere(metal), ground, marked)


def turntable(
    mesh: Mesh, size: int = 256, metal: Metal = "gold", frames: int = 36, *, ground: Colour | None = None
) -> npt.NDArray[np.uint8]:
    """A mesh as metal that turns once about the upright axis, at one scale.

    Args:
        mesh: see `mesh_picture`.
        size: width and height, pixels, 16 to 8192.
        metal: see `mesh_picture`.
        frames: pictures of the whole turn, 2 to 360; after the last comes the first again.
        ground: see `mesh_picture`.

    Returns:
        (frames, size, size, 3) uint8; the first frame has the view of `mesh_picture`.

    Raises:
        InputError: an unknown metal, or a size or number of frames out of range.
    """
    places = _checked(mesh, size, metal)
    if not 2 <= frames <= 360:
        raise InputError(f"frames is {frames}; give 2 to 360")
    first = tilted(choose_view(places), -TILT)
    upright = first @ places.T
    middle = 0.5 * (upright.min(axis=1) + upright.max(axis=1))
    offsets = upright - middle[:, None]
    reach = np.hypot(offsets[0], offsets[2])
    # The heights of a tilted circle of this reach: room for the whole turn.
    highest = (np.abs(offsets[1]) * math.cos(TILT) + reach * math.sin(TILT)).max()
    extent = 2.0 * float(max(reach.max(), highest))
    sphere = polished_sphere(metal)
    pictures = []
    for angle in np.linspace(0.0, 2.0 * math.pi, frames, endpoint=False):
        rotation = tilted(_swung(first, angle))
        seen, _ = placed(rotation @ (places - first.T @ middle).T, np.zeros(3), extent, size)
        pictures.append(_drawn(mesh, rotation, seen, size, sphere, ground))
    return np.stack(pictures)


def _checked(mesh: Mesh, size: int, metal: Metal) -> npt.NDArray[np.float64]:
    """The vertices, if there is something to draw and a way to."""
    if metal not in TINTS:
        raise InputError(f"metal is {metal!r}; choose one of {', '.join(TINTS)}")
    if not 16 <= size <= MAX_SIZE:
        raise InputError(f"size is {size}; give 16 to {MAX_SIZE} pixels")
    return np.asarray(mesh.vertices, dtype=np.float64)


def _swung(view: npt.NDArray[np.float64], angle: float) -> npt.NDArray[np.float64]:
    """The view after the piece has turned about the axis that is up in it."""
    c, s = math.cos(angle), math.sin(angle)
    other: npt.NDArray[np.float64] = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]) @ view
    return other


def _drawn(
    mesh: Mesh,
    rotation: npt.NDArray[np.float64],
    seen: npt.NDArray[np.float32],
    size: int,
    sphere: npt.NDArray[np.float32],
    ground: Colour | None,
    marked: npt.ArrayLike | None = None,
) -> npt.NDArray[np.uint8]:
    """The picture of vertices that are in their places, (n, 3) subpixels."""
    normals = (np.asarray(mesh.vertex_normals) @ rotation.T).astype(np.float32)
    pixels = size * SUPERSAMPLE
    depth = np.full((pixels, pixels), -np.inf, np.float32)
    facing = np.zeros((pixels, pixels, 2), np.float32)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    _rasterise(seen, normals, faces, depth, facing)
    picture = backdrop(size, ground)
    _shade(depth, facing, sphere, _neighbours(pixels), picture)
    if marked is not None:
        nearest = np.full_like(depth, -np.inf)
        _rasterise(seen, normals, faces[np.asarray(marked, dtype=bool)], nearest, facing)
        # Drawn alone they have the very depth that they had among all, where nothing hid them.
        shown = (nearest == depth) & (depth > -np.inf)
        share = shown.reshape(size, SUPERSAMPLE, size, SUPERSAMPLE).mean(axis=(1, 3), dtype=np.float32)[..., None]
        picture += _MARK_STRENGTH * share * (np.asarray(_MARK, dtype=np.float32) - picture)
    return to_bytes(picture)


def _neighbours(pixels: int) -> npt.NDArray[np.int64]:
    """(k, 2) steps to places around, spread over a disc in sunflower order, as far as 3 % of the picture."""
    angles = np.arange(_NEIGHBOURS) * (2.0 * math.pi * 0.382)
    radii = pixels * (0.004 + 0.026 * np.arange(_NEIGHBOURS) / _NEIGHBOURS)
    return np.stack([radii * np.sin(angles), radii * np.cos(angles)], axis=1).astype(np.int64)


def polished_sphere(metal: Metal) -> npt.NDArray[np.float32]:
    """The studio as a ball of this metal mirrors it.

    Returns:
        (256, 256, 3) float32 linear light; row and column run over the y and x of the normal, from -1 to 1.
    """
    steps = np.linspace(-1.0, 1.0, _SPHERE)
    x, y = np.meshgrid(steps, steps)
    length = np.maximum(np.hypot(x, y), 1.0)
    x, y = x / length, y / length
    z = np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))
    mirrored = np.stack([2.0 * z * x, 2.0 * z * y, 2.0 * z * z - 1.0])

    def lamp(direction: tuple[float, float, float], sharpness: float) -> npt.NDArray[np.float64]:
        unit = np.asarray(direction) / np.linalg.norm(direction)
        return np.asarray(np.exp(-sharpness * (1.0 - np.tensordot(unit, mirrored, 1))))

    light = 0.03 + 0.10 * (mirrored[1] + 1.0)
    light += 2.4 * lamp((-0.45, 0.70, 0.55), 10.0) + 0.40 * lamp((-0.45, 0.70, 0.55), 2.0)
    light += 1.2 * lamp((0.90, 0.10, 0.35), 16.0) + 0.22 * lamp((-0.2, -0.85, 0.45), 5.0)
    light *= 1.0 - 0.75 * np.exp(-((mirrored[1] + 0.08) ** 2) / 0.05)
    matt = np.maximum((-0.4 * x + 0.65 * y + 0.65 * z), 0.0)
    grazing = (1.0 - z)[..., None] ** 4
    tint = np.asarray(TINTS[metal])
    colour = tint + (1.0 - tint) * 0.6 * grazing
    shown: npt.NDArray[np.float64] = colour * (0.90 * light + 0.10 * matt + 0.01)[..., None]
    return shown.astype(np.float32)


@kernel
def _rasterise(seen, normals, faces, depth, facing):  # type: ignore[no-untyped-def]
    """Draw triangles; facing keeps x and y of the interpolated unit normal of the nearest."""
    rows, columns = depth.shape
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = seen[a, 0], seen[a, 1], seen[a, 2]
        bx, by, bz = seen[b, 0], seen[b, 1], seen[b, 2]
        cx, cy, cz = seen[c, 0], seen[c, 1], seen[c, 2]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area >= 0.0:
            continue  # rows run downwards: what faces the viewer turns clockwise
        for row in range(max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)) + 1, rows)):
            y = row + 0.5
            for column in range(max(int(min(ax, bx, cx)), 0), min(int(max(ax, bx, cx)) + 1, columns)):
                x = column + 0.5
                u = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
                v = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < -1e-6:
                    continue
                z = u * az + v * bz + w * cz
                if z <= depth[row, column]:
                    continue
                depth[row, column] = z
                nx = u * normals[a, 0] + v * normals[b, 0] + w * normals[c, 0]
                ny = u * normals[a, 1] + v * normals[b, 1] + w * normals[c, 1]
                nz = u * normals[a, 2] + v * normals[b, 2] + w * normals[c, 2]
                length = max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
                facing[row, column, 0] = nx / length
                facing[row, column, 1] = ny / length


@kernel
def _shade(depth, facing, sphere, around, picture):  # type: ignore[no-untyped-def]
    """Look up the sphere, darken hollows, average in linear light, and encode over what is in `picture`."""
    light = np.zeros(3)
    share = 1.0 / (SUPERSAMPLE * SUPERSAMPLE)
    half = 0.5 * (len(sphere) - 1)
    for y in range(picture.shape[0]):
        for x in range(picture.shape[1]):
            light[:] = 0.0
            covered = 0
            openness = 1.0
            for r in range(y * SUPERSAMPLE, (y + 1) * SUPERSAMPLE):
                for c in range(x * SUPERSAMPLE, (x + 1) * SUPERSAMPLE):
                    if depth[r, c] == -np.inf:
                        continue
                    if covered == 0:
                        openness = _openness(depth, r, c, around)
                    covered += 1
                    texel = sphere[int((facing[r, c, 1] + 1.0) * half), int((facing[r, c, 0] + 1.0) * half)]
                    for k in range(3):
                        light[k] += openness * texel[k]
            if covered > 0:
                for k in range(3):
                    metal = (1.0 - math.exp(-1.5 * share * light[k])) ** (1.0 / 2.2)
                    picture[y, x, k] = metal + (1.0 - covered * share) * picture[y, x, k]


@kernel
def _openness(depth, row, column, around):  # type: ignore[no-untyped-def]
    """How much of the studio a place sees, 0 to 1, judged by the depth around it."""
    here = depth[row, column]
    hidden = 0.0
    for k in range(len(around)):
        r = row + around[k, 0]
        c = column + around[k, 1]
        if 0 <= r < depth.shape[0] and 0 <= c < depth.shape[1]:
            before = depth[r, c] - here
            if before > 0.0:
                reach = math.sqrt(around[k, 0] * around[k, 0] + around[k, 1] * around[k, 1]) + 1.0
                hidden += min(before / reach, 1.4)
    return math.exp(-2.4 * hidden / len(around))
