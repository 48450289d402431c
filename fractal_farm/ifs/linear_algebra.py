"""3 x 3 linear algebra in scalar arithmetic.

LAPACK's last bits differ between machines, and these values decide whether a genome is refused. The functions are
plain Python over floats: callers without numba use them as they are, kernels compile them.
"""

from __future__ import annotations

import math

_SMALLEST = 1e-300  # spread of the eigenvalues whose cube is still a number


def largest_singular_value(
    a00: float,
    a01: float,
    a02: float,
    a10: float,
    a11: float,
    a12: float,
    a20: float,
    a21: float,
    a22: float,
) -> float:
    """Spectral norm of a 3 x 3 matrix: the square root of the largest eigenvalue of A^T A in closed form.

    The characteristic cubic of a symmetric matrix has three real roots, q + 2 p cos(phi + 2 pi k / 3) (Smith 1961).
    """
    b00 = a00 * a00 + a10 * a10 + a20 * a20
    b11 = a01 * a01 + a11 * a11 + a21 * a21
    b22 = a02 * a02 + a12 * a12 + a22 * a22
    b01 = a00 * a01 + a10 * a11 + a20 * a21
    b02 = a00 * a02 + a10 * a12 + a20 * a22
    b12 = a01 * a02 + a11 * a12 + a21 * a22
    mean = (b00 + b11 + b22) / 3.0
    c00 = b00 - mean
    c11 = b11 - mean
    c22 = b22 - mean
    spread = math.sqrt((c00 * c00 + c11 * c11 + c22 * c22 + 2.0 * (b01 * b01 + b02 * b02 + b12 * b12)) / 6.0)
    if spread <= _SMALLEST:
        return math.sqrt(max(mean, 0.0))
    half = (c00 * (c11 * c22 - b12 * b12) - b01 * (b01 * c22 - b12 * b02) + b02 * (b01 * b12 - c11 * b02)) / (
        2.0 * spread * spread * spread
    )
    angle = math.acos(min(1.0, max(-1.0, half))) / 3.0
    return math.sqrt(max(mean + 2.0 * spread * math.cos(angle), 0.0))


def determinant(
    a00: float,
    a01: float,
    a02: float,
    a10: float,
    a11: float,
    a12: float,
    a20: float,
    a21: float,
    a22: float,
) -> float:
    """Determinant of a 3 x 3 matrix."""
    return a00 * (a11 * a22 - a12 * a21) - a01 * (a10 * a22 - a12 * a20) + a02 * (a10 * a21 - a11 * a20)
