"""Exact pair counts in octaves of squared distance: the correlation sum of Grassberger and Procaccia (1983).

Bin 0 holds the pairs with d^2 < 2^-20, bin k those with 2^(k-21) <= d^2 < 2^(k-20), bin 14 ends at 2^-6 and bin 15
holds the rest: radii 2^-10 to 2^-3 of the bounding cube's side, in half octaves. No logarithm and no comparison is
needed, since the exponent bits of the float32 d^2 *are* the bin.

All n (n - 1) / 2 pairs are counted, few are looked at. Points come in Morton order, so that 64 consecutive ones fill a
small box, and 4 consecutive ones a tiny one. A block of 32 points, the *columns*, is compared with sixteen boxes of
64 rows at once, then with the sixteen groups of 4 in the boxes that remain: groups beyond the largest radius are
skipped, groups of which the nearest and the farthest corner lie in one bin are counted as a whole, and only the others
are evaluated point by point. Nothing is lost to rounding: the nearest corner's d^2 is computed by the operations that
compute a pair's, and each of them is monotone, so it is never larger than the d^2 of any pair.

The tail is filled with points at infinity: their d^2 is infinite or not a number, exponent 255, bin 31 of 32, unread.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.fitness.octave_counter import (
    BINS,
    CAPACITY,
    SUMS,
    USED,
    count,
    empty,
    empty_sums,
    new_counter,
)
from fractal_farm.fitness.simd import (
    LANES,
    add_bit,
    full_adder,
    lanes_below,
    lanes_equal,
    load_floats,
    load_words,
    maximum,
    octave,
    one_hot,
    pointer,
    splat,
    squared_length,
    store_words,
    subtract,
    trailing_zeros,
    where_equal,
)
from fractal_farm.ifs.kernel import kernel

N_BINS = 16
COLUMNS = 32
GROUP = 4
COLUMN_GROUPS = COLUMNS // GROUP
BLOCK = GROUP * LANES  # rows that sixteen groups hold
NEAREST = 106  # float32 exponent of 2^-21 <= d^2 < 2^-20
BEYOND = NEAREST + N_BINS - 1  # that of d^2 >= 2^-6


class PairWorkspace(NamedTuple):
    """Memory for the pair counts of up to n points.

    Attributes:
        points: (3, padded n) float32, coordinates in the unit cube in Morton order; the caller fills the first n.
        group_boxes: (6, groups) float32, rows x low, x high, y low, ... of 4 consecutive points.
        block_boxes: (6, blocks) float32, the same for 64 consecutive points.
        rows: (groups,) int32, numbers of the groups to be evaluated against one block of columns.
        own: counter of pairs within blocks of columns, in both orders and with themselves.
        others: counter of evaluated pairs of columns with later rows.
        whole_groups: counter of groups that lie in one bin, each worth 4 x 32 pairs.
        whole_blocks: counter of blocks that lie in one bin, each worth 64 x 32 pairs.
        own_totals: (32,) int64, totals of `own` by exponent modulo 32.
        totals: (32,) int64, totals of the other counters.
    """

    points: npt.NDArray[np.float32]
    group_boxes: npt.NDArray[np.float32]
    block_boxes: npt.NDArray[np.float32]
    rows: npt.NDArray[np.int32]
    own: npt.NDArray[np.uint32]
    others: npt.NDArray[np.uint32]
    whole_groups: npt.NDArray[np.uint32]
    whole_blocks: npt.NDArray[np.uint32]
    own_totals: npt.NDArray[np.int64]
    totals: npt.NDArray[np.int64]


def new_pair_workspace(n: int) -> PairWorkspace:
    """Workspace for clouds of up to n points, n >= 1."""
    blocks = -(-n // BLOCK)
    padded = (blocks + 1) * BLOCK  # one empty block: its groups fill up `rows`
    return PairWorkspace(
        np.empty((3, padded), np.float32),
        np.empty((6, padded // GROUP), np.float32),
        np.empty((6, blocks + LANES), np.float32),
        np.empty(padded // GROUP, np.int32),
        new_counter(),
        new_counter(),
        new_counter(),
        new_counter(),
        np.zeros(BINS, np.int64),
        np.zeros(BINS, np.int64),
    )


@kernel
def count_pairs(work, n, prune, counts):
    """Count the pairs of the first n points of the workspace.

    Args:
        work: `PairWorkspace`, of which `points` holds coordinates in [0, 1].
        n: number of points, at least 1.
        prune: False evaluates every pair, for comparison.
        counts: (16,) int64, filled; their sum is n (n - 1) / 2.
    """
    n_blocks = (n + BLOCK - 1) // BLOCK
    n_groups = n_blocks * LANES
    _bounding_boxes(work.points, n, n_blocks, work.group_boxes, work.block_boxes)
    work.own_totals[:] = 0
    work.totals[:] = 0
    points = pointer(work.points)
    padded = np.int64(work.points.shape[1])
    boxes = (
        pointer(work.group_boxes),
        np.int64(work.group_boxes.shape[1]),
        pointer(work.block_boxes),
        np.int64(work.block_boxes.shape[1]),
    )
    rows = pointer(work.rows)
    own = pointer(work.own)
    others = pointer(work.others)
    whole_groups = pointer(work.whole_groups)
    whole_blocks = pointer(work.whole_blocks)
    own_totals = pointer(work.own_totals)
    totals = pointer(work.totals)
    n_own = np.int64(COLUMN_GROUPS)
    for first_group in range(0, n_groups, COLUMN_GROUPS):
        column = first_group * GROUP
        for k in range(COLUMN_GROUPS):
            rows[k] = first_group + k
        _evaluate(points, padded, column, rows, n_own, own, own_totals)
        if prune:
            n_rows = _list_near(first_group, n_groups, boxes, rows, whole_groups, whole_blocks, totals)
        else:
            n_rows = n_groups - first_group - COLUMN_GROUPS
            for k in range(n_rows):
                rows[k] = first_group + COLUMN_GROUPS + k
        if n_rows % 2 == 1:
            rows[n_rows] = n_groups
            n_rows += 1
        _evaluate(points, padded, column, rows, n_rows, others, totals)
    empty(own, np.int64(LANES), own_totals)
    empty(others, np.int64(LANES), totals)
    empty(whole_groups, np.int64(GROUP * COLUMNS), totals)
    empty(whole_blocks, np.int64(BLOCK * COLUMNS), totals)
    own_totals[NEAREST % BINS] -= n
    rest = n * (n - 1) // 2
    for k in range(N_BINS - 1):
        b = (NEAREST + k) % BINS
        counts[k] = totals[b] + own_totals[b] // 2
        rest -= counts[k]
    counts[N_BINS - 1] = rest


@kernel
def _list_near(first_group, n_groups, boxes, rows, whole_groups, whole_blocks, totals):
    """List the later groups that must be evaluated against the columns of first_group; returns how many."""
    group_boxes, group_stride, block_boxes, block_stride = boxes
    n_rows = 0
    if first_group % LANES == 0:  # the other half of the own block is near
        for k in range(COLUMN_GROUPS):
            rows[k] = first_group + COLUMN_GROUPS + k
        n_rows = COLUMN_GROUPS
    columns = _span(group_boxes, group_stride, first_group)
    for first_block in range(first_group // LANES + 1, n_groups // LANES, LANES):
        blocks, bins = _undecided(columns, block_boxes, block_stride, first_block)
        count(whole_blocks, bins, BLOCK * COLUMNS, totals)
        while blocks != 0:
            group = (first_block + trailing_zeros(blocks)) * LANES
            blocks &= blocks - np.uint32(1)
            groups, bins = _undecided(columns, group_boxes, group_stride, group)
            count(whole_groups, bins, GROUP * COLUMNS, totals)
            while groups != 0:
                rows[n_rows] = group + trailing_zeros(groups)
                groups &= groups - np.uint32(1)
                n_rows += 1
    return n_rows


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


@kernel
def _evaluate(points, padded, column, rows, n_rows, counter, totals):
    """Count the pairs of 32 columns with the groups listed in rows (an even number)."""
    ones = load_words(counter, 0)
    twos = load_words(counter, 1 * LANES)
    fours = load_words(counter, 2 * LANES)
    eights = load_words(counter, 3 * LANES)
    used = np.int64(counter[USED])
    start = 0
    while start < n_rows:
        if used == CAPACITY:
            empty_sums(counter, np.int64(LANES), totals)
            used = np.int64(0)
        stop = min(n_rows, start + 2 * (CAPACITY - used))
        used += (stop - start) // 2
        s0 = load_words(counter, SUMS)
        s1 = load_words(counter, SUMS + 1 * LANES)
        s2 = load_words(counter, SUMS + 2 * LANES)
        s3 = load_words(counter, SUMS + 3 * LANES)
        s4 = load_words(counter, SUMS + 4 * LANES)
        s5 = load_words(counter, SUMS + 5 * LANES)
        s6 = load_words(counter, SUMS + 6 * LANES)
        s7 = load_words(counter, SUMS + 7 * LANES)
        for i in range(start, stop, 2):
            ones, twos, fours, eight0 = _add_group(points, padded, column, rows[i], ones, twos, fours)
            ones, twos, fours, eight1 = _add_group(points, padded, column, rows[i + 1], ones, twos, fours)
            eights, sixteen = full_adder(eights, eight0, eight1)
            s0 = add_bit(s0, sixteen, 0)
            s1 = add_bit(s1, sixteen, 1)
            s2 = add_bit(s2, sixteen, 2)
            s3 = add_bit(s3, sixteen, 3)
            s4 = add_bit(s4, sixteen, 4)
            s5 = add_bit(s5, sixteen, 5)
            s6 = add_bit(s6, sixteen, 6)
            s7 = add_bit(s7, sixteen, 7)
        store_words(counter, SUMS, s0)
        store_words(counter, SUMS + 1 * LANES, s1)
        store_words(counter, SUMS + 2 * LANES, s2)
        store_words(counter, SUMS + 3 * LANES, s3)
        store_words(counter, SUMS + 4 * LANES, s4)
        store_words(counter, SUMS + 5 * LANES, s5)
        store_words(counter, SUMS + 6 * LANES, s6)
        store_words(counter, SUMS + 7 * LANES, s7)
        start = stop
    counter[USED] = np.uint32(used)
    store_words(counter, 0, ones)
    store_words(counter, 1 * LANES, twos)
    store_words(counter, 2 * LANES, fours)
    store_words(counter, 3 * LANES, eights)


@kernel(forceinline=True)
def _add_group(points, padded, column, group, ones, twos, fours):
    """Count four rows against 32 columns: the new digits, and a carry worth eight."""
    row = np.int64(group) * GROUP
    ones, two0 = _add_row(points, padded, column, row, ones)
    ones, two1 = _add_row(points, padded, column, row + 1, ones)
    twos, four0 = full_adder(twos, two0, two1)
    ones, two0 = _add_row(points, padded, column, row + 2, ones)
    ones, two1 = _add_row(points, padded, column, row + 3, ones)
    twos, four1 = full_adder(twos, two0, two1)
    fours, eight = full_adder(fours, four0, four1)
    return ones, twos, fours, eight


@kernel(forceinline=True)
def _add_row(points, padded, column, row, ones):
    """Count one row against 32 columns: the new ones, and a carry worth two."""
    x = splat(points[row])
    y = splat(points[padded + row])
    z = splat(points[2 * padded + row])
    left = _bins(points, padded, column, x, y, z)
    right = _bins(points, padded, column + LANES, x, y, z)
    return full_adder(ones, left, right)


@kernel(forceinline=True)
def _bins(points, padded, column, x, y, z):
    """The bins of sixteen columns against one row, as words."""
    squared_distance = squared_length(
        subtract(load_floats(points, column), x),
        subtract(load_floats(points, padded + column), y),
        subtract(load_floats(points, 2 * padded + column), z),
    )
    return one_hot(octave(squared_distance, NEAREST))


@kernel
def _bounding_boxes(points, n, n_blocks, group_boxes, block_boxes):
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


@kernel(forceinline=True)
def _span(boxes, stride, first):
    """The box of the eight groups that make a block of columns, as six float32."""
    x_low, x_high = _range(boxes, first, first + stride)
    y_low, y_high = _range(boxes, first + 2 * stride, first + 3 * stride)
    z_low, z_high = _range(boxes, first + 4 * stride, first + 5 * stride)
    return x_low, x_high, y_low, y_high, z_low, z_high


@kernel(forceinline=True)
def _range(boxes, lows, highs):
    low, high = boxes[lows], boxes[highs]
    for k in range(1, COLUMN_GROUPS):
        low = min(low, boxes[lows + k])
        high = max(high, boxes[highs + k])
    return low, high
