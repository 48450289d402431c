"""Bridges: struts between the pieces of an attractor, repeated at all scales (DESIGN section 6, point 3).

The attractor A of maps f_i with gaps is a dust. With a condensation set C, the edges of the spanning tree between the
pieces f_i(A), the set B = C + f_1(B) + ... + f_N(B) is connected: it is A and F_w(C) for all words w (Barnsley,
"Fractals Everywhere", section 3.9). Those of F_w(C) that balls of the wall hide anyway are left out.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import FarmError
from fractal_farm.ifs.enclosure import Enclosure
from fractal_farm.ifs.genome import Genome
from fractal_farm.solid.skeleton import MAX_CONTACTS, contact_points

HIDDEN = 0.3
"""Share of the wall up to which a gap needs no strut: the neck between two balls is then 95 % of the wall."""
_STEP = 0.5  # of the spacing, between points of a strut

FloatArray = npt.NDArray[np.float64]


def strut_ends(genome: Genome, contacts: FloatArray, enclosure: Enclosure, wall: float) -> FloatArray:
    """Where the struts of a design begin and end.

    Args:
        genome: a valid genome.
        contacts: (N - 1, 2, 3) float64, the first-level edges, IFS units (`measure_gap`).
        enclosure: filled `Enclosure`.
        wall: thickness of the struts, IFS units, above 0.

    Returns:
        (m, 2, 3) float64, IFS units, all ends on the attractor; at least all those longer than HIDDEN x wall.

    Raises:
        FarmError: there are more than MAX_CONTACTS / 2; says what would pass.
    """
    ends = contact_points(genome, contacts, enclosure, HIDDEN * wall)
    n_edges = len(contacts)
    if len(ends) >= 2 * n_edges * (MAX_CONTACTS // (2 * n_edges)):
        raise FarmError(
            f"design {genome.design_id[:8]} needs more than {MAX_CONTACTS // 2} struts at this wall: raise the wall, "
            "lower the size, or thicken instead of bridges"
        )
    return ends.reshape(-1, 2, 3)


def along(struts: FloatArray, spacing: float) -> FloatArray:
    """Points on segments (m, 2, 3), no farther apart than half of `spacing`, ends included: (n, 3) float64."""
    if len(struts) == 0:
        return np.empty((0, 3))
    lengths = np.linalg.norm(struts[:, 1] - struts[:, 0], axis=1)
    steps = np.ceil(lengths / (_STEP * spacing)).astype(np.int64) + 1
    which = np.repeat(np.arange(len(struts)), steps + 1)
    number = np.arange(len(which)) - np.repeat(np.cumsum(steps + 1) - (steps + 1), steps + 1)
    share = (number / steps[which])[:, None]
    points: FloatArray = struts[which, 0] * (1.0 - share) + struts[which, 1] * share
    return points
