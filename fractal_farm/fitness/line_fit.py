"""Weighted least squares of a straight line, with the standard error of its slope."""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import math

import numpy as np

from fractal_farm.ifs.kernel import kernel


@kernel
def fit_slope(x, y, weights, n):
    """Slope of y over x.

    Args:
        x: (m,) float64 abscissae, of which the first n count.
        y: (m,) float64 ordinates.
        weights: (m,) float64 above 0, in proportion to the inverse of the variances of y.
        n: number of values.

    Returns:
        The slope and its standard error; (0, nan) without two different abscissae, and error nan for two values.
    """
    total = x_mean = y_mean = 0.0
    for i in range(n):
        total += weights[i]
        x_mean += weights[i] * x[i]
        y_mean += weights[i] * y[i]
    x_mean /= total if n > 0 else 1.0
    y_mean /= total if n > 0 else 1.0
    xx = xy = 0.0
    for i in range(n):
        xx += weights[i] * (x[i] - x_mean) * (x[i] - x_mean)
        xy += weights[i] * (x[i] - x_mean) * (y[i] - y_mean)
    if not xx > 0.0:
        return 0.0, np.nan
    slope = xy / xx
    residual = 0.0
    for i in range(n):
        deviation = y[i] - y_mean - slope * (x[i] - x_mean)
        residual += weights[i] * deviation * deviation
    return slope, math.sqrt(residual / (n - 2) / xx) if n > 2 else np.nan
