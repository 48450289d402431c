"""The thickest solid of a mesh: the largest ball that lies inside (DESIGN section 6, point 5).

Every place of the surface has the largest ball that touches it from inside. It is found by shrinking (Ma, Bae and
Choi 2012): a ball as thick as the wall shrinks until it touches at its nearest point. The best of them then climbs to
where it is largest, and its distance to the triangles is measured exactly.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import cKDTree

from fractal_farm.solid.thickness import Rays

FloatArray = npt.NDArray[np.float64]

METHOD = "largest of the balls that touch the surface from inside (shrinking ball), climbed, exact distance at the end"
_SAMPLES = 8_000
_STARTS = 3_000
_COVERAGE = 2.0  # spacings within which there is a sample, but for one place in 300,000
_ROUNDS = 30
_CLIMBERS = 8
_MEASURED = 2
_STEPS = 60
_SETTLED = 2e-3
_CORNERS = np.array([corner for corner in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(corner)])
_DIRECTIONS = _CORNERS / np.linalg.norm(_CORNERS, axis=1)[:, None]


@dataclass(frozen=True)
class Thickest:
    """The largest ball found.

    Attributes:
        diameter_mm: twice the exact distance from `place_mm` to the surface: a ball of this size does lie inside.
        place_mm: its centre.
        error_mm: by how much the thickest solid may exceed it: twice the spacing of the samples.
        method: how it was found.
    """

    diameter_mm: float
    place_mm: tuple[float, float, float]
    error_mm: float
    method: str = METHOD


def thickest_solid(mesh: trimesh.Trimesh, rays: Rays) -> Thickest | None:
    """The largest ball inside a closed mesh; None where no ray left it.

    Args:
        mesh: closed, normals outwards.
        rays: through the same mesh.
    """
    if not len(rays.lengths):
        return None
    # A centre as far from everything as that of a sphere asks every sample: few of them keep that affordable.
    stride = max(1, len(rays.starts) // _SAMPLES)
    tree = cKDTree(rays.starts[::stride])
    spacing = rays.spacing * math.sqrt(stride)
    centres, radii = _touching(rays, tree)
    coverage = _COVERAGE * spacing
    climbed = [_climbed(centres[k], radii[k], tree, coverage) for k in _apart(mesh, centres, radii)]
    climbed.sort(key=lambda ball: -ball[1])
    distance, x, y, z = max((_distance(mesh, centre), *centre.tolist()) for centre, _ in climbed[:_MEASURED])
    return Thickest(2.0 * distance, (x, y, z), 2.0 * spacing)


def _touching(rays: Rays, tree: cKDTree) -> tuple[FloatArray, FloatArray]:
    """Centres (n, 3) and radii (n,) of the largest balls that touch the surface at some of its samples."""
    few = np.arange(0, len(rays.lengths), max(1, len(rays.lengths) // _STARTS))
    starts, outwards, radii = rays.starts[few], rays.normals[few], 0.5 * rays.lengths[few]
    moving = np.arange(len(radii))
    for _ in range(_ROUNDS):
        places, normals = starts[moving], outwards[moving]
        distances, nearest = tree.query(places - radii[moving, None] * normals)
        away = tree.data[nearest] - places
        below = -np.einsum("ij,ij->i", away, normals)
        smaller = np.einsum("ij,ij->i", away, away) / np.maximum(2.0 * below, 1e-12)
        shrinks = (distances < radii[moving] * (1.0 - _SETTLED)) & (smaller < radii[moving] * (1.0 - 1e-6))
        moving = moving[shrinks]
        if not len(moving):
            break
        radii[moving] = smaller[shrinks]
    return starts - radii[:, None] * outwards, radii


def _apart(mesh: trimesh.Trimesh, centres: FloatArray, radii: FloatArray) -> list[int]:
    """The largest balls whose centres do not lie within one another, where rays from the centre agree on the radius.

    A ball may have slipped between the samples of a wall that is thinner than they are apart; rays see the wall.
    """
    largest = np.argsort(-radii, kind="stable")[: len(radii) // 2 + 1]
    free = np.full(len(radii), -np.inf)
    free[largest] = radii[largest]
    origins = np.repeat(centres[largest], len(_DIRECTIONS), axis=0)
    _, seen, places = mesh.ray.intersects_id(
        origins, np.tile(_DIRECTIONS, (len(largest), 1)), multiple_hits=False, return_locations=True
    )
    ways = np.linalg.norm(places - origins[seen], axis=1)
    np.minimum.at(free, largest[seen // len(_DIRECTIONS)], ways)
    chosen: list[int] = []
    for k in np.argsort(-free, kind="stable")[: len(largest)]:
        if all(np.linalg.norm(centres[k] - centres[other]) > free[other] for other in chosen):
            chosen.append(int(k))
        if len(chosen) == _CLIMBERS:
            break
    radii[chosen] = free[chosen]
    return chosen


def _climbed(centre: FloatArray, radius: float, tree: cKDTree, coverage: float) -> tuple[FloatArray, float]:
    """The centre moved to where the distance to the samples is largest.

    A step is shorter than the distance to the surface, so that none leaves the solid: the surface may come nearer than
    its samples by what lies between them.
    """
    step = 0.25 * radius
    for _ in range(_STEPS):
        step = min(step, 0.9 * math.sqrt(max(radius * radius - coverage * coverage, 0.0)))
        if step < _SETTLED * radius:
            break
        tried = centre + step * _DIRECTIONS
        distances, _ = tree.query(tried)
        best = int(np.argmax(distances))
        if distances[best] > radius * (1.0 + _SETTLED):
            centre, radius = tried[best], float(distances[best])
        else:
            step *= 0.5
    return centre, radius


def _distance(mesh: trimesh.Trimesh, place: FloatArray) -> float:
    """Exact distance from a place to the triangles."""
    triangles = np.asarray(mesh.triangles)
    closest = trimesh.triangles.closest_point(triangles, np.tile(place, (len(triangles), 1)))
    return float(np.sqrt(((closest - place) ** 2).sum(axis=1).min()))
