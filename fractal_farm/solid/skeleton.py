"""The points that a solid is built about: a cover of the attractor, and those that must not be lost.

Where the voxel grid keeps one point of many, the six outermost points of the attractor and the ends of the edges of the
spanning tree are kept as they are, the latter in every piece where losing them could open a gap: F_w of the first-level
edges, for all words w that do not shorten them below the threshold.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import FarmError
from fractal_farm.ifs.cell_search import cells_of, search_cells
from fractal_farm.ifs.cover import MAX_BOX_NODES, cut_set_of, union_of
from fractal_farm.ifs.enclosure import Enclosure, compose, distance, image, make_identity
from fractal_farm.ifs.gap import BOX_TOLERANCE
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.random_iteration import system_of
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from fractal_farm.ifs.support import longest_side, tighten_box

MAX_CUT_SET = 3_000_000
MAX_CELL_POINTS = 20_000_000
MAX_CONTACTS = 200_000
_SETTLED = 0.01
_SETTLING_ROUNDS = 3
_SETTLING_CELLS = 64
_MAX_SETTLING_POINTS = 1_000_000

FloatArray = npt.NDArray[np.float64]


class Cover(NamedTuple):
    """Points that cover an attractor, and how closely.

    Attributes:
        points: (n, 3) float64, all of them on the attractor, IFS units.
        method: "cut set" or "cell search".
        error: every point of the attractor lies within this of one of `points`, IFS units; proven for both methods.
    """

    points: FloatArray
    method: str
    error: float


def settled_box(genome: Genome, enclosure: Enclosure) -> tuple[FloatArray, FloatArray]:
    """Two boxes (2, 3) of the shape: that holds it, and that it reaches on all six sides; those of `enclosure` settle.

    Where branch and bound could not bring the boxes of the enclosure together, they come from a search over cells. That
    happens to maps that overlap many times over (similarity dimension above 5); the box is then as good as the
    search, which no proof bounds closely but which finds clouds of that kind without holes.

    Raises:
        FarmError: the search does not end either.
    """
    maps = system_of(genome).maps
    tighten_box(maps, genome.n_maps, BOX_TOLERANCE, 0.0, MAX_BOX_NODES, enclosure)
    cells = cells_of(maps, genome.n_maps, enclosure)
    for _ in range(_SETTLING_ROUNDS):
        side = longest_side(enclosure.attained)
        if np.abs(enclosure.box - enclosure.attained).max() <= _SETTLED * side:
            break
        spacing = side / _SETTLING_CELLS
        points = search_cells(cells, enclosure, spacing, _MAX_SETTLING_POINTS)
        if points is None:
            break
        enclosure.attained[0] = np.minimum(enclosure.attained[0], points.min(axis=0))
        enclosure.attained[1] = np.maximum(enclosure.attained[1], points.max(axis=0))
        enclosure.box[0] = np.maximum(enclosure.box[0], enclosure.attained[0] - spacing)
        enclosure.box[1] = np.minimum(enclosure.box[1], enclosure.attained[1] + spacing)
    box, attained = union_of(genome, enclosure, BOX_TOLERANCE, 0.0)
    if np.abs(box - attained).max() > 4.0 * _SETTLED * longest_side(attained):
        raise FarmError(
            f"design {genome.design_id[:8]} is a cloud without a definite outline, its maps overlap too heavily "
            f"(similarity dimension {similarity_dimension(genome):.1f}); choose one below 5"
        )
    return box, attained


def covering_points(genome: Genome, enclosure: Enclosure, voxel: float) -> Cover | None:
    """Points of the attractor, dense enough for voxels of this edge (IFS units); None if there are too many.

    "cut set": every point of the attractor is within half a voxel, by construction. "cell search", for maps that
    overlap heavily: one point in each voxel that the search meets. Proven is diagonal / (1 - q), q the contraction of
    the words that it uses (`cell_search`): 3.5 voxels where they halve the attractor, more where a map contracts less
    than 0.999. In tests every point of long orbits and of finer searches was within one diagonal, 1.8 voxels, and 99 %
    of them within one voxel.
    """
    points = cut_set_of(genome, enclosure, 0.5 * voxel, MAX_CUT_SET)
    if points is not None:
        return Cover(points, "cut set", 0.5 * voxel)
    cells = cells_of(system_of(genome).maps, genome.n_maps, enclosure)
    points = search_cells(cells, enclosure, voxel, MAX_CELL_POINTS)
    return None if points is None else Cover(points, "cell search", voxel / cells.spacing)


def extreme_points(points: FloatArray) -> FloatArray:
    """(6, 3): the lowest and the highest of (n, 3) points along each axis."""
    outermost: FloatArray = points[np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])]
    return outermost


def contact_points(genome: Genome, contacts: FloatArray, enclosure: Enclosure, shortest: float) -> FloatArray:
    """Ends of the edges between pieces, in all pieces of the attractor where they are longer than `shortest`.

    Args:
        genome: a valid genome.
        contacts: (N - 1, 2, 3) float64, the first-level edges, IFS units (`measure_gap`).
        enclosure: filled `Enclosure`.
        shortest: IFS units, above 0.

    Returns:
        (m, 3) float64, two for each edge; the longest MAX_CONTACTS at most.
    """
    maps = system_of(genome).maps
    points: FloatArray = _contacts(maps, genome.n_maps, enclosure.contraction, contacts, shortest, MAX_CONTACTS)
    return points


@kernel
def _contacts(maps, n_maps, contraction, contacts, shortest, max_contacts):  # type: ignore[no-untyped-def]
    """Breadth first over words, as long as the longest edge stays longer than `shortest`."""
    longest = 0.0
    for edge in contacts:
        longest = max(
            longest,
            distance(edge[0, 0], edge[0, 1], edge[0, 2], edge[1, 0], edge[1, 1], edge[1, 2]),
        )
    words = np.empty((max_contacts + n_maps, 13))
    make_identity(words[0])
    words[0, 12] = 1.0
    count = 1 if longest > shortest else 0
    done = 0
    while done < count and count < max_contacts // (2 * len(contacts)):
        for i in range(n_maps):
            size = words[done, 12] * contraction[i]
            if size * longest > shortest:
                compose(words[done], maps[i], words[count])
                words[count, 12] = size
                count += 1
        done += 1
    points = np.empty((2 * len(contacts) * count, 3))
    place = 0
    for k in range(count):
        for edge in contacts:
            for end in edge:
                points[place, 0], points[place, 1], points[place, 2] = image(words[k], end[0], end[1], end[2])
                place += 1
    return points
