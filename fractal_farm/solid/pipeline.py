"""Genome -> printable solid (DESIGN section 6): the order of things.

Gap and box from the address tree; scale and wall from them; a cover of the attractor and its copies at half a voxel;
the distance field of the balls about it and about struts; closing; one body without cavities; hollows; marching cubes
and simplification; the last fraction of a voxel of the size by scaling; base, bail and sprue;
and the wall is measured. Never from the fitness cloud.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from fractal_farm.errors import FarmError, InputError
from fractal_farm.ifs.copies import copied, joints
from fractal_farm.ifs.design_code import design_code
from fractal_farm.ifs.enclosure import Enclosure
from fractal_farm.ifs.gap import measure_gap
from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.ifs.random_iteration import system_of
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from fractal_farm.ifs.support import longest_side
from fractal_farm.solid.attachments import with_attachments
from fractal_farm.solid.body import BodyReport, make_one_body
from fractal_farm.solid.certificate import measured_wall
from fractal_farm.solid.engraving import DEPTH
from fractal_farm.solid.findings import WALL_TOLERANCE
from fractal_farm.solid.memory import check_memory, predict_memory
from fractal_farm.solid.offsets import close_slits
from fractal_farm.solid.parameters import PIPELINE_VERSION, SolidParameters
from fractal_farm.solid.plan import SolidPlan, plan_solid
from fractal_farm.solid.progress import Begin, Progress, beginner
from fractal_farm.solid.shelling import Hollows, hollow
from fractal_farm.solid.skeleton import (
    MAX_CELL_POINTS,
    Cover,
    contact_points,
    covering_points,
    extreme_points,
    settled_box,
)
from fractal_farm.solid.struts import HIDDEN, along, strut_ends
from fractal_farm.solid.surface import Surface, surface_of
from fractal_farm.solid.voxels import Grid, Skeleton, distance_field, grid_around, leave_zero

_PITS = 0.5  # voxels: radius of a closing that fills pits which the grid cannot show, and reaches no farther out
_ROOM = 2.0  # voxels beyond the radius of closing
_WHOLE = 0.999

FloatArray = npt.NDArray[np.float64]


def solidify(
    genome: Genome | npt.ArrayLike,
    size_mm: float = 30.0,
    wall_mm: float = 0.8,
    resolution: int | None = None,
    thicken: bool = True,
) -> trimesh.Trimesh:
    """A solid of known wall from the attractor of a genome and its copies.

    Args:
        genome: a `Genome` or an (N, 7) array.
        size_mm: longest side of the finished solid, walls included.
        wall_mm: least thickness.
        resolution: voxels along the longest side; memory and time grow with its cube at most. None: see
            `SolidParameters`.
        thicken: let the wall grow where the pieces of the design lie too far apart to make one body.

    Returns:
        A watertight mesh of one body with positive volume, in mm, z up, centred on its box. `metadata` holds the
        genome and the facts of its making: "design_id", "genome", "size_mm", "wall_mm" (asked for), "wall_used_mm",
        "gap", "gap_mm", "voxel_mm", "cover" (method), "cover_error_mm" (a proven bound, see `covering_points`),
        "attractor_scale" and "attractor_offset_mm" (mm = scale * point + offset, for points of the attractor) and more,
        all fit for JSON.

    Raises:
        InputError: the genome is invalid or a parameter out of range.
        FarmError: the design would not be one body, or does not fit into memory; says what would pass.
    """
    return make_solid(as_genome(genome), SolidParameters(size_mm, wall_mm, resolution, thicken))


def make_solid(
    genome: Genome,
    parameters: SolidParameters,
    progress: Progress | None = None,
    foreseen: Callable[[int], None] | None = None,
) -> trimesh.Trimesh:
    """`solidify` for a valid genome and parameters.

    `progress` hears of each stage as it begins (`STAGES`), `foreseen` of the bytes that it will take at most, before it
    takes them.

    The mesh is centred on the box of its body: base, bail and sprue reach beyond it. Where sheets nearly touch, pits of
    a voxel between them can leave no wall; if the wall that rays measure is too thin, the solid is made once more with
    the pits filled, and the better one is returned: its metadata then has "pits_filled_mm", the radius of that closing,
    and its surface may lie 1.2 times as much farther out. "wall_measured_mm" says what came of it.
    """
    begin = beginner(progress)
    mesh = _made(genome, parameters, parameters.closing_mm, begin, foreseen)
    pits = _PITS * parameters.voxel_mm
    if _is_thin(mesh) and parameters.closing_mm < pits:
        filled = _made(genome, parameters, pits, begin, foreseen)
        if filled.metadata["wall_measured_mm"] > mesh.metadata["wall_measured_mm"]:
            mesh = filled
            mesh.metadata["pits_filled_mm"] = pits
    begin("made")
    return mesh


def _is_thin(mesh: trimesh.Trimesh) -> bool:
    return bool(mesh.metadata["wall_measured_mm"] < WALL_TOLERANCE * mesh.metadata["wall_mm"])


def _made(
    genome: Genome,
    parameters: SolidParameters,
    closing_mm: float,
    begin: Begin,
    foreseen: Callable[[int], None] | None,
) -> trimesh.Trimesh:
    begin("gap")
    name = genome.design_id[:8]
    gap, contacts, enclosure = measure_gap(genome)
    box, attained = settled_box(genome, enclosure)
    side = float(longest_side(attained))
    if not side > 0.0:
        raise InputError(f"design {name} is a single point; all its maps have the same fixed point")
    plan = plan_solid(gap, parameters, name)
    scale = plan.attractor_mm / side
    closing = closing_mm / parameters.voxel_mm
    room = closing + _ROOM if closing else 0.0
    grid = grid_around(box * scale, plan.radius_mm, parameters.voxel_mm, room * parameters.voxel_mm)
    begin("cover")
    memory = predict_memory(genome, enclosure, grid, scale, offsets=closing > 0.0 or parameters.shell_mm > 0.0)
    check_memory(memory, parameters.resolution, name)
    if foreseen is not None:
        foreseen(memory.total)
    skeleton, cover, struts = _points(genome, contacts, enclosure, scale, grid, parameters)
    begin("distance field")
    field = distance_field(skeleton, grid, room)
    facts: dict[str, Any] = {
        "cover": cover.method,
        "cover_points": len(cover.points),
        "cover_error_mm": cover.error * scale,
        "memory_predicted": memory.total,
    }
    del skeleton, cover  # a quarter of the memory of the stages to come
    if closing:
        close_slits(field, closing, 0.5 * parameters.wall_mm / parameters.voxel_mm)
    begin("one body")
    body = _one_body(field, parameters, name)
    hollows = _hollowed(field, parameters, name)
    surface = surface_of(field, grid, begin)
    lowest, highest = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    centre, fit = 0.5 * (lowest + highest), parameters.size_mm / float((highest - lowest).max())
    surface = Surface((surface.vertices - centre) * fit, surface.faces, surface.genus)
    surface = with_attachments(surface, parameters, design_code(genome.design_id))
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    mesh.metadata.update(_metadata(genome, parameters, plan, gap, body, surface))
    placed = {"attractor_scale": scale * fit, "attractor_offset_mm": [float(-fit * along) for along in centre]}
    mesh.metadata.update(facts | placed)
    if parameters.engrave:
        mesh.metadata["engraved_mm"] = DEPTH * parameters.wall_mm
    mesh.metadata["wall_measured_mm"] = measured_wall(mesh)
    if parameters.bridges:
        mesh.metadata["struts"] = struts
    if hollows is not None:
        mesh.metadata.update(hollows=hollows.count, hollowed_share=hollows.share)
    return mesh


def _one_body(field: npt.NDArray[np.float32], parameters: SolidParameters, name: str) -> BodyReport:
    leave_zero(field)
    body = make_one_body(field)
    if body.share < _WHOLE:
        raise FarmError(
            f"design {name} came out in {body.bodies} bodies, {body.share:.1%} in the largest: raise the resolution "
            f"({parameters.resolution}) or the wall ({parameters.wall_mm:g} mm)"
        )
    return body


def _hollowed(field: npt.NDArray[np.float32], parameters: SolidParameters, name: str) -> Hollows | None:
    """Hollow what is too thick, if that is asked for; None if it is not."""
    if parameters.shell_mm == 0.0:
        return None
    lengths = (parameters.shell_mm, parameters.shell_above_mm, parameters.drain_mm, 0.5 * parameters.wall_mm)
    shell, above, drain, least = (length / parameters.voxel_mm for length in lengths)
    try:
        hollows = hollow(field, shell, above, drain, least, downwards=parameters.base == "none")
    except FarmError as error:
        raise FarmError(f"design {name}: {error}") from None
    if hollows.count:
        _one_body(field, parameters, name)
    return hollows


def _points(
    genome: Genome,
    contacts: FloatArray,
    enclosure: Enclosure,
    scale: float,
    grid: Grid,
    parameters: SolidParameters,
) -> tuple[Skeleton, Cover, int]:
    """What the balls are about, in mm; the cover of the attractor that it is made of; and the number of struts."""
    system = system_of(genome)
    covering = covering_points(genome, enclosure, grid.spacing / scale)
    if covering is None:
        raise FarmError(
            f"design {genome.design_id[:8]} needs more than {MAX_CELL_POINTS} points at a voxel of "
            f"{grid.spacing:.3g} mm; lower the resolution"
        )
    points = copied(covering.points, system)
    spacing, wall = grid.spacing / scale, 2.0 * grid.radius * grid.spacing / scale
    risky = max(2.0 * grid.radius - 4.0 * grid.cell, 0.5) * spacing
    if parameters.bridges:
        risky = min(risky, HIDDEN * wall)
    ends = copied(contact_points(genome, contacts, enclosure, risky), system)
    fixed = np.concatenate([extreme_points(points), ends, joints(system, genome.n_maps)])
    struts = np.empty((0, 2, 3))
    if parameters.bridges:
        struts = copied(strut_ends(genome, contacts, enclosure, wall).reshape(-1, 3), system).reshape(-1, 2, 3)
        points = np.concatenate([points, along(struts, spacing)])
    return Skeleton(points * scale, fixed * scale), covering, len(struts)


def _metadata(
    genome: Genome,
    parameters: SolidParameters,
    plan: SolidPlan,
    gap: float,
    body: BodyReport,
    surface: Surface,
) -> dict[str, Any]:
    """Everything that made the mesh, fit for JSON."""
    return {
        "design_id": genome.design_id,
        "genome": genome.genes.tolist(),
        "phenotype": asdict(genome.phenotype),
        "probabilities": None if genome.probabilities is None else list(genome.probabilities),
        "symmetry": genome.symmetry,
        "parameters": parameters.asked_for,
        "parameters_hash": parameters.hash,
        "pipeline": PIPELINE_VERSION,
        "units": "mm",
        "up": "z",
        "size_mm": parameters.size_mm,
        "wall_mm": parameters.wall_mm,
        "wall_used_mm": 2.0 * plan.radius_mm,
        "thickened": plan.thickened,
        "gap": gap,
        "gap_mm": gap * plan.attractor_mm,
        "similarity_dimension": similarity_dimension(genome),
        "attractor_mm": plan.attractor_mm,
        "voxel_mm": parameters.voxel_mm,
        "cavities_filled": body.cavities,
        "genus": surface.genus,
    }
