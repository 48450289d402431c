"""How much memory a solid will take, said before it takes it, from a coarse search in some milliseconds.

The grid is known. A search over cells as wide as the wall tells how much of it the attractor fills; the sides of those
cells that no other one touches tell how many triangles there will be. The words of a cut set are counted by renewal
theory: (N - 1) / (s m) (R / r)^s of them, s the similarity dimension, m the mean of -ln rho under the weights rho^s.
The constants are measured, not proven: `tests/solid/test_memory.py` holds them against what processes take.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import FarmError
from fractal_farm.ifs.cell_search import cells_of, search_cells
from fractal_farm.ifs.enclosure import Enclosure
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.random_iteration import system_of
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from fractal_farm.solid.skeleton import MAX_CELL_POINTS, MAX_CUT_SET
from fractal_farm.solid.voxels import Grid

MAX_BYTES = 4_000_000_000

_COARSE_POINTS = 2_000_000
_POINT = 24  # bytes
_BODY = 10  # bytes a sample: field, labels and a mask
_OFFSETS = 32  # bytes a sample more, for closing and hollows
_FIELD = 4  # bytes a sample
_FACE = 560  # bytes a triangle, simplification included
_MARGIN = 1.1
_ALWAYS = 10_000_000
# Triangles for each square voxel of the sides of coarse cells: where these are many, and where they are few and large.
_FEWER, _MORE = 2.6, 3.5
_BOX_FACES = 1.5  # triangles for each square voxel of the box of a compact solid


@dataclass(frozen=True)
class Memory:
    """Bytes that the stages of a solid take at most, beyond what the process had before.

    Attributes:
        cover: points of the attractor, as they are found.
        field: distance field and the points that it is drawn from.
        body: the search for one body without cavities.
        surface: marching cubes and simplification.
    """

    cover: int
    field: int
    body: int
    surface: int

    @property
    def total(self) -> int:
        """The most that is taken at any time."""
        return int(_MARGIN * max(self.cover, self.field, self.body, self.surface)) + _ALWAYS


def predict_memory(genome: Genome, enclosure: Enclosure, grid: Grid, scale: float, *, offsets: bool = False) -> Memory:
    """What a solid will take.

    Args:
        genome: a valid genome.
        enclosure: of its attractor, filled.
        grid: of the solid.
        scale: mm for each IFS unit.
        offsets: whether it is closed or hollowed, too.
    """
    system = system_of(genome)
    voxel = grid.spacing / scale
    copies = int(system.n_copies[0])
    width = 2.0 * grid.radius  # of a coarse cell, in voxels
    dimension = min(similarity_dimension(genome), 3.0) if genome.phenotype.family == "similarity" else 3.0
    cells = cells_of(system.maps, genome.n_maps, enclosure)
    coarse = search_cells(cells, enclosure, width * voxel, _COARSE_POINTS)
    if coarse is None:  # finer than any that is sensible: everything may be filled
        filled, faces = float(grid.samples), 2.0 * float(grid.samples)
    else:
        filled = 1.1 * len(coarse) * width**dimension
        sides = copies * width**2 * _bare_sides(coarse, enclosure, width * voxel)
        whole = _BOX_FACES * _box_area(grid)
        faces = max(_FEWER * sides, min(_MORE * sides, whole))
    words = _words(genome, enclosure, 0.5 * voxel)
    points = words if words <= MAX_CUT_SET else min(filled, float(MAX_CELL_POINTS))
    placed = points * copies
    kept = min(placed, 1.5 * copies * filled / grid.cell**dimension)
    return Memory(
        cover=int(2.1 * _POINT * max(points, min(words, MAX_CUT_SET)) + grid.samples / 8.0),
        field=int(_FIELD * grid.samples + _POINT * (points + placed * (1 if copies == 1 else 2) + 2.0 * kept)),
        body=(_BODY + _OFFSETS * offsets) * grid.samples,
        surface=int(_FIELD * grid.samples + _FACE * faces),
    )


def check_memory(memory: Memory, resolution: int | None, name: str) -> None:
    """Refuse what does not fit into MAX_BYTES; raises FarmError with a resolution that does."""
    if memory.total > MAX_BYTES:
        fitting = math.floor(0.98 * (resolution or 0) * math.sqrt(MAX_BYTES / memory.total))
        raise FarmError(
            f"design {name} at a resolution of {resolution} needs {memory.total / 1e9:.1f} GB, allowed are "
            f"{MAX_BYTES / 1e9:.0f}: resolution <= {fitting}"
        )


def _words(genome: Genome, enclosure: Enclosure, radius: float) -> float:
    """Number of words of a cut set, infinity where no formula tells."""
    if genome.phenotype.family != "similarity":
        return math.inf
    ratios = enclosure.contraction[: genome.n_maps]
    dimension = similarity_dimension(genome)
    mean = -float(np.sum(ratios**dimension * np.log(ratios)))
    if not mean * dimension > 0.0:
        return 1.0
    spread = (genome.n_maps - 1) / (dimension * mean)
    return float(1.2 * max(spread, 1.0) * max(float(enclosure.anchor[3]) / radius, 1.0) ** dimension)


def _bare_sides(points: npt.NDArray[np.float64], enclosure: Enclosure, width: float) -> int:
    """Sides of the cells with points that face an empty one."""
    places = np.floor((points - enclosure.box[0]) / width).astype(np.int64)
    places += 1 - places.min(axis=0)
    filled = np.zeros(places.max(axis=0) + 2, np.bool_)
    filled[tuple(places.T)] = True
    return sum(int(np.count_nonzero(filled != np.roll(filled, 1, axis))) for axis in range(3))


def _box_area(grid: Grid) -> float:
    """Surface of the grid, in squares of its voxels."""
    a, b, c = grid.shape
    return 2.0 * (a * b + b * c + c * a)
