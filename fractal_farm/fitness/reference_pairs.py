"""Pair counts of large clouds: a sample of reference points against all points.

All pairs of 200,000 points take a second. The correlation sum is the mean, over the points, of the share of the cloud
within r of them; taken over `REFERENCES` of them it has hardly more noise, and the work grows like n instead of its
square. Every k-th point in Morton order is a reference: they lie as evenly over the cloud as can be. Each pair of a
reference with another point is counted once, exactly, with the bins and the pruning of `pair_counting`.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.fitness.near_pairs import BLOCK, COLUMNS, GROUP, fill_boxes, list_near, span
from fractal_farm.fitness.octave_counter import BINS, N_BINS, NEAREST
from fractal_farm.fitness.pair_counting import box_pointers, empty_all, evaluate_groups
from fractal_farm.fitness.simd import LANES, pointer
from fractal_farm.ifs.kernel import kernel

REFERENCES = 10_240  # a multiple of 64: half the points of the largest cloud of which all pairs are counted


class ReferenceWorkspace(NamedTuple):
    """Memory for the reference points.

    Attributes:
        points: (3, padded m) float32, coordinates of the references.
        group_boxes: (6, groups) float32, boxes of 4 consecutive references.
        block_boxes: (6, blocks) float32, boxes of 64.
    """

    points: npt.NDArray[np.float32]
    group_boxes: npt.NDArray[np.float32]
    block_boxes: npt.NDArray[np.float32]


def new_reference_workspace() -> ReferenceWorkspace:
    """An empty working space."""
    padded = REFERENCES + BLOCK
    return ReferenceWorkspace(
        np.empty((3, padded), np.float32),
        np.empty((6, padded // GROUP), np.float32),
        np.empty((6, REFERENCES // BLOCK), np.float32),
    )


@kernel
def count_reference_pairs(work, n, references, counts):
    """Count the pairs of `REFERENCES` points with all other points.

    Args:
        work: `PairWorkspace`, of which `points` holds coordinates in [0, 1] in Morton order.
        n: number of points, more than `REFERENCES`.
        references: `ReferenceWorkspace`.
        counts: (16,) int64, filled with the bins of `count_pairs`; their sum is REFERENCES (n - 1).
    """
    n_blocks = (n + BLOCK - 1) // BLOCK
    fill_boxes(work.points, n, n_blocks, work.group_boxes, work.block_boxes)
    for axis in range(3):
        for j in range(REFERENCES):
            references.points[axis, j] = work.points[axis, j * n // REFERENCES]
    fill_boxes(references.points, REFERENCES, REFERENCES // BLOCK, references.group_boxes, references.block_boxes)
    work.totals[:] = 0
    columns = (pointer(references.points), np.int64(references.points.shape[1]))
    column_boxes, column_stride = pointer(references.group_boxes), np.int64(references.group_boxes.shape[1])
    points = (pointer(work.points), np.int64(work.points.shape[1]))
    boxes = box_pointers(work)
    rows, totals = pointer(work.rows), pointer(work.totals)
    others, whole_groups, whole_blocks = pointer(work.others), pointer(work.whole_groups), pointer(work.whole_blocks)
    for column in range(0, REFERENCES, COLUMNS):
        box = span(column_boxes, column_stride, column // GROUP)
        n_rows = list_near(box, 0, n_blocks, boxes, rows, 0, whole_groups, whole_blocks, totals)
        if n_rows % 2 == 1:
            rows[n_rows] = n_blocks * LANES
            n_rows += 1
        evaluate_groups(columns, column, points, rows, n_rows, others, totals)
    empty_all(others, whole_groups, whole_blocks, totals)
    totals[NEAREST % BINS] -= REFERENCES  # each with itself
    rest = REFERENCES * (n - 1)
    for k in range(N_BINS - 1):
        counts[k] = totals[(NEAREST + k) % BINS]
        rest -= counts[k]
    counts[N_BINS - 1] = rest
