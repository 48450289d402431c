"""Occupied boxes of all dyadic levels in one pass over sorted Morton keys (Liebovitch and Toth 1989; Hou 1990).

Two neighbours in key order part at the level of their highest differing bit. A box of level l begins wherever two
neighbours have parted at l or above, so that a histogram of parting levels, summed up, gives N(l). A point alone in its
box has parted from both neighbours, which gives the singletons; two alone together, the doubletons. From these two
Chao's estimator (1984) tells how many boxes of the attractor the cloud has missed.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import numpy as np

from fractal_farm.fitness.morton import INDEX_BITS, LEVELS
from fractal_farm.fitness.simd import leading_zeros
from fractal_farm.ifs.kernel import kernel

OCCUPIED, SINGLE, DOUBLE = 0, 1, 2


@kernel
def count_boxes(keys, n, parting, boxes):
    """Count occupied boxes, boxes with one point and boxes with two, for levels 0 to 10.

    Args:
        keys: (m,) uint64, Morton key << 32 | index, of which the first n are sorted and count.
        n: number of points, at least 1.
        parting: (m + 1,) int64, working space.
        boxes: (3, 12) int64, filled: rows `OCCUPIED`, `SINGLE`, `DOUBLE`; column l is level l, the last is unused.
    """
    boxes[:] = 0
    parting[0] = 0
    parting[n] = 0
    for i in range(1, n):
        same_bits = leading_zeros(np.uint32((keys[i] ^ keys[i - 1]) >> np.uint64(INDEX_BITS)))  # two of them unused
        parting[i] = np.uint32(same_bits + 1) // np.uint32(3)
    for i in range(n):
        boxes[OCCUPIED, parting[i]] += 1
        boxes[SINGLE, max(parting[i], parting[i + 1])] += 1
        if i + 1 < n:
            outer = max(parting[i], parting[i + 2])
            if outer < parting[i + 1]:
                boxes[DOUBLE, outer] += 1
                boxes[DOUBLE, parting[i + 1]] -= 1
    for row in range(3):
        for level in range(1, LEVELS + 1):
            boxes[row, level] += boxes[row, level - 1]


@kernel
def chao1(occupied, single, double):
    """Lower bound of the number of boxes, seen and unseen (Chao 1984, bias-corrected form)."""
    return occupied + single * (single - 1.0) / (2.0 * (double + 1.0))
