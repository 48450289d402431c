"""The certificate of a mesh against a material: facts, findings with remedies, a verdict (DESIGN section 6, point 5).

`certify(mesh, material("silver"))` measures and judges; `certificate(mesh)` are the bare facts that travel beside every
file. Not examined: whether the surface cuts through itself, and what a shop's own software thinks of it.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import trimesh

from fractal_farm import __version__
from fractal_farm.errors import InputError
from fractal_farm.solid.findings import WALL_TOLERANCE, Finding, Measures, judge
from fractal_farm.solid.materials import Material
from fractal_farm.solid.thickest import Thickest, thickest_solid
from fractal_farm.solid.thickness import ThinPlace, cast_rays, thin_places
from fractal_farm.solid.topology import Piece, edge_faults, manifold_status, pieces, signed_volumes

WALL_QUANTILE = 0.01
MOST_LISTED = 50
LONGEST_MM = 100_000.0
SHORTEST_MM = 0.001
_STEEP = math.cos(math.radians(45.0))
_RESTING = 1e-3  # of the height: faces that low stand on the plate

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Certificate:
    """What is known of a mesh, and whether it may go to the shop.

    Attributes:
        verdict: "pass", or "fail" if there is a finding of severity "failure".
        findings: failures first.
        material: name of the profile.
        material_title, material_source, material_date: of the profile.
        closed: every edge joins two faces that agree which side is out.
        manifold: what manifold3d says; "NoError" is good.
        n_bodies, n_cavities: how many.
        bodies, cavities: the largest, at most MOST_LISTED of each.
        genus: number of handles, all bodies together; None unless closed.
        faces, vertices: how many.
        box_mm: sides along x, y and z.
        area_mm2: of the surface.
        volume_mm3: enclosed; None unless closed.
        grams, grams_polished: in this material, as cast or printed, and after polishing; None unless closed.
        wall_mm: thickness that all but WALL_QUANTILE of the surface reach, by rays; None where no ray left the mesh.
        wall_limit_mm: what `wall_mm` must reach: WALL_TOLERANCE of the material's wall.
        thin_places: the largest, at most MOST_LISTED.
        overhang_share: share of the surface that looks down by more than 45 degrees and does not stand on the plate.
        thickest: the largest ball inside; None unless closed.
        mesh_sha256: over the vertices (float64) and faces (int64), little-endian, as they were given.
        design_id, software: from the metadata of the mesh, the latter "software_version" or "pipeline"; None where
            they are not told.
        certified_by: version of this program.
    """

    verdict: Literal["pass", "fail"]
    findings: tuple[Finding, ...]
    material: str
    material_title: str
    material_source: str
    material_date: str
    closed: bool
    manifold: str
    n_bodies: int
    n_cavities: int
    bodies: tuple[Piece, ...]
    cavities: tuple[Piece, ...]
    genus: int | None
    faces: int
    vertices: int
    box_mm: Triple
    area_mm2: float
    volume_mm3: float | None
    grams: float | None
    grams_polished: float | None
    wall_mm: float | None
    wall_limit_mm: float
    thin_places: tuple[ThinPlace, ...]
    overhang_share: float
    thickest: Thickest | None
    mesh_sha256: str
    design_id: str | None
    software: str | None
    certified_by: str

    @property
    def passes(self) -> bool:
        """Whether nothing failed."""
        return self.verdict == "pass"

    def as_dict(self) -> dict[str, Any]:
        """All of it, fit for JSON."""
        return asdict(self)


def certify(mesh: trimesh.Trimesh, material: Material) -> Certificate:
    """Measure a mesh and judge it.

    Args:
        mesh: in mm. Vertices that lie in one place are joined if it is not closed without.
        material: what it is to be made of.

    Returns:
        The same for the same mesh.

    Raises:
        InputError: no faces, a place that is not finite, or no extent: nothing that can be measured.
    """
    _check(mesh)
    whole = _outwards(mesh)
    faults = edge_faults(whole)
    closed = not faults
    inverted = whole.metadata["_turned"] and closed
    parts = pieces(whole, oriented=closed)
    rays = cast_rays(whole, engraved_mm=_engraved_mm(mesh))
    limit = WALL_TOLERANCE * material.wall
    volume = float(signed_volumes(whole).sum()) if closed else None
    box = np.asarray(whole.extents, dtype=np.float64)
    measures = Measures(
        inverted=inverted,
        manifold=manifold_status(whole),
        faults=tuple(faults),
        bodies=tuple(part for part in parts if part.kind != "cavity"),
        cavities=tuple(part for part in parts if part.kind == "cavity"),
        volume_mm3=volume,
        box_mm=(float(box[0]), float(box[1]), float(box[2])),
        wall_mm=rays.wall(WALL_QUANTILE),
        wall_limit_mm=limit,
        thin_places=tuple(thin_places(rays, limit) or thin_places(rays, limit, tapering=True)),
        thickest=thickest_solid(whole, rays) if closed else None,
        made_with=mesh.metadata,
    )
    findings = judge(measures, material)
    grams = None if volume is None else material.grams(volume)
    return Certificate(
        verdict="fail" if any(finding.severity == "failure" for finding in findings) else "pass",
        findings=findings,
        material=material.name,
        material_title=material.title,
        material_source=material.source,
        material_date=material.date,
        closed=closed,
        manifold=measures.manifold,
        n_bodies=len(measures.bodies),
        n_cavities=len(measures.cavities),
        bodies=measures.bodies[:MOST_LISTED],
        cavities=measures.cavities[:MOST_LISTED],
        genus=len(parts) - int(whole.euler_number) // 2 if closed else None,
        faces=len(mesh.faces),
        vertices=len(mesh.vertices),
        box_mm=measures.box_mm,
        area_mm2=float(whole.area),
        volume_mm3=volume,
        grams=grams,
        grams_polished=None if grams is None else grams * (1.0 - material.polish),
        wall_mm=measures.wall_mm,
        wall_limit_mm=limit,
        thin_places=measures.thin_places[:MOST_LISTED],
        overhang_share=overhang_share(whole),
        thickest=measures.thickest,
        mesh_sha256=mesh_sha256(mesh),
        design_id=_text(mesh, "design_id"),
        software=_text(mesh, "software") or _text(mesh, "pipeline"),
        certified_by=f"fractal_farm {__version__}",
    )


def certificate(mesh: trimesh.Trimesh) -> dict[str, Any]:
    """Measured facts of a mesh, fit for JSON.

    Args:
        mesh: a closed mesh in mm.

    Returns:
        "watertight", "bodies", "faces", "vertices", "volume_mm3", "area_mm2", "box_mm" (three lengths), and
        "wall_measured_mm", the 1 % quantile of the thickness.
    """
    return {
        "watertight": bool(mesh.is_watertight and mesh.is_winding_consistent),
        "bodies": int(mesh.body_count),
        "faces": len(mesh.faces),
        "vertices": len(mesh.vertices),
        "volume_mm3": float(mesh.volume),
        "area_mm2": float(mesh.area),
        "box_mm": [float(length) for length in mesh.extents],
        "wall_measured_mm": measured_wall(mesh),
    }


def measured_wall(mesh: trimesh.Trimesh) -> float:
    """The thickness that all but WALL_QUANTILE of the surface reach, by rays; NaN where no ray left the mesh."""
    wall = cast_rays(mesh, engraved_mm=_engraved_mm(mesh)).wall(WALL_QUANTILE)
    return math.nan if wall is None else wall


def overhang_share(mesh: trimesh.Trimesh) -> float:
    """Share of the surface that looks down by more than 45 degrees (z is up) and does not stand on the plate."""
    low, high = float(mesh.bounds[0][2]), float(mesh.bounds[1][2])
    resting = np.asarray(mesh.triangles)[:, :, 2].max(axis=1) <= low + _RESTING * (high - low)
    hanging = (np.asarray(mesh.face_normals)[:, 2] < -_STEEP) & ~resting
    return float(np.asarray(mesh.area_faces)[hanging].sum() / mesh.area)


def mesh_sha256(mesh: trimesh.Trimesh) -> str:
    """64 hex digits over the vertices (float64) and the faces (int64), little-endian, in their order."""
    digest = hashlib.sha256(np.ascontiguousarray(mesh.vertices, dtype="<f8").tobytes())
    digest.update(np.ascontiguousarray(mesh.faces, dtype="<i8").tobytes())
    return digest.hexdigest()


def _check(mesh: trimesh.Trimesh) -> None:
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if len(faces) == 0 or len(vertices) == 0:
        raise InputError(f"mesh has {len(faces)} faces and {len(vertices)} vertices; give a surface of triangles")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"mesh has faces that name vertex {faces.max()} of {len(vertices)}; export it again")
    wrong = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(wrong):
        x, y, z = vertices[wrong[0]]
        raise InputError(f"mesh has vertex {wrong[0]} at ({x:g}, {y:g}, {z:g}); all places must be finite numbers")
    used = vertices[faces.ravel()]
    longest = float(np.ptp(used, axis=0).max())
    if longest < SHORTEST_MM:
        raise InputError(f"mesh has a longest side of {longest:g} mm, it has no extent; scale it, its unit is mm")
    if longest > LONGEST_MM:
        raise InputError(f"mesh has a longest side of {longest:g} mm; at most {LONGEST_MM:g}, its unit is mm")
    edges = used.reshape(-1, 3, 3)
    if not np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]).any():
        raise InputError("mesh has no area: the corners of every face lie on a line; export it again")


def _outwards(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A copy with joined vertices if need be, turned if it was inside out; metadata "_turned" says so."""
    copy = trimesh.Trimesh(np.array(mesh.vertices), np.array(mesh.faces), process=False)
    if not copy.is_watertight:
        copy.merge_vertices(merge_tex=True, merge_norm=True)
        a, b, c = np.asarray(copy.faces).T
        copy.update_faces((a != b) & (b != c) & (c != a))
    copy.remove_unreferenced_vertices()
    turned = float(signed_volumes(copy).sum()) < 0.0
    if turned:
        copy.invert()
    copy.metadata["_turned"] = turned
    return copy


def _engraved_mm(mesh: trimesh.Trimesh) -> float:
    depth = mesh.metadata.get("engraved_mm")
    return float(depth) if isinstance(depth, (int, float)) else 0.0


def _text(mesh: trimesh.Trimesh, key: str) -> str | None:
    value = mesh.metadata.get(key)
    return None if value is None else str(value)
