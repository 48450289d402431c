"""One body without cavities, in the voxel domain (DESIGN section 6, point 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

_BEYOND = 0.5


@dataclass(frozen=True)
class BodyReport:
    """What was changed.

    Attributes:
        bodies: how many separate bodies the field held.
        share: of the voxels inside, those of the largest body.
        cavities: how many enclosed cavities were filled.
    """

    bodies: int
    share: float
    cavities: int


def make_one_body(field: npt.NDArray[np.float32]) -> BodyReport:
    """Keep the largest body of a signed distance field and fill its cavities, in place.

    Bodies and cavities are joined through faces alone, the strict reading of both: what marching cubes could see as
    separate is separate.

    Args:
        field: (nx, ny, nz) float32 in voxels, negative inside, positive on the border of the grid.
    """
    inside = field < 0.0
    labels, bodies = ndimage.label(inside)
    share = 1.0
    if bodies > 1:
        # A slice at a time, since each is turned into integers of twice the size.
        sizes = np.zeros(bodies + 1, np.int64)
        for part in labels:
            sizes += np.bincount(part.ravel(), minlength=bodies + 1)
        sizes[0] = 0
        largest = int(sizes.argmax())
        share = float(sizes[largest] / sizes.sum())
        inside &= labels != largest
        field[inside] = _BEYOND
    del labels  # as large as the field; there are as many again below
    np.greater_equal(field, 0.0, out=inside)
    outside, spaces = ndimage.label(inside)
    if spaces > 1:
        inside &= outside != outside[0, 0, 0]
        field[inside] = -_BEYOND
    return BodyReport(bodies, share, spaces - 1)
