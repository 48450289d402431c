"""How thick a mesh is, by rays against the normal, and where it is thin (DESIGN section 6, point 5).

A ray measures the way from a point of the surface to where it leaves the mesh. Near a ridge, or where it grazes a
facet, that way is short though nothing is thin: therefore a wall is judged by a quantile, and a place counts as thin
only where the ray leaves through a surface that faces the other way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

FloatArray = npt.NDArray[np.float64]

SAMPLES = 20_000
FEWEST = 5  # rays that agree before a place is called thin
_SEED = 1
_START = 1e-6  # of the diagonal: rays start that far below the surface
_OPPOSITE = -0.5  # cosine between the normals at both ends of a wall
_NEIGHBOURS = 3.0  # spacings of the samples within which thin places join
_TYPICAL = 0.1


@dataclass(frozen=True)
class Rays:
    """Rays through a mesh; arrays over those that leave it again.

    Attributes:
        starts: (n, 3) float64, places on the surface.
        normals: (n, 3) float64, outward, of length 1.
        lengths: (n,) float64, thickness below each place, above 0, in the unit of the mesh.
        opposite: (n,) bool, whether the surface at the far end faces the other way.
        spacing: typical distance between neighbouring samples.
        cast: how many rays were cast, whether they left the mesh or not.
    """

    starts: FloatArray
    normals: FloatArray
    lengths: FloatArray
    opposite: npt.NDArray[np.bool_]
    spacing: float
    cast: int

    def wall(self, quantile: float) -> float | None:
        """The thickness that this share of the surface does not reach; None where no ray left the mesh."""
        return float(np.quantile(self.lengths, quantile)) if len(self.lengths) else None

    @property
    def middles(self) -> FloatArray:
        """(n, 3) float64, half way through."""
        return np.asarray(self.starts - 0.5 * self.lengths[:, None] * self.normals)


@dataclass(frozen=True)
class ThinPlace:
    """A connected place that is thinner than asked for.

    Attributes:
        place_mm: half way through the wall where it is about thinnest.
        thickness_mm: what nine tenths of the place exceed.
        box_mm: sides of the box about the place.
        share: of the mesh's surface.
    """

    place_mm: tuple[float, float, float]
    thickness_mm: float
    box_mm: tuple[float, float, float]
    share: float


def cast_rays(mesh: trimesh.Trimesh, samples: int = SAMPLES, engraved_mm: float = 0.0) -> Rays:
    """Rays from places spread evenly over the surface; always the same ones for the same mesh.

    Args:
        mesh: of positive area, with normals outwards.
        samples: how many.
        engraved_mm: depth of letters in the underside; their sides are no walls, and are left out.
    """
    starts, faces = trimesh.sample.sample_surface(mesh, samples, seed=_SEED)
    normals = np.asarray(mesh.face_normals)[faces]
    lengths, far = _leave(mesh, np.asarray(starts), normals, np.asarray(faces))
    left = lengths > 0.0
    if engraved_mm > 0.0:
        left &= (np.asarray(starts)[:, 2] > mesh.bounds[0, 2] + engraved_mm) | (np.abs(normals[:, 2]) > 0.5)
    return Rays(
        np.asarray(starts)[left],
        normals[left],
        lengths[left],
        _face_apart(normals, np.asarray(mesh.face_normals)[far])[left],
        math.sqrt(float(mesh.area) / samples),
        samples,
    )


def thin_places(rays: Rays, limit: float, tapering: bool = False) -> list[ThinPlace]:
    """Where rays measure less than a limit, the largest place first.

    Args:
        rays: of `cast_rays`.
        limit: thickness below which a place is thin, in the unit of the mesh.
        tapering: count ridges and spikes too, where the surfaces at both ends do not face apart.

    Returns:
        Places of at least FEWEST rays. A place smaller than the samples' spacing may be missed.
    """
    thin = np.flatnonzero((rays.lengths < limit) & (rays.opposite | tapering))
    if len(thin) < FEWEST:
        return []
    middles, lengths = rays.middles[thin], rays.lengths[thin]
    pairs = cKDTree(middles).query_pairs(_NEIGHBOURS * rays.spacing, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(thin), len(thin)))
    _, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels)
    order = np.argsort(-sizes, kind="stable")
    groups = [np.flatnonzero(labels == label) for label in order if sizes[label] >= FEWEST]
    return [_place(middles[group], lengths[group], len(group) / rays.cast) for group in groups]


def thin_faces(mesh: trimesh.Trimesh, limit: float) -> npt.NDArray[np.bool_]:
    """(m,) bool: faces of the mesh whose middle is thinner than a limit."""
    normals = np.asarray(mesh.face_normals)
    lengths, far = _leave(mesh, np.asarray(mesh.triangles_center), normals, np.arange(len(mesh.faces)))
    return np.asarray((lengths > 0.0) & (lengths < limit) & _face_apart(normals, normals[far]))


def _leave(
    mesh: trimesh.Trimesh, starts: FloatArray, normals: FloatArray, faces: npt.NDArray[np.int64]
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Length of the way against the normal to where each ray leaves, 0 where it does not; and the face there."""
    lengths, far = np.zeros(len(starts)), np.zeros(len(starts), dtype=np.int64)
    step = _START * float(mesh.scale)
    hit, rays, places = mesh.ray.intersects_id(
        starts - step * normals, -normals, multiple_hits=False, return_locations=True
    )
    if len(rays) == 0:
        return lengths, far
    ways = np.linalg.norm(np.asarray(places) - starts[rays], axis=1)
    other = (np.asarray(hit) != faces[rays]) & (ways > 2.0 * step)
    lengths[rays[other]], far[rays[other]] = ways[other], np.asarray(hit)[other]
    return lengths, far


def _face_apart(normals: FloatArray, others: FloatArray) -> npt.NDArray[np.bool_]:
    return np.asarray(np.einsum("ij,ij->i", normals, others) < _OPPOSITE)


def _place(middles: FloatArray, lengths: FloatArray, share: float) -> ThinPlace:
    thickness = float(np.quantile(lengths, _TYPICAL))
    thinnest = middles[lengths <= thickness + 1e-9]
    nearest = int(np.argmin(np.linalg.norm(thinnest - thinnest.mean(axis=0), axis=1)))
    place, box = thinnest[nearest], np.ptp(middles, axis=0)
    return ThinPlace(_three(place), thickness, _three(box), share)


def _three(values: FloatArray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
