"""What is measured on a finished mesh: the facts that travel beside every file (DESIGN section 6, point 5)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

WALL_QUANTILE = 0.01
WALL_SAMPLES = 4_000
_SEED = 1


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
        "wall_measured_mm": float(np.quantile(wall_thickness(mesh), WALL_QUANTILE)),
    }


def wall_thickness(mesh: trimesh.Trimesh, samples: int = WALL_SAMPLES) -> npt.NDArray[np.float64]:
    """Thickness below points spread evenly over the surface: rays against the normal, to where they leave the mesh.

    Args:
        mesh: a closed mesh.
        samples: number of points; always the same ones for the same mesh.

    Returns:
        (n,) float64 in the unit of the mesh, n somewhat below `samples` where rays graze an edge.
    """
    places, faces = trimesh.sample.sample_surface(mesh, samples, seed=_SEED)
    thickness = trimesh.proximity.thickness(
        mesh, places, exterior=False, normals=mesh.face_normals[faces], method="ray"
    )
    return np.asarray(thickness[thickness > 0.0], dtype=np.float64)
