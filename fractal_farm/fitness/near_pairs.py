"""Which pairs of points must be looked at: bounds from boxes around consecutive points in Morton order.

Points come in *groups* of 4 and *blocks* of 64, which are small boxes in space because the order is Morton's. A set of
32 points, the *columns*, is compared with sixteen blocks at once, then with the sixteen groups of each block that is
left: what lies beyond the largest radius is skipped, and what has its nearest and its farthest corner in one bin is
counted as a whole. Nothing is lost to rounding: the squared distance to a corner is computed by the operations that
compute a pair's, and each of them is monotone, so that no pair can be nearer than the nearest corner, or farther than
the farthest.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import numpy as np

from fractal_farm.fitness.octave_counter import BEYOND, NEAREST, count
from fractal_farm.fitness.simd import (
    LANES,
    lanes_below,
    lanes_equal,
    load_floats,
    maximum,
    octave,
    one_hot,
    splat,
    squared_length,
    subtract,
    trailing_zeros,
    where_equal,
)
from fractal_farm.ifs.kernel import kernel

GROUP = 4
BLOCK = GROUP * LANES
COLUMNS = 32
COLUMN_GROUPS = COLUMNS // GROUP


@kernel
def fill_boxes(points, n, n_blocks, group_boxes, block_boxes):
    """Boxes of all groups and blocks. Points at infinity make a box reach to infinity: never in one bin."""
    for axis in range(3):
        x = points[axis]
        low = group_boxes[2 * axis]
        high = group_boxes[2 * axis + 1]
        x[n:] = np.inf
        for group in range((n_blocks + 1) * LANES):
            i = group * GROUP
            low[group] = min(min(x[i], x[i + 1]), min(x[i + 2], x[i + 3]))
            high[group] = max(max(x[i], x[i + 1]), max(x[i + 2], x[i + 3]))
        block_boxes[2 * axis, :] = np.inf
        block_boxes[2 * axis + 1, :] = np.inf
        for block in range(n_blocks):
            first = low[block * LANES]
            last = high[block * LANES]
            for group in range(block * LANES + 1, (block + 1) * LANES):
                first = min(first, low[group])
                last = max(last, high[group])
            block_boxes[2 * axis, block] = first
            block_boxes[2 * axis + 1, block] = last


@kernel
def list_near(columns, first_block, n_blocks, boxes, rows, n_rows, whole_groups, whole_blocks, totals):
    """List the groups of the blocks from first_block on that must be evaluated against a set of columns.

    Args:
        columns: box of the columns, from `span`.
        first_block: number of the first block to be looked at.
        n_blocks: number of blocks.
        boxes: pointer to group boxes, their stride, pointer to block boxes, their stride.
        rows: pointer to int32; numbers of groups are written from n_rows on.
        n_rows: how many are listed already.
        whole_groups: counter of groups that lie in one bin.
        whole_blocks: counter of blocks that lie in one bin.
        totals: (32,) int64, where full counters go.

    Returns:
        How many are listed now.
    """
    group_boxes, group_stride, block_boxes, block_stride = boxes
    for some_blocks in range(first_block, n_blocks, LANES):
        blocks, bins = _undecided(columns, block_boxes, block_stride, some_blocks)
        count(whole_blocks, bins, BLOCK * COLUMNS, totals)
        while blocks != 0:
            group = (some_blocks + trailing_zeros(blocks)) * LANES
            blocks &= blocks - np.uint32(1)
            groups, bins = _undecided(columns, group_boxes, group_stride, group)
            count(whole_groups, bins, GROUP * COLUMNS, totals)
            while groups != 0:
                rows[n_rows] = group + trailing_zeros(groups)
                groups &= groups - np.uint32(1)
                n_rows += 1
    return n_rows


@kernel(forceinline=True)
def span(boxes, stride, first):
    """The box of the eight groups that make a set of columns, as six float32."""
    x_low, x_high = _range(boxes, first, first + stride)
    y_low, y_high = _range(boxes, first + 2 * stride, first + 3 * stride)
    z_low, z_high = _range(boxes, first + 4 * stride, first + 5 * stride)
    return x_low, x_high, y_low, y_high, z_low, z_high


@kernel(forceinline=True)
def _undecided(columns, boxes, stride, first):
    """Compare sixteen boxes with the columns' box.

    Returns:
        Bit mask of the boxes that are near and span more than one bin, and the bins of those that lie in one.
    """
    x_low, x_high, y_low, y_high, z_low, z_high = columns
    x_lows, x_highs = load_floats(boxes, first), load_floats(boxes, first + stride)
    y_lows, y_highs = load_floats(boxes, first + 2 * stride), load_floats(boxes, first + 3 * stride)
    z_lows, z_highs = load_floats(boxes, first + 4 * stride), load_floats(boxes, first + 5 * stride)
    nearest = octave(
        squared_length(
            _gap(x_low, x_high, x_lows, x_highs),
            _gap(y_low, y_high, y_lows, y_highs),
            _gap(z_low, z_high, z_lows, z_highs),
        ),
        NEAREST,
    )
    farthest = octave(
        squared_length(
            _reach(x_low, x_high, x_lows, x_highs),
            _reach(y_low, y_high, y_lows, y_highs),
            _reach(z_low, z_high, z_lows, z_highs),
        ),
        NEAREST,
    )
    bins = where_equal(nearest, farthest, one_hot(nearest))
    return lanes_below(nearest, BEYOND) & ~lanes_equal(nearest, farthest), bins


@kernel(forceinline=True)
def _gap(low, high, lows, highs):
    """Distance between the interval [low, high] and sixteen others; 0 where they overlap."""
    apart = maximum(subtract(lows, splat(high)), subtract(splat(low), highs))
    return maximum(splat(np.float32(0.0)), apart)


@kernel(forceinline=True)
def _reach(low, high, lows, highs):
    """Largest distance between a point of the interval [low, high] and one of sixteen others."""
    return maximum(subtract(highs, splat(low)), subtract(splat(high), lows))


@kernel(forceinline=True)
def _range(boxes, lows, highs):
    low, high = boxes[lows], boxes[highs]
    for k in range(1, COLUMN_GROUPS):
        low = min(low, boxes[lows + k])
        high = max(high, boxes[highs + k])
    return low, high
