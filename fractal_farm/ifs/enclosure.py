"""Where the attractor lies: a ball, a box and a point on it, for the branch and bound of `cover`, `gap` and `solid`.

A = f_1(A) u ... u f_N(A), so a ball (c, R) holds A whenever R >= |f_i(c) - c| + sigma_i R for all i, with sigma_i the
contraction of f_i. That ball is crude; replacing A by the pieces f_w(A) of some 256 words w, and their balls by a ball,
tightens it. The support function h(u) = max of u.a over A is found by branch and bound on the same pieces. Scalar
compiled code throughout: these numbers decide which designs survive.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.genome import MAX_MAPS
from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.linear_algebra import determinant, largest_singular_value
from fractal_farm.ifs.system import fixed_point

LEAVES = 256
_ROUNDS = 4
_CENTRE_STEPS = 48
_ROUNDED_UP = 1.0 + 1e-12  # times a computed norm is never below the true one
_EQUAL = 1e-9  # relative difference of singular values that rounding can make
_determinant = kernel(determinant)
_largest_singular_value = kernel(largest_singular_value)


class Enclosure(NamedTuple):
    """What is known of an attractor; allocated once, filled for one system of maps after the other.

    Attributes:
        contraction: (MAX_MAPS,) float64, upper bounds of the spectral norms of the maps.
        ball: (4,) float64, centre and radius of a ball that holds the attractor.
        exact: (1,) bool, whether all maps are similarities, so that contractions multiply exactly along a word.
        anchor: (4,) float64, a point of the attractor close to the centre, and a radius that holds the attractor.
        box: (2, 3) float64, lower and upper corner of a box that holds the attractor.
        attained: (2, 3) float64, lower and upper corner of a box that the attractor reaches on all six sides.
        leaves: (LEAVES, 12) float64, words of the address tree as 3 x 4 maps; working space.
        sizes: (LEAVES,) float64, their contractions; working space.
    """

    contraction: npt.NDArray[np.float64]
    exact: npt.NDArray[np.bool_]
    ball: npt.NDArray[np.float64]
    anchor: npt.NDArray[np.float64]
    box: npt.NDArray[np.float64]
    attained: npt.NDArray[np.float64]
    leaves: npt.NDArray[np.float64]
    sizes: npt.NDArray[np.float64]


@kernel
def new_enclosure():  # type: ignore[no-untyped-def]
    """Working space for `enclose`."""
    return Enclosure(
        np.zeros(MAX_MAPS),
        np.zeros(1, np.bool_),
        np.zeros(4),
        np.zeros(4),
        np.zeros((2, 3)),
        np.zeros((2, 3)),
        np.empty((LEAVES, 12)),
        np.empty(LEAVES),
    )


@kernel
def enclose(maps, n_maps, enclosure):  # type: ignore[no-untyped-def]
    """Fill contraction, ball, anchor and a first box of `enclosure`.

    Args:
        maps: (M, 12) float64, row-major 3 x 4 maps, the first n_maps count; every spectral norm below 1.
        n_maps: number of maps.
        enclosure: `Enclosure` to fill.
    """
    fixed = np.empty((MAX_MAPS, 3))
    best = math.inf
    ball = enclosure.ball
    for i in range(n_maps):
        m = maps[i]
        norm = _largest_singular_value(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10])
        enclosure.contraction[i] = min(norm * _ROUNDED_UP, 0.5 + 0.5 * norm)
        fixed_point(m, fixed[i])
    enclosure.exact[0] = _similar(maps, n_maps)
    for i in range(n_maps):
        radius = 0.0
        for j in range(n_maps):
            x, y, z = image(maps[j], fixed[i, 0], fixed[i, 1], fixed[i, 2])
            moved = distance(x, y, z, fixed[i, 0], fixed[i, 1], fixed[i, 2])
            radius = max(radius, moved / (1.0 - enclosure.contraction[j]))
        if radius < best:
            best = radius
            copy_numbers(fixed[i], ball, 3)
            ball[3] = radius
    count, _ = grow_words(maps, n_maps, enclosure, 0.0, enclosure.leaves, enclosure.sizes)
    for _ in range(_ROUNDS):
        _tighten_ball(count, enclosure)
    _choose_anchor(count, fixed[0], enclosure)
    _first_box(count, enclosure)


@kernel
def grow_words(maps, n_maps, enclosure, largest_allowed, words, sizes):  # type: ignore[no-untyped-def]
    """Split the largest piece of the attractor until all are small enough, or there is no room for more.

    Args:
        maps: (M, 12) float64 maps, the first n_maps count.
        n_maps: number of maps.
        enclosure: `Enclosure`, of which contraction and exact are used.
        largest_allowed: stop when no word contracts less than this.
        words: (K, 12) float64, filled with maps whose images of the attractor make up the attractor.
        sizes: (K,) float64, filled with their contractions.

    Returns:
        Number of words, and the largest of their contractions.
    """
    parent = np.empty(12)
    contraction = enclosure.contraction
    for i in range(n_maps):
        copy_numbers(maps[i], words[i], 12)
        sizes[i] = contraction[i]
    count = n_maps
    while True:
        largest = 0
        for k in range(1, count):
            if sizes[k] > sizes[largest]:
                largest = k
        size = sizes[largest]
        if size <= largest_allowed or count + n_maps - 1 > len(words):
            return count, size
        copy_numbers(words[largest], parent, 12)
        for i in range(n_maps):
            place = largest if i == 0 else count + i - 1
            compose(parent, maps[i], words[place])
            sizes[place] = contraction_of(words[place], size * contraction[i], enclosure.exact[0])
        count += n_maps - 1


@kernel
def _tighten_ball(count, enclosure):  # type: ignore[no-untyped-def]
    """One round: the ball about the balls of the leaves, by Badoiu and Clarkson's walk to the farthest."""
    ball = enclosure.ball
    points = np.empty((4, LEAVES))
    reaches = np.empty(LEAVES)
    for k in range(count):
        points[0, k], points[1, k], points[2, k] = image(enclosure.leaves[k], ball[0], ball[1], ball[2])
        points[3, k] = enclosure.sizes[k] * ball[3]
    x = ball[0]
    y = ball[1]
    z = ball[2]
    for step in range(_CENTRE_STEPS + 1):
        for k in range(count):  # apart from the search below, so that it runs in vectors
            reaches[k] = distance(points[0, k], points[1, k], points[2, k], x, y, z) + points[3, k]
        reach = -1.0
        farthest = 0
        for k in range(count):
            if reaches[k] > reach:
                reach = reaches[k]
                farthest = k
        if reach < ball[3]:
            ball[0] = x
            ball[1] = y
            ball[2] = z
            ball[3] = reach
        share = 1.0 / (step + 2.0)
        x += share * (points[0, farthest] - x)
        y += share * (points[1, farthest] - y)
        z += share * (points[2, farthest] - z)


@kernel
def _choose_anchor(count, seed, enclosure):  # type: ignore[no-untyped-def]
    """The image of `seed`, a point of the attractor, that lies closest to the centre, and the radius about it."""
    ball = enclosure.ball
    anchor = enclosure.anchor
    closest = math.inf
    for k in range(count):
        x, y, z = image(enclosure.leaves[k], seed[0], seed[1], seed[2])
        here = distance(x, y, z, ball[0], ball[1], ball[2])
        if here < closest:
            closest = here
            anchor[0] = x
            anchor[1] = y
            anchor[2] = z
    reach = 0.0
    for k in range(count):
        x, y, z = image(enclosure.leaves[k], ball[0], ball[1], ball[2])
        here = distance(x, y, z, anchor[0], anchor[1], anchor[2])
        reach = max(reach, here + enclosure.sizes[k] * ball[3])
    anchor[3] = min(reach, closest + ball[3])


@kernel
def _first_box(count, enclosure):  # type: ignore[no-untyped-def]
    """The box about the balls of the leaves, and the box of their images of the anchor."""
    ball = enclosure.ball
    anchor = enclosure.anchor
    box = enclosure.box
    attained = enclosure.attained
    for axis in range(3):
        box[0, axis] = math.inf
        box[1, axis] = -math.inf
        attained[0, axis] = math.inf
        attained[1, axis] = -math.inf
    for k in range(count):
        leaf = enclosure.leaves[k]
        reach = enclosure.sizes[k] * ball[3]
        centre = image(leaf, ball[0], ball[1], ball[2])
        point = image(leaf, anchor[0], anchor[1], anchor[2])
        for axis in range(3):
            box[0, axis] = min(box[0, axis], centre[axis] - reach)
            box[1, axis] = max(box[1, axis], centre[axis] + reach)
            attained[0, axis] = min(attained[0, axis], point[axis])
            attained[1, axis] = max(attained[1, axis], point[axis])


@kernel
def _similar(maps, n_maps):  # type: ignore[no-untyped-def]
    """Whether all maps are similarities."""
    for i in range(n_maps):
        m = maps[i]
        volume = abs(_determinant(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]))
        norm = _largest_singular_value(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10])
        if volume < (1.0 - _EQUAL) * norm * norm * norm:
            return False
    return True


@kernel
def contraction_of(word, product, exact):  # type: ignore[no-untyped-def]
    """Contraction of a word: the product of those of its maps where that is exact, else its own spectral norm."""
    if exact:
        return product
    norm = _largest_singular_value(word[0], word[1], word[2], word[4], word[5], word[6], word[8], word[9], word[10])
    return min(product, norm * _ROUNDED_UP)


@kernel
def copy_numbers(source, target, count):  # type: ignore[no-untyped-def]
    """Copy the first numbers of an array: each assignment of slices would take a second longer to compile."""
    for k in range(count):
        target[k] = source[k]


@kernel
def make_identity(word):  # type: ignore[no-untyped-def]
    """Fill a 3 x 4 map in 12 numbers with the identity."""
    for k in range(12):
        word[k] = 1.0 if k % 5 == 0 else 0.0


@kernel
def image(m, x, y, z):  # type: ignore[no-untyped-def]
    """The image of a point under a 3 x 4 map in 12 numbers."""
    return (
        m[0] * x + m[1] * y + m[2] * z + m[3],
        m[4] * x + m[5] * y + m[6] * z + m[7],
        m[8] * x + m[9] * y + m[10] * z + m[11],
    )


@kernel
def distance(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    """Euclidean distance."""
    return math.sqrt((ax - bx) * (ax - bx) + (ay - by) * (ay - by) + (az - bz) * (az - bz))


@kernel
def compose(outer, inner, out):  # type: ignore[no-untyped-def]
    """Fill `out` with outer after inner, 3 x 4 maps in 12 numbers."""
    for row in range(3):
        a = outer[4 * row]
        b = outer[4 * row + 1]
        c = outer[4 * row + 2]
        out[4 * row] = a * inner[0] + b * inner[4] + c * inner[8]
        out[4 * row + 1] = a * inner[1] + b * inner[5] + c * inner[9]
        out[4 * row + 2] = a * inner[2] + b * inner[6] + c * inner[10]
        out[4 * row + 3] = a * inner[3] + b * inner[7] + c * inner[11] + outer[4 * row + 3]
