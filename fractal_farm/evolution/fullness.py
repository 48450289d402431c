"""Which designs are more than a bare line, a narrow V or a thin helix.

Fullness is D0 + t / 2, with t the thickness: the smallest principal standard deviation of the cloud over the largest. A
segment has 1, a disc 2, a ball 3.5. Of 151 designs that were sorted by eye, two thirds of them drawn among those of low
D0, the limit of 1.35 takes 20 of the 23 bare lines, 8 of 33 in doubt, and 9 of the 95 others, mostly spirals of a few
thin arms. Limits on D0 and thickness apart took 14 lines and 5 others at the best.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig

_THICKNESS = -2  # place in a descriptor


def is_full(
    dimensions: npt.NDArray[np.float64], descriptors: npt.NDArray[np.float32], config: EvolutionConfig
) -> npt.NDArray[np.bool_]:
    """Whether designs have the fullness that `niches.fullness` asks for.

    Args:
        dimensions: (n,) float64 D0, or what is expected in its place.
        descriptors: (n, 14) float32, see `fitness.shape_descriptor`.
        config: evolution section.

    Returns:
        (n,) bool; False where a number is nan, unless anything will do.
    """
    least = config.niches.fullness
    if least is None:
        return np.ones(len(dimensions), np.bool_)
    full: npt.NDArray[np.bool_] = dimensions + 0.5 * descriptors[:, _THICKNESS].astype(np.float64) >= least
    return full
