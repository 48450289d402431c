"""The frame in which a cloud is measured, and its coordinates in the bounding cube.

Box counting depends on orientation: fitness varies by 0.015 with it. So every cloud is brought to its principal axes,
longest first, each pointing the way in which the cloud is lopsided; a moved, turned, mirrored or scaled copy then has
the same coordinates but for rounding. From there it is turned by one fixed rotation, because a grid parallel to the
principal axes finds too few of the large boxes: D0 of separated systems would come out twice as far off.

Coordinates are float32 in the unit cube, longest side 1, on a grid of 2^-23, so that differences are exact. All is
scalar arithmetic in fixed order: the last bits of LAPACK and of numpy's reductions depend on the machine.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.kernel import kernel

COLLAPSED = 1e-9  # extent over coordinate at and below which a cloud counts as one point
_MODERATE = 2.0**300  # extents up to here, and down to its reciprocal, have moments of all orders that are numbers
_LEAST_EXPONENT = -1000  # of a factor that is still a number
TURN = ((21 / 37, 28 / 37, -12 / 37), (-12 / 37, 21 / 37, 28 / 37), (28 / 37, -12 / 37, 21 / 37))  # about (1, 1, 1)
_DIAGONAL = 1e-17  # share of the trace at and below which what is off the diagonal counts as none
_SWEEPS = 16  # of Jacobi rotations; five suffice in practice


class FrameWorkspace(NamedTuple):
    """Memory for the frame of one cloud.

    Attributes:
        matrix: (3, 3) float64, working space of the diagonalisation; the rotation into the frame afterwards.
        axes: (3, 3) float64, rows are the principal axes.
        variances: (3,) float64 along the principal axes, descending.
        lows: (3,) float64, where the coordinates begin.
    """

    matrix: npt.NDArray[np.float64]
    axes: npt.NDArray[np.float64]
    variances: npt.NDArray[np.float64]
    lows: npt.NDArray[np.float64]


def new_frame_workspace() -> FrameWorkspace:
    """An empty working space."""
    return FrameWorkspace(np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3))


@kernel
def fit_frame(cloud, work, frame):
    """Write the coordinates of a cloud in its own frame.

    Args:
        cloud: (3, n) float64, finite; used as working space, and left in other coordinates.
        work: `FrameWorkspace`.
        frame: (3, m) float32, m >= n; the first n columns are filled, in [0, 1].

    Returns:
        False if the cloud is a single point, as far as its coordinates can tell; `frame` is not filled then.
    """
    extent, magnitude, centre, covariance, lopsided = moments(cloud)
    if not 1.0 / _MODERATE < extent < _MODERATE:
        _scale_to_one(cloud)
        extent, magnitude, centre, covariance, lopsided = moments(cloud)
    if not extent > COLLAPSED * magnitude:
        return False
    principal_axes(covariance, work)
    _orient(work, lopsided)
    _turn(cloud, centre, work.matrix)
    side = 0.0
    for axis in range(3):
        low, high = _limits(cloud, axis)
        side = max(side, high - low)
        work.lows[axis] = low
    for axis in range(3):
        _fill(cloud, axis, work.lows[axis], side, frame)
    return True


@kernel
def _scale_to_one(cloud):
    """Multiply a cloud by the power of two that brings its largest coordinate into [1/4, 1/2): no bit is lost."""
    largest = 0.0
    for axis in range(3):
        low, high = _limits(cloud, axis)
        largest = max(largest, max(abs(low), abs(high)))
    _, exponent = math.frexp(largest)
    factor = math.ldexp(1.0, -max(exponent + 1, _LEAST_EXPONENT))
    for axis in range(3):
        for i in range(cloud.shape[1]):
            cloud[axis, i] *= factor


@kernel
def moments(cloud):
    """Size, mean, covariance and third moment of a (3, n) cloud.

    Sums run over offsets from the first point, so that a cloud far from the origin loses no digits.

    Returns:
        Longest side of the axis-parallel box; largest absolute coordinate; (x, y, z) mean; (xx, yy, zz, xy, xz, yz)
        covariance; (x, y, z) mean of |p|^2 p over offsets p from the mean.
    """
    n = cloud.shape[1]
    x0, y0, z0 = cloud[0, 0], cloud[1, 0], cloud[2, 0]
    x = y = z = xx = yy = zz = xy = xz = yz = tx = ty = tz = 0.0
    low_a = low_b = low_c = high_a = high_b = high_c = 0.0
    for i in range(n):
        a = cloud[0, i] - x0
        b = cloud[1, i] - y0
        c = cloud[2, i] - z0
        x += a
        y += b
        z += c
        aa = a * a
        bb = b * b
        cc = c * c
        square = aa + bb + cc
        tx += square * a
        ty += square * b
        tz += square * c
        xx += aa
        yy += bb
        zz += cc
        xy += a * b
        xz += a * c
        yz += b * c
        low_a = a if a < low_a else low_a
        low_b = b if b < low_b else low_b
        low_c = c if c < low_c else low_c
        high_a = a if a > high_a else high_a
        high_b = b if b > high_b else high_b
        high_c = c if c > high_c else high_c
    extent = max(high_a - low_a, max(high_b - low_b, high_c - low_c))
    magnitude = max(abs(x0), max(abs(y0), abs(z0))) + extent
    x, y, z, xx, yy, zz, xy, xz, yz = x / n, y / n, z / n, xx / n, yy / n, zz / n, xy / n, xz / n, yz / n
    trace = xx + yy + zz
    square = 2.0 * (x * x + y * y + z * z) - trace
    lopsided = (
        tx / n - 2.0 * (xx * x + xy * y + xz * z) + square * x,
        ty / n - 2.0 * (xy * x + yy * y + yz * z) + square * y,
        tz / n - 2.0 * (xz * x + yz * y + zz * z) + square * z,
    )
    covariance = (xx - x * x, yy - y * y, zz - z * z, xy - x * y, xz - x * z, yz - y * z)
    return extent, magnitude, (x0 + x, y0 + y, z0 + z), covariance, lopsided


@kernel
def principal_axes(covariance, work):
    """Fill work.variances and work.axes with eigenvalues, descending, and eigenvectors, by cyclic Jacobi rotations.

    Args:
        covariance: (xx, yy, zz, xy, xz, yz) of any symmetric matrix, degenerate ones included.
        work: `FrameWorkspace`.
    """
    a, axes = work.matrix, work.axes
    a[0, 0], a[1, 1], a[2, 2] = covariance[0], covariance[1], covariance[2]
    a[0, 1] = a[1, 0] = covariance[3]
    a[0, 2] = a[2, 0] = covariance[4]
    a[1, 2] = a[2, 1] = covariance[5]
    for i in range(3):
        for j in range(3):
            axes[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        trace = abs(a[0, 0]) + abs(a[1, 1]) + abs(a[2, 2])
        if abs(a[0, 1]) + abs(a[0, 2]) + abs(a[1, 2]) <= _DIAGONAL * trace:
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if a[p, q] != 0.0:
                    _rotate(a, axes, p, q)
    for i in range(2):
        largest = i
        for j in range(i + 1, 3):
            if a[j, j] > a[largest, largest]:
                largest = j
        a[i, i], a[largest, largest] = a[largest, largest], a[i, i]
        for k in range(3):
            axes[i, k], axes[largest, k] = axes[largest, k], axes[i, k]
    for i in range(3):
        work.variances[i] = max(a[i, i], 0.0)


@kernel
def _rotate(a, axes, p, q):
    """The rotation in the plane (p, q) that makes a[p, q] vanish (Golub and Van Loan, section 8.5)."""
    theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
    t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
    if theta < 0.0:
        t = -t
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    for k in range(3):
        a[k, p], a[k, q] = c * a[k, p] - s * a[k, q], s * a[k, p] + c * a[k, q]
    for k in range(3):
        a[p, k], a[q, k] = c * a[p, k] - s * a[q, k], s * a[p, k] + c * a[q, k]
        axes[p, k], axes[q, k] = c * axes[p, k] - s * axes[q, k], s * axes[p, k] + c * axes[q, k]
    a[p, q] = a[q, p] = 0.0


@kernel
def _orient(work, lopsided):
    """Point the axes along the third moment, and fill work.matrix with the rotation into the frame."""
    axes = work.axes
    for i in range(3):
        if axes[i, 0] * lopsided[0] + axes[i, 1] * lopsided[1] + axes[i, 2] * lopsided[2] < 0.0:
            for j in range(3):
                axes[i, j] = -axes[i, j]
    for j in range(3):
        for i, turn in enumerate(TURN):
            work.matrix[i, j] = turn[0] * axes[0, j] + turn[1] * axes[1, j] + turn[2] * axes[2, j]


@kernel
def _turn(cloud, centre, matrix):
    """Offsets from the centre, rotated, in place."""
    x0, y0, z0 = centre
    a00, a01, a02 = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    a10, a11, a12 = matrix[1, 0], matrix[1, 1], matrix[1, 2]
    a20, a21, a22 = matrix[2, 0], matrix[2, 1], matrix[2, 2]
    for i in range(cloud.shape[1]):
        x = cloud[0, i] - x0
        y = cloud[1, i] - y0
        z = cloud[2, i] - z0
        cloud[0, i] = a00 * x + a01 * y + a02 * z
        cloud[1, i] = a10 * x + a11 * y + a12 * z
        cloud[2, i] = a20 * x + a21 * y + a22 * z


@kernel
def _limits(cloud, axis):
    """Smallest and largest value of one coordinate."""
    low = cloud[axis, 0]
    high = low
    for i in range(cloud.shape[1]):
        x = cloud[axis, i]
        low = x if x < low else low
        high = x if x > high else high
    return low, high


@kernel
def _fill(cloud, axis, low, side, frame):
    """One coordinate in units of the cube's side; adding and taking 1 rounds to the grid of 2^-23."""
    scale = 1.0 / side
    one = np.float32(1.0)
    for i in range(cloud.shape[1]):
        frame[axis, i] = np.float32((cloud[axis, i] - low) * scale) + one - one
