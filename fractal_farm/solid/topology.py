"""Of what pieces a mesh consists, and where it is not a surface that encloses something (DESIGN section 6, point 5)."""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d
import numpy as np
import numpy.typing as npt
import trimesh

FloatArray = npt.NDArray[np.float64]
Triple = tuple[float, float, float]

# A direction that no grid and no designer has: rays along it do not run within faces or through edges.
_ASKEW = np.array([0.35716, 0.78241, 0.51023]) / np.linalg.norm([0.35716, 0.78241, 0.51023])


@dataclass(frozen=True)
class Piece:
    """Faces that hang together.

    Attributes:
        kind: "body"; "cavity", the closed wall of a hollow inside a body; "inside out", a body whose faces look
            inwards; "inside a body", a body that lies within another.
        place_mm: middle of its box.
        box_mm: sides of its box.
        volume_mm3: what it encloses; for a cavity that of the hollow.
        faces: how many.
    """

    kind: str
    place_mm: Triple
    box_mm: Triple
    volume_mm3: float
    faces: int


@dataclass(frozen=True)
class EdgeFault:
    """Edges at which a mesh is not a closed surface.

    Attributes:
        kind: "open", edges of one face; "crowded", edges of more than two; "twisted", whose two faces do not agree
            which side is out.
        edges: how many.
        place_mm: middle of the one nearest to the middle of them all.
        box_mm: sides of the box about them.
    """

    kind: str
    edges: int
    place_mm: Triple
    box_mm: Triple


def edge_faults(mesh: trimesh.Trimesh) -> list[EdgeFault]:
    """Every kind of fault that occurs; none for a closed and oriented manifold."""
    directed = np.asarray(mesh.edges, dtype=np.int64)
    ends = np.sort(directed, axis=1)
    _, first, inverse, counts = np.unique(ends, axis=0, return_index=True, return_inverse=True, return_counts=True)
    forwards = np.bincount(inverse.ravel(), weights=directed[:, 0] == ends[:, 0], minlength=len(counts))
    kinds = {"open": counts == 1, "crowded": counts > 2, "twisted": (counts == 2) & (forwards != 1)}
    vertices = np.asarray(mesh.vertices)
    faults = []
    for kind, chosen in kinds.items():
        if chosen.any():
            middles = vertices[ends[first[chosen]]].mean(axis=1)
            nearest = int(np.argmin(np.linalg.norm(middles - middles.mean(axis=0), axis=1)))
            faults.append(
                EdgeFault(kind, int(chosen.sum()), _triple(middles[nearest]), _triple(np.ptp(middles, axis=0)))
            )
    return faults


def manifold_status(mesh: trimesh.Trimesh) -> str:
    """What manifold3d says of the mesh: "NoError", or its name of the fault, for example "NotManifold"."""
    content = manifold3d.Mesh64(
        np.ascontiguousarray(mesh.vertices, dtype=np.float64), np.ascontiguousarray(mesh.faces, dtype=np.uint64)
    )
    return str(manifold3d.Manifold(content).status().name)


def pieces(mesh: trimesh.Trimesh, oriented: bool = True) -> list[Piece]:
    """The pieces of a mesh, the largest first.

    Args:
        mesh: whose volume as a whole is not negative.
        oriented: whether it is closed and its faces agree which side is out; otherwise all pieces are called bodies.
    """
    labels = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
    count = int(labels.max()) + 1
    volumes = np.bincount(labels, weights=signed_volumes(mesh), minlength=count)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    corners = np.asarray(mesh.triangles)
    np.minimum.at(low, labels, corners.min(axis=1))
    np.maximum.at(high, labels, corners.max(axis=1))
    faces = np.bincount(labels, minlength=count)
    around = _solid_around(mesh, labels, count) if oriented and count > 1 else np.zeros(count, np.int64)
    found = [
        Piece(
            _kind(float(volumes[k]), int(around[k])) if oriented else "body",
            _triple(0.5 * (low[k] + high[k])),
            _triple(high[k] - low[k]),
            abs(float(volumes[k])),
            int(faces[k]),
        )
        for k in range(count)
    ]
    return sorted(found, key=lambda piece: (-piece.volume_mm3, -piece.faces, piece.place_mm))


def signed_volumes(mesh: trimesh.Trimesh) -> FloatArray:
    """(m,) float64: what each face adds to the volume; negative where it looks towards the middle of the box."""
    corners = np.asarray(mesh.triangles) - np.asarray(mesh.bounds).mean(axis=0)
    return np.asarray(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0)


def _kind(volume: float, around: int) -> str:
    if volume < 0.0:
        return "cavity" if around > 0 else "inside out"
    return "inside a body" if around > 0 else "body"


def _solid_around(mesh: trimesh.Trimesh, labels: npt.NDArray[np.int64], count: int) -> npt.NDArray[np.int64]:
    """How many times a place of each piece lies within the others: exits minus entrances of a ray from it."""
    largest = np.zeros(count, dtype=np.int64)
    order = np.argsort(mesh.area_faces, kind="stable")
    largest[labels[order]] = order  # the last written stays: the largest face of each piece
    starts = np.asarray(mesh.triangles_center)[largest]
    hit, rays = mesh.ray.intersects_id(starts, np.tile(_ASKEW, (count, 1)), multiple_hits=True)
    hit, rays = np.asarray(hit, dtype=np.int64), np.asarray(rays, dtype=np.int64)
    others = labels[hit] != rays
    signs = np.sign(np.asarray(mesh.face_normals)[hit[others]] @ _ASKEW)
    return np.asarray(np.rint(np.bincount(rays[others], weights=signs, minlength=count)), dtype=np.int64)


def _triple(values: FloatArray) -> Triple:
    return float(values[0]), float(values[1]), float(values[2])
