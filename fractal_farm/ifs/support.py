"""The support function of the attractor, h(u) = max of u.a over A, and with it the exact box, by branch and bound.

h(u) = max over i of u.b_i + h(A_i^T u): descending the address tree, a node is a number and a vector, and the ball and
the box that hold A bound what lies below it. Nodes that cannot raise the best point by more than the tolerance are cut.
"""

from __future__ import annotations

import math

import numpy as np

from fractal_farm.ifs.enclosure import copy_numbers
from fractal_farm.ifs.kernel import kernel

ROUNDS = 6
COARSE = 0.02
COARSE_NODES = 2_000


@kernel
def tighten_box(maps, n_maps, relative, absolute, max_nodes, enclosure):  # type: ignore[no-untyped-def]
    """Bring the outer and the attained box of an enclosure together.

    Args:
        maps: (M, 12) float64 maps, the first n_maps count.
        n_maps: number of maps.
        relative: the two boxes may differ by this share of the longest side, on each of six sides,
        absolute: or by this much, in IFS units, whichever is more.
        max_nodes: bound on the nodes visited for a side.
        enclosure: `Enclosure` after `enclose`; box and attained are tightened.

    Returns:
        Nodes visited. Where the bound was reached the two boxes differ by more; both are still what they say.
    """
    stack = np.empty((max_nodes * (n_maps - 1) + n_maps + 1, 5))
    visited = 0
    for stage in range(ROUNDS + 1):
        coarse = stage < ROUNDS
        limit = min(COARSE_NODES, max_nodes) if coarse else max_nodes
        goal = max((COARSE if coarse else relative) * longest_side(enclosure.attained), absolute)
        for axis in range(3):
            for end in range(2):
                sign = 2.0 * end - 1.0
                low = sign * enclosure.attained[end, axis]
                if sign * enclosure.box[end, axis] - low <= goal:
                    continue
                x, y, z = _along(axis, sign)
                high = sign * enclosure.box[end, axis]
                best, bound, nodes = _support(maps, n_maps, x, y, z, low, high, goal, limit, enclosure, stack)
                enclosure.attained[end, axis] = sign * max(low, best)
                enclosure.box[end, axis] = sign * min(sign * enclosure.box[end, axis], bound)
                visited += nodes
    return visited


@kernel
def copies_box(system, n_maps, relative, absolute, max_nodes, enclosure, union):  # type: ignore[no-untyped-def]
    """The box of all copies of an attractor (`copies`).

    Args:
        system: filled `System`, its copies placed.
        n_maps: number of maps.
        relative: see `tighten_box`,
        absolute: likewise,
        max_nodes: likewise, for a side of a copy.
        enclosure: `Enclosure` of the attractor, its boxes tight.
        union: (2, 2, 3) float64, filled with a box that holds all copies, and one that they reach on all six sides.

    Returns:
        Nodes visited.
    """
    for end in range(2):
        copy_numbers(enclosure.box[end], union[0, end], 3)
        copy_numbers(enclosure.attained[end], union[1, end], 3)
    visited = 0
    if system.n_copies[0] == 1:
        return visited
    stack = np.empty((max_nodes * (n_maps - 1) + n_maps + 1, 5))
    for k in range(1, system.n_copies[0]):
        goal = max(relative * longest_side(union[1]), absolute)
        for axis in range(3):
            row = system.copies[k, 4 * axis : 4 * axis + 4]
            for end in range(2):
                sign = 2.0 * end - 1.0
                x, y, z = sign * row[0], sign * row[1], sign * row[2]
                moved = sign * row[3]
                low = sign * union[1, end, axis] - moved
                high = _reach(x, y, z, enclosure)
                best, bound, nodes = _support(
                    system.maps, n_maps, x, y, z, low, high, goal, max_nodes, enclosure, stack
                )
                union[1, end, axis] = sign * (moved + best)
                union[0, end, axis] = sign * max(sign * union[0, end, axis], moved + bound)
                visited += nodes
    return visited


@kernel
def longest_side(box):  # type: ignore[no-untyped-def]
    """Longest side of a (2, 3) box."""
    return max(box[1, 0] - box[0, 0], box[1, 1] - box[0, 1], box[1, 2] - box[0, 2])


@kernel
def _support(maps, n_maps, x, y, z, low, high, tolerance, max_nodes, enclosure, stack):  # type: ignore[no-untyped-def]
    """h(x, y, z), or `low` if it is less, between a value that is attained and an upper bound; and the nodes visited.

    `high` is an upper bound that is known.
    """
    anchor = enclosure.anchor
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3], stack[0, 4] = 0.0, x, y, z, high
    best = low
    height = 1
    nodes = 0
    cut = best
    while height > 0 and nodes < max_nodes:
        height -= 1
        if stack[height, 4] <= best + tolerance:
            cut = max(cut, stack[height, 4])
            continue
        nodes += 1
        value = stack[height, 0]
        x = stack[height, 1]
        y = stack[height, 2]
        z = stack[height, 3]
        first = height
        for i in range(n_maps):
            m = maps[i]
            here = value + x * m[3] + y * m[7] + z * m[11]
            u = x * m[0] + y * m[4] + z * m[8]
            v = x * m[1] + y * m[5] + z * m[9]
            w = x * m[2] + y * m[6] + z * m[10]
            best = max(best, here + u * anchor[0] + v * anchor[1] + w * anchor[2])
            bound = here + _reach(u, v, w, enclosure)
            place = height
            while place > first and stack[place - 1, 4] > bound:
                copy_numbers(stack[place - 1], stack[place], 5)
                place -= 1
            stack[place, 0] = here
            stack[place, 1] = u
            stack[place, 2] = v
            stack[place, 3] = w
            stack[place, 4] = bound
            height += 1
    for place in range(height):
        cut = max(cut, stack[place, 4])
    return best, max(cut, best), nodes


@kernel
def _along(axis, sign):  # type: ignore[no-untyped-def]
    """The unit vector along an axis, or against it."""
    return sign if axis == 0 else 0.0, sign if axis == 1 else 0.0, sign if axis == 2 else 0.0


@kernel
def _reach(u, v, w, enclosure):  # type: ignore[no-untyped-def]
    """An upper bound of h(u, v, w): the lesser of what the ball and the box allow."""
    ball = enclosure.ball
    box = enclosure.box
    by_ball = u * ball[0] + v * ball[1] + w * ball[2] + math.sqrt(u * u + v * v + w * w) * ball[3]
    by_box = u * box[1 if u > 0.0 else 0, 0] + v * box[1 if v > 0.0 else 0, 1] + w * box[1 if w > 0.0 else 0, 2]
    return min(by_ball, by_box)
