"""What a certificate shows: the piece from two sides, its thin places red."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import trimesh

from fractal_farm.picture.image_file import encoded
from fractal_farm.picture.metal import Metal, mesh_picture
from fractal_farm.picture.view import choose_view
from fractal_farm.solid.thickness import thin_faces

if TYPE_CHECKING:
    from fractal_farm.solid.certificate import Certificate

_PIXELS = 640
_FINE = 1 / 60  # of the longest side: faces are cut to that, so that a part of a large one can be red
_MANY_FACES = 50_000


def certificate_pictures(
    mesh: trimesh.Trimesh, found: Certificate, metal: Metal = "silver", size: int = _PIXELS
) -> list[tuple[str, bytes]]:
    """Caption and PNG of the front and of the back of a mesh.

    Args:
        mesh: in mm.
        found: its certificate.
        metal: that it is drawn in.
        size: width and height, pixels.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    if found.closed and float(mesh.volume) < 0.0:
        faces = faces[:, ::-1]
    if len(faces) < _MANY_FACES:
        vertices, faces = trimesh.remesh.subdivide_to_size(vertices, faces, _FINE * float(mesh.scale), max_iter=12)
    drawn = trimesh.Trimesh(vertices, faces, process=False)
    red = thin_faces(drawn, found.wall_limit_mm)
    front = choose_view(np.asarray(mesh.vertices))
    behind = np.diag([-1.0, 1.0, -1.0]) @ front
    pictures = []
    for side, view in (("front", front), ("back", behind)):
        content = encoded(mesh_picture(drawn, size, metal, view=view, marked=red))
        pictures.append((f"From the {side}. Red: thinner than {found.wall_limit_mm:.2f} mm.", content))
    return pictures
