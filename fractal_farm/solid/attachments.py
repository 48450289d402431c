"""What is built onto a finished body: base, bail and sprue, joined to it with manifold3d (DESIGN section 6, point 3).

Every attachment reaches into the body as deep as the body is thick there, so that the joint is no thinner than the
wall. The result is proved to be one body again.
"""

from __future__ import annotations

import math

import manifold3d
import numpy as np
import numpy.typing as npt

from fractal_farm.errors import FarmError
from fractal_farm.solid.engraving import engraving, least_radius
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.surface import Surface

_SEGMENTS = 64
_TUBE_SEGMENTS = 32
_RING_WIRE = 1.25  # thickness of the ring in walls
_RING_SUNK = 0.45  # how far below the highest point its lowest thread runs, in its own thickness: the hole stays free
_FOOT = 0.35  # radius of a base, in the wider side of the body
_COLUMN = 0.12  # height of a stand's column, in the longest side
_COLUMN_WIDTH = 1.5  # its radius in walls
_SPRUE_LENGTH = 0.2  # of the longest side
_SPRUE_NARROW = 1.0  # radius where it feeds the body, in walls
_SPRUE_WIDE = 2.5
_SPECK = 1e-3  # mm3, what counts as a cavity

FloatArray = npt.NDArray[np.float64]


def with_attachments(surface: Surface, parameters: SolidParameters, code: str) -> Surface:
    """A body with its base, bail and sprue; itself if none is asked for.

    Args:
        surface: one closed body, mm, z up.
        parameters: what is asked for.
        code: the design code, for the engraving.

    Returns:
        One closed body without cavities, in the same place.

    Raises:
        FarmError: the result is not one body; says what would pass.
    """
    if parameters.base == "none" and parameters.bail == "none" and not parameters.sprue:
        return surface
    vertices, faces = surface.vertices, surface.faces
    body = manifold3d.Manifold(manifold3d.Mesh(vertices, faces.astype(np.uint32)))
    parts = [body]
    cut: list[manifold3d.Manifold] = []
    if parameters.base != "none":
        stands_on, underside, radius = _base(vertices, body, parameters, least_radius(code))
        parts += stands_on
        cut = [engraving(code, underside, radius, parameters.wall_mm)] if parameters.engrave else []
    if parameters.bail == "ring":
        parts.append(_ring(vertices, parameters))
    if parameters.sprue:
        parts.append(_sprue(vertices, parameters))
    solid = manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add)
    solid = manifold3d.Manifold.batch_boolean([solid, *cut], manifold3d.OpType.Subtract)
    pieces = solid.decompose()
    outer = [piece for piece in pieces if piece.volume() > 0.0]
    if solid.status() != manifold3d.Error.NoError or len(outer) != 1:
        raise FarmError(
            f"base, bail and sprue leave {len(outer)} bodies ({solid.status()}); leave one out, or raise the wall"
        )
    sealed = -sum(piece.volume() for piece in pieces if piece.volume() < 0.0)
    if parameters.shell_mm > 0.0 and sealed > _SPECK:
        raise FarmError(f"the base closes a hollow of {sealed:.1f} mm3; leave out the base, or shell_mm")
    mesh = outer[0].to_mesh()
    return Surface(
        np.ascontiguousarray(mesh.vert_properties[:, :3], np.float32),
        np.asarray(mesh.tri_verts).astype(np.int32),
        int(outer[0].genus()),
    )


def ring_hole(vertices: npt.NDArray[np.float32], parameters: SolidParameters) -> tuple[FloatArray, FloatArray]:
    """Centre (3,) and axis (3,) of the hole of a bail on a body, mm.

    The axis is that of the wider horizontal side: on a chain that runs from left to right the piece shows its front.
    """
    top = _extreme(vertices, 1.0)
    wire = _RING_WIRE * parameters.wall_mm
    rise = 0.5 * (parameters.bail_hole_mm + wire) - _RING_SUNK * wire
    sides = np.ptp(vertices, axis=0)
    axis = np.array([1.0, 0.0, 0.0]) if sides[0] >= sides[1] else np.array([0.0, 1.0, 0.0])
    return top + np.array([0.0, 0.0, rise]), axis


def _ring(vertices: npt.NDArray[np.float32], parameters: SolidParameters) -> manifold3d.Manifold:
    centre, axis = ring_hole(vertices, parameters)
    wire = _RING_WIRE * parameters.wall_mm
    # The polygon of the inner edge is drawn about the hole: nothing of the ring reaches into it.
    middle = 0.5 * parameters.bail_hole_mm / math.cos(math.pi / _SEGMENTS) + 0.5 * wire
    tube = manifold3d.CrossSection.circle(0.5 * wire, _TUBE_SEGMENTS).translate((middle, 0.0))
    torus = manifold3d.Manifold.revolve(tube, _SEGMENTS)
    turned = torus.rotate((0.0, 90.0, 0.0) if axis[0] else (90.0, 0.0, 0.0))
    return turned.translate(tuple(centre))


def _base(
    vertices: npt.NDArray[np.float32], body: manifold3d.Manifold, parameters: SolidParameters, engraved: float
) -> tuple[list[manifold3d.Manifold], FloatArray, float]:
    """A disc below the centre of mass, wide enough that the piece does not fall, and for a stand its column.

    `engraved` is the least radius if it is engraved, mm.
    Also the centre (3,) of its underside and its radius, mm.
    """
    wall = parameters.wall_mm
    tip = _extreme(vertices, -1.0)
    lowest = float(tip[2])
    centre = _centre_of_mass(body)
    sides = np.ptp(vertices, axis=0)
    thickness = 2.0 * wall
    if parameters.base == "plate":
        sunk = vertices[vertices[:, 2] < lowest + thickness, :2]
        reach = float(np.linalg.norm(sunk - centre[:2], axis=1).max()) + wall
        bottom = lowest
    else:
        height = _COLUMN * parameters.size_mm
        reach = float(np.linalg.norm(tip[:2] - centre[:2])) + 2.0 * _COLUMN_WIDTH * wall
        bottom = lowest - height
    radius = max(_FOOT * float(sides[:2].max()), reach, engraved if parameters.engrave else 0.0)
    disc = manifold3d.Manifold.cylinder(thickness, radius, radius, 2 * _SEGMENTS)
    parts = [disc.translate((centre[0], centre[1], bottom))]
    if parameters.base == "stand":
        narrow = _COLUMN_WIDTH * wall
        column = manifold3d.Manifold.cylinder(height + wall, 1.5 * narrow, narrow, _SEGMENTS)
        parts.append(column.translate((tip[0], tip[1], bottom)))
    return parts, np.array([centre[0], centre[1], bottom]), radius


def _sprue(vertices: npt.NDArray[np.float32], parameters: SolidParameters) -> manifold3d.Manifold:
    """A cone, narrow end a wall deep in the lowest point, and a disc below it: its rim is no edge."""
    wall = parameters.wall_mm
    tip = _extreme(vertices, -1.0)
    length = _SPRUE_LENGTH * parameters.size_mm
    wide = _SPRUE_WIDE * wall
    cone = manifold3d.Manifold.cylinder(length, wide, _SPRUE_NARROW * wall, _SEGMENTS).translate((0.0, 0.0, wall))
    foot = manifold3d.Manifold.cylinder(wall, wide, wide, _SEGMENTS)
    return (foot + cone).translate((tip[0], tip[1], tip[2] - length))


def _extreme(vertices: npt.NDArray[np.float32], sign: float) -> FloatArray:
    """The highest (sign 1) or lowest (-1) vertex, of several equal ones that closest to the middle of the box."""
    heights = sign * vertices[:, 2].astype(np.float64)
    rows = np.flatnonzero(heights >= heights.max() - 1e-6)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    nearest = rows[np.linalg.norm((vertices[rows] - middle)[:, :2], axis=1).argmin()]
    vertex: FloatArray = vertices[nearest].astype(np.float64)
    return vertex


def _centre_of_mass(body: manifold3d.Manifold) -> FloatArray:
    """(3,) mm: the tetrahedra between the origin and the faces, weighed by their signed volume."""
    mesh = body.to_mesh()
    corners = np.asarray(mesh.vert_properties, np.float64)[np.asarray(mesh.tri_verts)][:, :, :3]
    volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    centre: FloatArray = (corners.sum(axis=1) * volumes[:, None]).sum(axis=0) / (4.0 * volumes.sum())
    return centre
