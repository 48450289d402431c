"""Correlation dimension D2 by the correlation sum of Grassberger and Procaccia (1983; NOTES, paper section 3.3.4).

C(r), the number of pairs closer than r, is exact at fifteen radii in half octaves, 2^-10 to 2^-3 of the bounding
cube's side. D2 is the least-squares slope of log2 C over log2 r, where C is at least 500 pairs (50, or 2, if fewer than
three radii have that many).
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.fitness.line_fit import fit_slope
from fractal_farm.fitness.octave_counter import N_BINS
from fractal_farm.ifs.kernel import kernel

N_RADII = N_BINS - 1
PAIRS_NEEDED = (500, 50, 2)  # at a radius that is used; the next if fewer than three radii have that many
RADII_NEEDED = 3
_LOG_NEAREST = -10.0  # log2 of the smallest radius


class SlopeWorkspace(NamedTuple):
    """Memory for the fit: (15,) float64 each; all weights are 1."""

    scales: npt.NDArray[np.float64]
    logs: npt.NDArray[np.float64]
    weights: npt.NDArray[np.float64]


def new_slope_workspace() -> SlopeWorkspace:
    """An empty working space."""
    return SlopeWorkspace(np.empty(N_RADII), np.empty(N_RADII), np.ones(N_RADII))


@kernel
def correlation_slope(counts, work):
    """D2 and the standard error of the slope, from (16,) pair counts; (0, 0) if too few pairs are close."""
    for fewest in PAIRS_NEEDED:
        used = 0
        closer = 0
        for k in range(N_RADII):
            closer += counts[k]
            if closer >= fewest:
                work.scales[used] = _LOG_NEAREST + 0.5 * k
                work.logs[used] = math.log2(closer)
                used += 1
        if used >= RADII_NEEDED:
            slope, error = fit_slope(work.scales, work.logs, work.weights, used)
            return min(3.0, max(0.0, slope)), error
    return 0.0, 0.0
