"""Distance field -> triangle mesh: marching cubes, simplification within a tolerance, proof that it is one solid.

scikit-image walks the cubes; manifold3d proves that the surface is an oriented 2-manifold, simplifies it and splits it
into bodies.
"""

from __future__ import annotations

from dataclasses import dataclass

import manifold3d
import numpy as np
import numpy.typing as npt
from skimage.measure import marching_cubes

from fractal_farm.errors import FarmError
from fractal_farm.solid.progress import Begin, ignore
from fractal_farm.solid.voxels import Grid

SIMPLIFY_VOXELS = 0.0625


@dataclass(frozen=True)
class Surface:
    """A closed surface.

    Attributes:
        vertices: (n, 3) float32 mm.
        faces: (m, 3) int32 into vertices, counter-clockwise seen from outside.
        genus: number of handles.
    """

    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]
    genus: int


def surface_of(field: npt.NDArray[np.float32], grid: Grid, begin: Begin = ignore) -> Surface:
    """The surface where the field passes through 0.

    Args:
        field: signed distance in voxels, negative inside.
        grid: where its samples lie.
        begin: told of the stages, see `progress`.

    Raises:
        FarmError: the surface is not a solid (a bug, or a field without inside).
    """
    begin("marching cubes")
    corners, faces, _, _ = marching_cubes(field, 0.0)
    corners = (corners * grid.spacing + grid.origin).astype(np.float32)
    begin("simplify")
    solid = manifold3d.Manifold(manifold3d.Mesh(corners, faces.astype(np.uint32)))
    solid = solid.simplify(SIMPLIFY_VOXELS * grid.spacing)
    bodies = solid.decompose()
    if solid.status() != manifold3d.Error.NoError or not bodies:
        raise FarmError(
            f"the surface of {len(faces)} faces is not a solid ({solid.status()}); report it with the genome"
        )
    body = max(bodies, key=lambda each: each.volume()) if len(bodies) > 1 else solid
    if not body.volume() > 0.0:
        raise FarmError(f"the surface of {len(faces)} faces encloses no volume; raise the resolution or the wall")
    mesh = body.to_mesh()
    return Surface(
        np.ascontiguousarray(mesh.vert_properties[:, :3], np.float32),
        np.asarray(mesh.tri_verts).astype(np.int32),
        int(body.genus()),
    )
