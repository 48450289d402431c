"""Genome -> printable solid (DESIGN section 6): the order of things.

Gap and box from the address tree; scale and wall from them; a cover of the attractor and its copies at half a voxel;
the distance field of the balls about it; one body without cavities; marching cubes and simplification; the last
fraction of a voxel of the size by scaling. Never from the fitness cloud.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from fractal_farm.errors import FarmError, InputError
from fractal_farm.ifs.copies import copied, joints
from fractal_farm.ifs.enclosure import Enclosure
from fractal_farm.ifs.gap import measure_gap
from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.ifs.random_iteration import system_of
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from fractal_farm.ifs.support import longest_side
from fractal_farm.solid.body import BodyReport, make_one_body
from fractal_farm.solid.parameters import PIPELINE_VERSION, SolidParameters
from fractal_farm.solid.plan import SolidPlan, plan_solid
from fractal_farm.solid.skeleton import (
    MAX_CELL_POINTS,
    MAX_CUT_SET,
    contact_points,
    covering_points,
    extreme_points,
    settled_box,
)
from fractal_farm.solid.surface import Surface, surface_of
from fractal_farm.solid.voxels import Grid, Skeleton, distance_field, grid_around

MAX_BYTES = 4_000_000_000
_BYTES_PER_SAMPLE = 24
_BYTES_PER_POINT = 120
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
        "gap", "gap_mm", "voxel_mm" and more, all fit for JSON.

    Raises:
        InputError: the genome is invalid or a parameter out of range.
        FarmError: the design would not be one body, or does not fit into memory; says what would pass.
    """
    return make_solid(as_genome(genome), SolidParameters(size_mm, wall_mm, resolution, thicken))


def make_solid(genome: Genome, parameters: SolidParameters) -> trimesh.Trimesh:
    """`solidify` for a valid genome and parameters."""
    name = genome.design_id[:8]
    gap, contacts, enclosure = measure_gap(genome)
    box, attained = settled_box(genome, enclosure)
    side = float(longest_side(attained))
    if not side > 0.0:
        raise InputError(f"design {name} is a single point; all its maps have the same fixed point")
    plan = plan_solid(gap, parameters, name)
    scale = plan.attractor_mm / side
    grid = grid_around(box * scale, plan.radius_mm, parameters.voxel_mm)
    _check_memory(grid, parameters, name)
    points, method = _points(genome, contacts, enclosure, scale, grid)
    field = distance_field(points, grid)
    body = make_one_body(field)
    if body.share < _WHOLE:
        raise FarmError(
            f"design {name} came out in {body.bodies} bodies, {body.share:.1%} in the largest: raise the resolution "
            f"({parameters.resolution}) or the wall ({parameters.wall_mm:g} mm)"
        )
    surface = surface_of(field, grid)
    lowest, highest = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    fitted = (surface.vertices - 0.5 * (lowest + highest)) * (parameters.size_mm / float((highest - lowest).max()))
    mesh = trimesh.Trimesh(fitted, surface.faces, process=False)
    mesh.metadata.update(_metadata(genome, parameters, plan, gap, method, body, surface))
    return mesh


def _points(
    genome: Genome, contacts: FloatArray, enclosure: Enclosure, scale: float, grid: Grid
) -> tuple[Skeleton, str]:
    """What the balls are about, in mm, and the method that covered the attractor."""
    system = system_of(genome)
    covering = covering_points(genome, enclosure, grid.spacing / scale)
    if covering is None:
        raise FarmError(
            f"design {genome.design_id[:8]} needs more than {MAX_CELL_POINTS} points at a voxel of "
            f"{grid.spacing:.3g} mm; lower the resolution"
        )
    points, method = copied(covering[0], system), covering[1]
    risky = max(2.0 * grid.radius - 4.0 * grid.cell, 0.5) * grid.spacing / scale
    ends = copied(contact_points(genome, contacts, enclosure, risky), system)
    fixed = np.concatenate([extreme_points(points), ends, joints(system, genome.n_maps)])
    return Skeleton(points * scale, fixed * scale), method


def _check_memory(grid: Grid, parameters: SolidParameters, name: str) -> None:
    needed = grid.samples * _BYTES_PER_SAMPLE + MAX_CUT_SET * _BYTES_PER_POINT
    if needed > MAX_BYTES:
        share = (MAX_BYTES - MAX_CUT_SET * _BYTES_PER_POINT) / (grid.samples * _BYTES_PER_SAMPLE)
        raise FarmError(
            f"design {name} at a resolution of {parameters.resolution} needs {needed / 1e9:.1f} GB, allowed are "
            f"{MAX_BYTES / 1e9:.0f}: resolution <= {math.floor(parameters.resolution * share ** (1 / 3))}"
        )


def _metadata(
    genome: Genome,
    parameters: SolidParameters,
    plan: SolidPlan,
    gap: float,
    method: str,
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
        "parameters": asdict(parameters),
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
        "cover": method,
        "cavities_filled": body.cavities,
        "genus": surface.genus,
    }
