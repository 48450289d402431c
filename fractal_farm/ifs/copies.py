"""The copies of an attractor that a symmetry asks for: where they are, and points spread over them (`symmetry`)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.kernel import kernel
from fractal_farm.ifs.linear_algebra import determinant
from fractal_farm.ifs.symmetry import SYMMETRIES
from fractal_farm.ifs.system import INCREMENT, System, fixed_point, scramble

_NUMBERS = np.array([(s.copies, s.turn, s.mirrored, s.carried) for s in SYMMETRIES], np.float64)
_OTHER_STREAM = np.uint32(0x5851F42D)  # sets the draws of copies apart from those of maps
_WORD_BITS = np.uint64(32)
_TURNS = 1e-6  # of a map's contraction: with less of a turn it has no axis of its own
_determinant = kernel(determinant)


def copied(points: npt.NDArray[np.float64], system: System) -> npt.NDArray[np.float64]:
    """Points of the attractor, once for each copy.

    Args:
        points: (n, 3) float64, IFS units.
        system: with its copies placed.

    Returns:
        (copies * n, 3) float64, those of the attractor itself first; `points` itself if there is no other copy.
    """
    return points if system.n_copies[0] == 1 else _copied(points, system.copies[: system.n_copies[0]])


def joints(system: System, n_maps: int) -> npt.NDArray[np.float64]:
    """Where copies meet: p and q in each of them, (2 * copies, 3) float64; nothing, (0, 3), if there is but one."""
    points = np.empty((2, 3))
    if system.n_copies[0] == 1:
        return points[:0]
    _frame(system.maps, n_maps, points[0], points[1], np.empty(3), np.empty(3))
    return copied(points, system)


@kernel
def place_copies(symmetry, n_maps, system):  # type: ignore[no-untyped-def]
    """Fill `copies` and `n_copies` of a system.

    Args:
        symmetry: code of a symmetry.
        n_maps: number of maps.
        system: `System` of which maps are filled.
    """
    count = int(_NUMBERS[symmetry, 0])
    system.n_copies[0] = count
    if count == 1:
        return
    copies = system.copies
    begin, end, axis, across = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    _frame(system.maps, n_maps, begin, end, axis, across)
    mirrored, carried = _NUMBERS[symmetry, 2] > 0.0, _NUMBERS[symmetry, 3] > 0.0
    for k in range(1, count):
        step = k // 2 if mirrored else k
        angle = 2.0 * math.pi * _NUMBERS[symmetry, 1] * step
        _turned(math.cos(angle), math.sin(angle), axis, copies[k])
        if mirrored and k % 2 == 1:
            _reflect_first(across, copies[k])
        # What goes to where: p stays, or the p of this copy goes to the q of the one before.
        for row in range(3):
            target = begin[row]
            if carried:
                before = copies[k - 1]
                target = (
                    before[4 * row] * end[0]
                    + before[4 * row + 1] * end[1]
                    + before[4 * row + 2] * end[2]
                    + before[4 * row + 3]
                )
            m = copies[k]
            m[4 * row + 3] = target - (m[4 * row] * begin[0] + m[4 * row + 1] * begin[1] + m[4 * row + 2] * begin[2])


@kernel
def spread_over_copies(system, first, second, points):  # type: ignore[no-untyped-def]
    """Move each point (3, n) of an orbit to one of the copies, drawn by a hash of (keys, t)."""
    count = np.uint64(system.n_copies[0])
    counter = np.uint32(first ^ _OTHER_STREAM)
    for t in range(points.shape[1]):
        counter = np.uint32(counter + INCREMENT)
        draw = scramble(scramble(counter) ^ np.uint32(second))
        m = system.copies[(np.uint64(draw) * count) >> _WORD_BITS]
        x = points[0, t]
        y = points[1, t]
        z = points[2, t]
        points[0, t] = m[0] * x + m[1] * y + m[2] * z + m[3]
        points[1, t] = m[4] * x + m[5] * y + m[6] * z + m[7]
        points[2, t] = m[8] * x + m[9] * y + m[10] * z + m[11]


@kernel
def _frame(maps, n_maps, begin, end, axis, across):  # type: ignore[no-untyped-def]
    """Fixed points p and q of the smallest and the largest map (the first of equals), and two unit vectors.

    The axis is that about which the smallest map turns (of an affine map, its antisymmetric part), or z if it does not
    turn; the other is normal to the plane of the axis and q, or to any plane through the axis if q lies on it.
    """
    least = 0
    most = 0
    sizes = np.empty(n_maps)
    for i in range(n_maps):
        m = maps[i]
        sizes[i] = abs(_determinant(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]))
        if sizes[i] < sizes[least]:
            least = i
        if sizes[i] > sizes[most]:
            most = i
    fixed_point(maps[least], begin)
    fixed_point(maps[most], end)
    m = maps[least]
    axis[0], axis[1], axis[2] = m[9] - m[6], m[2] - m[8], m[4] - m[1]
    if not _normalise(
        axis, _TURNS * max(_largest(m[0], m[1], m[2]), _largest(m[4], m[5], m[6]), _largest(m[8], m[9], m[10]))
    ):
        axis[0], axis[1], axis[2] = 0.0, 0.0, 1.0
    x, y, z = end[0] - begin[0], end[1] - begin[1], end[2] - begin[2]
    _cross(axis, x, y, z, across)
    if not _normalise(across, _TURNS * _largest(x, y, z)):
        if abs(axis[2]) < abs(axis[0]):
            _cross(axis, 0.0, 0.0, 1.0, across)
        else:
            _cross(axis, 1.0, 0.0, 0.0, across)
        _normalise(across, 0.0)


@kernel
def _cross(a, x, y, z, out):  # type: ignore[no-untyped-def]
    """Fill out (3,) with the cross product of a (3,) and (x, y, z)."""
    out[0] = a[1] * z - a[2] * y
    out[1] = a[2] * x - a[0] * z
    out[2] = a[0] * y - a[1] * x


@kernel
def _normalise(vector, least):  # type: ignore[no-untyped-def]
    """Make a vector (3,) one of length 1; False, and it stays, if no component exceeds `least`."""
    largest = _largest(vector[0], vector[1], vector[2])
    if not largest > least:
        return False
    for k in range(3):
        vector[k] /= largest
    length = math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    for k in range(3):
        vector[k] /= length
    return True


@kernel
def _largest(x, y, z):  # type: ignore[no-untyped-def]
    """The largest magnitude of three numbers."""
    return max(abs(x), abs(y), abs(z))


@kernel
def _turned(cosine, sine, axis, out):  # type: ignore[no-untyped-def]
    """Fill out (12,) with the rotation about a unit vector through the origin (Rodrigues)."""
    x, y, z = axis[0], axis[1], axis[2]
    rest = 1.0 - cosine
    out[0] = cosine + rest * x * x
    out[1] = rest * x * y - sine * z
    out[2] = rest * x * z + sine * y
    out[4] = rest * x * y + sine * z
    out[5] = cosine + rest * y * y
    out[6] = rest * y * z - sine * x
    out[8] = rest * x * z - sine * y
    out[9] = rest * y * z + sine * x
    out[10] = cosine + rest * z * z
    out[3] = out[7] = out[11] = 0.0


@kernel
def _reflect_first(normal, m):  # type: ignore[no-untyped-def]
    """Turn m (12,) into what it does after the reflection in the plane through the origin with this unit normal."""
    for row in range(3):
        along = m[4 * row] * normal[0] + m[4 * row + 1] * normal[1] + m[4 * row + 2] * normal[2]
        for column in range(3):
            m[4 * row + column] -= 2.0 * along * normal[column]


@kernel
def _copied(points, copies):  # type: ignore[no-untyped-def]
    """The images of points (n, 3) under copies (c, 12), one copy after the other."""
    n = len(points)
    out = np.empty((len(copies) * n, 3))
    for k in range(len(copies)):
        m = copies[k]
        for i in range(n):
            x = points[i, 0]
            y = points[i, 1]
            z = points[i, 2]
            out[k * n + i, 0] = m[0] * x + m[1] * y + m[2] * z + m[3]
            out[k * n + i, 1] = m[4] * x + m[5] * y + m[6] * z + m[7]
            out[k * n + i, 2] = m[8] * x + m[9] * y + m[10] * z + m[11]
    return out
