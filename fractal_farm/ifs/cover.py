"""Points that cover the attractor with its copies, and its exact box (DESIGN section 6, point 1).

The cover is a cut set of the address tree: words w, outermost map first, are lengthened until the piece f_w(A) lies
within the radius of its point f_w(a), a a point of the attractor. No random numbers, no probabilities, and no part of
the attractor is missed, however rarely random iteration would visit it. Where overlapping maps make the tree too
large, a search over cells (`cell_search`) keeps one point of the attractor in each.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import FarmError, InputError
from fractal_farm.ifs.cell_search import cells_of, search_cells
from fractal_farm.ifs.copies import copied
from fractal_farm.ifs.enclosure import (
    Enclosure,
    compose,
    contraction_of,
    copy_numbers,
    enclose,
    image,
    make_identity,
    new_enclosure,
)
from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.random_iteration import system_of
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from fractal_farm.ifs.support import copies_box, longest_side, tighten_box

MAX_POINTS = 5_000_000
MAX_BOX_NODES = 500_000
_BOX_TOLERANCE = 1e-3  # of the longest side; the box of a cover only lays out the cells of a search
_MARGIN = 1.01  # over what is known to be within reach
_ROUNDING = 1e-9
_STACK = 256
_WORD = 13  # twelve numbers of the map, and its contraction
_FIRST_POINTS = 1024  # room at the start; it doubles

FloatArray = npt.NDArray[np.float64]


def attractor_bounds(genome: Genome | npt.ArrayLike, tolerance: float) -> FloatArray:
    """The box of the attractor and its copies, from the address tree and never from random points.

    Args:
        genome: a `Genome` or an (N, 7) array.
        tolerance: each side of the box may lie this far outside of the exact one, IFS units, above 0.

    Returns:
        (2, 3) float64, lower and upper corner; the whole attractor lies inside.

    Raises:
        InputError: the genome is invalid or the tolerance is not above 0.
        FarmError: the maps overlap too heavily for this tolerance; says which one can be had.
    """
    valid = as_genome(genome)
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        raise InputError(f"tolerance is {tolerance}; give a length above 0 in IFS units")
    box, attained = union_of(valid, enclosure_of(valid, 0.0, tolerance), 0.0, tolerance)
    reached = float(np.abs(box - attained).max())
    if reached > tolerance:
        raise FarmError(
            f"the box of design {valid.design_id[:8]} is known to {reached:.3g} only, not to {tolerance:.3g}: its maps "
            f"overlap heavily (similarity dimension {similarity_dimension(valid):.1f}); ask for a tolerance of "
            f"{_MARGIN * reached:.3g} or more"
        )
    return box


def attractor_cover(genome: Genome | npt.ArrayLike, radius: float, max_points: int = MAX_POINTS) -> FloatArray:
    """Points of the attractor and its copies such that every point of them lies within `radius` of one of these.

    Args:
        genome: a `Genome` or an (N, 7) array.
        radius: IFS units, above 0.
        max_points: upper bound of the number of points of a copy; memory is some 50 bytes for each.

    Returns:
        (m, 3) float64, one copy after the other, each in the order of the address tree, or of discovery where the
        search over cells was needed.

    Raises:
        InputError: the genome is invalid, or a number out of range.
        FarmError: the cover needs more points; says what would pass.
    """
    valid = as_genome(genome)
    if not (math.isfinite(radius) and radius > 0.0):
        raise InputError(f"radius is {radius}; give a length above 0 in IFS units")
    if max_points < 1:
        raise InputError(f"max_points is {max_points}; allow at least 1")
    enclosure = enclosure_of(valid, _BOX_TOLERANCE, 0.0)
    points = cut_set_of(valid, enclosure, radius, max_points)
    if points is None:
        cells = cells_of(system_of(valid).maps, valid.n_maps, enclosure)
        points = search_cells(cells, enclosure, radius * cells.spacing, max_points)
    if points is None:
        side = longest_side(enclosure.attained)
        raise FarmError(
            f"a cover of design {valid.design_id[:8]} within {radius:.3g} needs more than {max_points} points; ask for "
            f"a larger radius (the longest side of the attractor is {side:.3g}) or a larger max_points"
        )
    return copied(points, system_of(valid))


def enclosure_of(genome: Genome, relative: float, absolute: float) -> Enclosure:
    """The enclosure of a valid genome's attractor, its boxes as close as asked for (`tighten_box`) or as can be had."""
    maps = system_of(genome).maps
    enclosure: Enclosure = new_enclosure()
    enclose(maps, genome.n_maps, enclosure)
    tighten_box(maps, genome.n_maps, relative, absolute, MAX_BOX_NODES, enclosure)
    return enclosure


def union_of(genome: Genome, enclosure: Enclosure, relative: float, absolute: float) -> tuple[FloatArray, FloatArray]:
    """Two boxes (2, 3) of the attractor with its copies: that holds them, and that they reach on all six sides."""
    union = np.empty((2, 2, 3))
    copies_box(system_of(genome), genome.n_maps, relative, absolute, MAX_BOX_NODES, enclosure, union)
    return union[0], union[1]


def cut_set_of(genome: Genome, enclosure: Enclosure, radius: float, max_points: int) -> FloatArray | None:
    """The cut set of a valid genome's attractor, or None where it has more than `max_points` words.

    A cut set of similarities has at least (reach / radius)^s words, s the similarity dimension, since rho_w^s adds up
    to 1 over it: hopeless ones are not begun.
    """
    reach = float(enclosure.anchor[3])
    if genome.phenotype.family == "similarity" and reach > radius:
        words = similarity_dimension(genome) * math.log(reach / radius)
        if words > math.log(max_points) + _ROUNDING:
            return None
    points, complete = cut_set(system_of(genome).maps, genome.n_maps, enclosure, radius, max_points)
    return points if complete else None


@kernel
def cut_set(maps, n_maps, enclosure, radius, max_points):  # type: ignore[no-untyped-def]
    """Depth-first search of the address tree down to pieces that lie within `radius` of their point.

    Args:
        maps: (M, 12) float64 maps, the first n_maps count.
        n_maps: number of maps.
        enclosure: filled `Enclosure`.
        radius: IFS units.
        max_points: where to give up.

    Returns:
        (m, 3) float64 points, and whether they are complete.
    """
    anchor = enclosure.anchor
    small = radius / anchor[3] if anchor[3] > radius else 1.0
    stack = np.empty((_STACK, _WORD))
    make_identity(stack[0])
    stack[0, 12] = 1.0
    height = 1
    points = np.empty((min(_FIRST_POINTS, max_points), 3))
    count = 0
    word = np.empty(_WORD)
    while height > 0:
        height -= 1
        copy_numbers(stack[height], word, _WORD)
        size = contraction_of(word, word[12], enclosure.exact[0])
        if size <= small:
            if count == max_points:
                return points, False
            if count == len(points):
                points = lengthened(points, min(2 * count, max_points))
            points[count, 0], points[count, 1], points[count, 2] = image(word, anchor[0], anchor[1], anchor[2])
            count += 1
            continue
        if height + n_maps > len(stack):
            stack = lengthened(stack, 2 * len(stack))
        for i in range(n_maps):
            compose(word, maps[i], stack[height])
            stack[height, 12] = size * enclosure.contraction[i]
            height += 1
    return points[:count], True


@kernel
def lengthened(rows, length):  # type: ignore[no-untyped-def]
    """A copy of `rows` with room for `length` of them."""
    longer = np.empty((length, rows.shape[1]))
    longer[: len(rows)] = rows
    return longer
