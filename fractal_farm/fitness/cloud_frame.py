"""The frame in which a cloud is measured: its principal axes, and the bounding cube along them.

Box counting depends on orientation (fitness varies by 0.015 with it), so every cloud is first turned to its principal
axes, longest first, each pointing to where the cloud reaches farther from its mean. A moved, turned, mirrored or
scaled copy then has the same coordinates but for rounding. They are float32 in the unit cube, longest side 1, on a
grid of 2^-23, so that differences between them are exact.

All is scalar arithmetic in fixed order: the last bits of LAPACK and of numpy's reductions depend on the machine.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.ifs.kernel import kernel

COLLAPSED = 1e-9  # extent over coordinate at and below which a cloud counts as one point
_SWEEPS = 16  # of Jacobi rotations; five suffice in practice


class FrameWorkspace(NamedTuple):
    """Memory for the diagonalisation of one 3 x 3 matrix: (3, 3) float64 each."""

    matrix: npt.NDArray[np.float64]
    axes: npt.NDArray[np.float64]


def new_frame_workspace() -> FrameWorkspace:
    """An empty working space."""
    return FrameWorkspace(np.empty((3, 3)), np.empty((3, 3)))


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
    extent, magnitude, centre, covariance = moments(cloud)
    if not extent > COLLAPSED * magnitude:
        return False
    principal_axes(covariance, work)
    _turn(cloud, centre, work.axes)
    u, v, w = _limits(cloud, 0), _limits(cloud, 1), _limits(cloud, 2)
    side = max(max(abs(u[1] - u[0]), abs(v[1] - v[0])), abs(w[1] - w[0]))
    _fill(cloud, 0, u, side, frame)
    _fill(cloud, 1, v, side, frame)
    _fill(cloud, 2, w, side, frame)
    return True


@kernel
def moments(cloud):
    """Size, mean and covariance of a (3, n) cloud.

    Sums run over offsets from the first point, so that a cloud far from the origin loses no digits.

    Returns:
        Longest side of the axis-parallel box; largest absolute coordinate; (x, y, z) mean; (xx, yy, zz, xy, xz, yz)
        covariance, all 0 if it is too large for a float64.
    """
    n = cloud.shape[1]
    x0, y0, z0 = cloud[0, 0], cloud[1, 0], cloud[2, 0]
    x = y = z = xx = yy = zz = xy = xz = yz = 0.0
    low_a = low_b = low_c = high_a = high_b = high_c = 0.0
    for i in range(n):
        a = cloud[0, i] - x0
        b = cloud[1, i] - y0
        c = cloud[2, i] - z0
        x += a
        y += b
        z += c
        xx += a * a
        yy += b * b
        zz += c * c
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
    x /= n
    y /= n
    z /= n
    covariance = (
        xx / n - x * x,
        yy / n - y * y,
        zz / n - z * z,
        xy / n - x * y,
        xz / n - x * z,
        yz / n - y * z,
    )
    if not math.isfinite(xx + yy + zz):
        covariance = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return extent, magnitude, (x0 + x, y0 + y, z0 + z), covariance


@kernel
def principal_axes(covariance, work):
    """Eigenvalues, descending; the rows of work.axes become orthonormal eigenvectors. Cyclic Jacobi rotations.

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
        if abs(a[0, 1]) + abs(a[0, 2]) + abs(a[1, 2]) <= 1e-17 * trace:
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
    return a[0, 0], a[1, 1], a[2, 2]


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
def _turn(cloud, centre, axes):
    """Coordinates about the centre along the given axes, in place."""
    x0, y0, z0 = centre
    a00, a01, a02 = axes[0, 0], axes[0, 1], axes[0, 2]
    a10, a11, a12 = axes[1, 0], axes[1, 1], axes[1, 2]
    a20, a21, a22 = axes[2, 0], axes[2, 1], axes[2, 2]
    for i in range(cloud.shape[1]):
        x = cloud[0, i] - x0
        y = cloud[1, i] - y0
        z = cloud[2, i] - z0
        cloud[0, i] = a00 * x + a01 * y + a02 * z
        cloud[1, i] = a10 * x + a11 * y + a12 * z
        cloud[2, i] = a20 * x + a21 * y + a22 * z


@kernel
def _limits(cloud, axis):
    """(start, end) of one centred coordinate; end < start if it reaches farther below 0, and is to be reversed."""
    low = 0.0
    high = 0.0
    for i in range(cloud.shape[1]):
        x = cloud[axis, i]
        low = x if x < low else low
        high = x if x > high else high
    return (low, high) if high >= -low else (high, low)


@kernel
def _fill(cloud, axis, limits, side, frame):
    """One coordinate in units of the cube's side, from `start` on; adding and taking 1 rounds to the 2^-23 grid."""
    start, end = limits
    scale = (1.0 if end >= start else -1.0) / side
    one = np.float32(1.0)
    for i in range(cloud.shape[1]):
        frame[axis, i] = np.float32((cloud[axis, i] - start) * scale) + one - one
