"""Gap of a design: how far apart its pieces are (DESIGN section 6, point 2).

The gap is the longest edge of the minimum spanning tree between the first-level pieces f_i(A), over the longest side of
the attractor's exact box. Deeper gaps are contracted by the maps, so the points within r of the attractor are one body
as soon as 2 r >= gap x size. Distances are found by branch and bound over pairs of pieces f_v(A), f_w(A): a pair lies
between the distance of its balls and that of two points of the attractor.

The copies of a symmetric design share points (`symmetry`), so that the edges within one of them are all there are; they
are measured by the box of all copies. Where copies bridge each other's edges, that is more than is needed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.enclosure import (
    Enclosure,
    compose,
    contraction_of,
    copy_numbers,
    distance,
    enclose,
    image,
    make_identity,
    new_enclosure,
)
from fractal_farm.ifs.genome import MAX_MAPS, Genome, as_genome
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.random_iteration import system_of
from fractal_farm.ifs.support import copies_box, longest_side, tighten_box

TOLERANCE = 1e-3
BOX_TOLERANCE = 2e-4
MAX_PIECES = 65_536
MAX_PAIRS = 65_536
MAX_BOX_NODES = 4_000
_POINT = 1e-12
_SMALLEST = 1e-300  # distance whose reciprocal is still a number


class GapWorkspace(NamedTuple):
    """Working space of `gap_of_maps`, allocated once for many systems.

    Attributes:
        enclosure: `Enclosure`, afterwards that of the attractor.
        words: (MAX_PIECES, 12) float64, the words of the address tree as 3 x 4 maps.
        pieces: (MAX_PIECES, 8) float64, for each: centre, a point of the attractor, radius, contraction.
        children: (MAX_PIECES,) int64, index of the first of N children, 0 where there are none yet.
        n_pieces: (1,) int64, how many there are.
        keys: (MAX_PAIRS,) float64, a heap of pairs of pieces.
        pairs: (MAX_PAIRS, 2) int64, the two pieces of each.
        closest: (MAX_MAPS, MAX_MAPS, 2, 3) float64, the closest points found of pieces i > j.
        contacts: (MAX_MAPS, 2, 3) float64, those of the N - 1 edges of the spanning tree.
        union: (2, 2, 3) float64, the boxes of all copies, see `copies_box`.
    """

    enclosure: Enclosure
    words: npt.NDArray[np.float64]
    pieces: npt.NDArray[np.float64]
    children: npt.NDArray[np.int64]
    n_pieces: npt.NDArray[np.int64]
    keys: npt.NDArray[np.float64]
    pairs: npt.NDArray[np.int64]
    closest: npt.NDArray[np.float64]
    contacts: npt.NDArray[np.float64]
    union: npt.NDArray[np.float64]


def gap(genome: Genome | npt.ArrayLike) -> float:
    """Longest edge of the minimum spanning tree between the pieces f_i(A), over the longest side of the shape's box.

    Args:
        genome: a `Genome` or an (N, 7) array.

    Returns:
        The gap, dimensionless, at least 0: never below the true value, and above it by at most `TOLERANCE`, except
        where the search ends at its bound on pairs (one evolved design in a hundred, pieces that interlock closely);
        there it is the distance of the closest points found, so that a wall of gap x size still makes one body.

    Raises:
        InputError: the genome is invalid.
    """
    value, _, _ = measure_gap(as_genome(genome))
    return value


def gaps_within(genomes: list[Genome], limit: float) -> npt.NDArray[np.bool_]:
    """Whether the gap of each genome is at most a limit: what `gap` would say, at a fraction of its cost.

    A search ends as soon as its bounds decide; only pieces whose distance is close to the limit take long.

    Args:
        genomes: valid genomes.
        limit: dimensionless, at least 0.

    Returns:
        (len(genomes),) bool.
    """
    workspace = new_gap_workspace()
    return np.array([gap_is_within(system_of(one), one.n_maps, limit, workspace) for one in genomes], np.bool_)


def measure_gap(genome: Genome) -> tuple[float, npt.NDArray[np.float64], Enclosure]:
    """What a solid is planned from.

    Args:
        genome: a valid genome.

    Returns:
        The gap; (N - 1, 2, 3) float64, the two points where each edge of the spanning tree ends, IFS units; and the
        enclosure of the attractor.
    """
    workspace = new_gap_workspace()
    system = system_of(genome)
    value, _, _ = gap_of_maps(system.maps, genome.n_maps, workspace)
    value *= _share(system, genome.n_maps, workspace)
    return float(value), workspace.contacts[: genome.n_maps - 1].copy(), workspace.enclosure


@kernel
def new_gap_workspace():  # type: ignore[no-untyped-def]
    """Working space for `gap_of_maps`."""
    return GapWorkspace(
        new_enclosure(),
        np.empty((MAX_PIECES, 12)),
        np.empty((MAX_PIECES, 8)),
        np.empty(MAX_PIECES, np.int64),
        np.zeros(1, np.int64),
        np.empty(MAX_PAIRS),
        np.empty((MAX_PAIRS, 2), np.int64),
        np.zeros((MAX_MAPS, MAX_MAPS, 2, 3)),
        np.zeros((MAX_MAPS, 2, 3)),
        np.zeros((2, 2, 3)),
    )


@kernel
def gap_of_maps(maps, n_maps, workspace):  # type: ignore[no-untyped-def]
    """The gap of one system of maps without symmetry; see `gap`.

    Args:
        maps: (M, 12) float64, row-major 3 x 4 maps in canonical order, the first n_maps count (`System.maps`, or an
            (N, 3, 4) array reshaped); every spectral norm below 1.
        n_maps: number of maps.
        workspace: `GapWorkspace`; leaves the attractor's enclosure behind.

    Returns:
        The gap; by how much it can exceed the true one; and the number of pairs that were split.
    """
    side = _side_of(maps, n_maps, workspace)
    if side == 0.0:
        return 0.0, 0.0, 0
    longest, uncertain, splits = _spanning_tree(maps, n_maps, 0.0, math.inf, TOLERANCE * side, workspace)
    return longest / side, uncertain / side, splits


@kernel
def gap_is_within(system, n_maps, limit, workspace):  # type: ignore[no-untyped-def]
    """Whether the gap of one `System`, its copies placed, is at most `limit`; see `gaps_within`."""
    side = _side_of(system.maps, n_maps, workspace)
    allowed = limit * side / _share(system, n_maps, workspace)
    longest, _, _ = _spanning_tree(system.maps, n_maps, allowed, allowed, TOLERANCE * side, workspace)
    return longest <= allowed


@kernel
def _share(system, n_maps, workspace):  # type: ignore[no-untyped-def]
    """Longest side of the attractor over that of all its copies; 1 for a point."""
    if system.n_copies[0] == 1:
        return 1.0
    copies_box(system, n_maps, BOX_TOLERANCE, 0.0, MAX_BOX_NODES, workspace.enclosure, workspace.union)
    side = longest_side(workspace.enclosure.attained)
    return side / longest_side(workspace.union[1]) if side > 0.0 else 1.0


@kernel
def _side_of(maps, n_maps, workspace):  # type: ignore[no-untyped-def]
    """Longest side of the box of the attractor, IFS units, 0 for a point; leaves its enclosure and its first pieces."""
    enclosure = workspace.enclosure
    enclose(maps, n_maps, enclosure)
    tighten_box(maps, n_maps, BOX_TOLERANCE, 0.0, MAX_BOX_NODES, enclosure)
    side = longest_side(enclosure.attained)
    offset = 0.0
    for i in range(n_maps):
        offset = max(offset, abs(maps[i, 3]), abs(maps[i, 7]), abs(maps[i, 11]))
    _plant(maps, n_maps, workspace)
    if side > _POINT * offset:
        return side
    for i in range(n_maps):
        copy_numbers(enclosure.anchor, workspace.contacts[i, 0], 3)
        copy_numbers(enclosure.anchor, workspace.contacts[i, 1], 3)
    return 0.0


@kernel
def _spanning_tree(maps, n_maps, near, far, tolerance, workspace):  # type: ignore[no-untyped-def]
    """Kruskal's algorithm; a distance is found only when its lower bound is the least of those that still matter.

    Args:
        maps: (M, 12) float64 maps.
        n_maps: number of maps.
        near: edges known to be no longer than this need not be known better, IFS units.
        far: nor edges known to be longer than this; they end the search.
        tolerance: how close the answer shall be otherwise, IFS units.
        workspace: `GapWorkspace` with the first pieces planted.

    Returns:
        The longest edge, at least `near`; by how much it can exceed the true one; how many pairs were split.
    """
    lower = np.zeros((MAX_MAPS, MAX_MAPS))
    excess = np.zeros((MAX_MAPS, MAX_MAPS))
    found = np.zeros((MAX_MAPS, MAX_MAPS), np.bool_)
    group = np.empty(n_maps, np.int64)
    for i in range(n_maps):
        group[i] = i
        for j in range(i):
            lower[i, j] = _between(1 + i, 1 + j, workspace.pieces)
    longest = near
    uncertain = 0.0
    splits = 0
    trees = n_maps
    while trees > 1 and longest <= far:
        a = -1
        b = -1
        for i in range(n_maps):
            for j in range(i):
                if group[i] != group[j] and (a < 0 or lower[i, j] < lower[a, b]):
                    a = i
                    b = j
        if not found[a, b]:
            lower[a, b], excess[a, b], used = _piece_distance(
                maps, n_maps, 1 + a, 1 + b, longest, far, tolerance, workspace
            )
            found[a, b] = True
            splits += used
            continue
        longest = max(longest, lower[a, b])
        uncertain = max(uncertain, excess[a, b])
        for end in range(2):
            copy_numbers(workspace.closest[a, b, end], workspace.contacts[n_maps - trees, end], 3)
        joined = group[a]
        for k in range(n_maps):
            if group[k] == joined:
                group[k] = group[b]
        trees -= 1
    return longest, uncertain, splits


@kernel
def _piece_distance(maps, n_maps, a, b, near, far, tolerance, workspace):  # type: ignore[no-untyped-def]
    """Distance of two pieces, best pairs first.

    Args:
        maps: (M, 12) float64 maps.
        n_maps: number of maps.
        a: index of a piece.
        b: index of another.
        near: a distance known to be no more than this need not be known better.
        far: nor one known to be more than this.
        tolerance: how close the answer shall be, IFS units.
        workspace: `GapWorkspace`.

    Returns:
        A distance between two points of the pieces; by how much it can exceed the least; how many pairs were split.
    """
    pieces = workspace.pieces
    keys = workspace.keys
    pairs = workspace.pairs
    closest = workspace.closest[a - 1, b - 1]
    if workspace.n_pieces[0] > MAX_PIECES // 2:
        _plant(maps, n_maps, workspace)
    best = _apart(a, b, pieces)
    _note(a, b, pieces, closest)
    low = 0.0
    splits = 0
    height = _push(0, a, b, best, pieces, keys, pairs)
    while height > 0:
        low = max(keys[0], 0.0)
        if best <= max(near, tolerance) or low >= best - tolerance:
            return best, min(best - low, tolerance), splits
        if low > far:
            return best, best - low, splits
        if splits >= MAX_PAIRS or height + n_maps > MAX_PAIRS or workspace.n_pieces[0] + n_maps > MAX_PIECES:
            return best, best - low, splits
        a = pairs[0, 0]
        b = pairs[0, 1]
        height = _pop(height, keys, pairs)
        splits += 1
        if pieces[a, 6] < pieces[b, 6]:
            a, b = b, a
        if workspace.children[a] == 0:
            _split(maps, n_maps, a, workspace)
        for k in range(n_maps):
            child = workspace.children[a] + k
            here = _apart(child, b, pieces)
            if here < best:
                best = here
                _note(child, b, pieces, closest)
            height = _push(height, child, b, best - tolerance, pieces, keys, pairs)
    return best, tolerance, splits


@kernel
def _plant(maps, n_maps, workspace):  # type: ignore[no-untyped-def]
    """The root of the address tree and its children, the first-level pieces 1..N."""
    make_identity(workspace.words[0])
    workspace.n_pieces[0] = 1
    _place(0, 1.0, workspace)
    _split(maps, n_maps, 0, workspace)


@kernel
def _split(maps, n_maps, a, workspace):  # type: ignore[no-untyped-def]
    """Make the children of a piece."""
    first = workspace.n_pieces[0]
    workspace.children[a] = first
    for i in range(n_maps):
        word = workspace.words[first + i]
        compose(workspace.words[a], maps[i], word)
        product = workspace.pieces[a, 7] * workspace.enclosure.contraction[i]
        _place(first + i, contraction_of(word, product, workspace.enclosure.exact[0]), workspace)
    workspace.n_pieces[0] = first + n_maps


@kernel
def _place(a, size, workspace):  # type: ignore[no-untyped-def]
    """Centre, point, radius and contraction of a piece from its word."""
    ball = workspace.enclosure.ball
    anchor = workspace.enclosure.anchor
    word = workspace.words[a]
    piece = workspace.pieces[a]
    piece[0], piece[1], piece[2] = image(word, ball[0], ball[1], ball[2])
    piece[3], piece[4], piece[5] = image(word, anchor[0], anchor[1], anchor[2])
    piece[6] = size * ball[3]
    piece[7] = size
    workspace.children[a] = 0


@kernel
def _note(a, b, pieces, closest):  # type: ignore[no-untyped-def]
    """Write down the points of two pieces."""
    for axis in range(3):
        closest[0, axis] = pieces[a, 3 + axis]
        closest[1, axis] = pieces[b, 3 + axis]


@kernel
def _apart(a, b, pieces):  # type: ignore[no-untyped-def]
    """Distance of the points of two pieces: no less than that of the pieces."""
    p = pieces[a]
    q = pieces[b]
    return distance(p[3], p[4], p[5], q[3], q[4], q[5])


@kernel
def _between(a, b, pieces):  # type: ignore[no-untyped-def]
    """Distance of the balls of two pieces, negative where they overlap: no more than that of the pieces."""
    p = pieces[a]
    q = pieces[b]
    return distance(p[0], p[1], p[2], q[0], q[1], q[2]) - p[6] - q[6]


@kernel
def _push(height, a, b, limit, pieces, keys, pairs):  # type: ignore[no-untyped-def]
    """Put a pair on the heap unless its pieces are at least `limit` apart; returns the new height.

    Pairs of overlapping balls know nothing of their distance; those whose points are closest come first.
    """
    key = _between(a, b, pieces)
    if key >= limit:
        return height
    if key <= 0.0:
        key = -1.0 / max(_apart(a, b, pieces), _SMALLEST)
    place = height
    while place > 0:
        above = (place - 1) >> 1
        if keys[above] <= key:
            break
        keys[place] = keys[above]
        pairs[place, 0] = pairs[above, 0]
        pairs[place, 1] = pairs[above, 1]
        place = above
    keys[place] = key
    pairs[place, 0] = a
    pairs[place, 1] = b
    return height + 1


@kernel
def _pop(height, keys, pairs):  # type: ignore[no-untyped-def]
    """Take the first pair off the heap; returns the new height."""
    height -= 1
    key = keys[height]
    a = pairs[height, 0]
    b = pairs[height, 1]
    place = 0
    while True:
        below = 2 * place + 1
        if below >= height:
            break
        if below + 1 < height and keys[below + 1] < keys[below]:
            below += 1
        if keys[below] >= key:
            break
        keys[place] = keys[below]
        pairs[place, 0] = pairs[below, 0]
        pairs[place, 1] = pairs[below, 1]
        place = below
    keys[place] = key
    pairs[place, 0] = a
    pairs[place, 1] = b
    return height
