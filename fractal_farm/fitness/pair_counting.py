"""Exact pair counts in octaves of squared distance: the correlation sum of Grassberger and Procaccia (1983).

Bin 0 holds the pairs with d^2 < 2^-20, bin k those with 2^(k-21) <= d^2 < 2^(k-20), bin 14 ends at 2^-6 and bin 15
holds the rest: radii 2^-10 to 2^-3 of the bounding cube's side, in half octaves. No logarithm and no comparison is
needed, since the exponent bits of the float32 d^2 *are* the bin.

All n (n - 1) / 2 pairs are counted, few are looked at: `near_pairs` decides about most of them by the box, and the
rest is evaluated in tiles of 32 columns by 8 rows.

Each row gives two words to a lane (columns 0 to 15, and 16 to 31). The full adders of `octave_counter` take them in as
a binary counter takes in ticks, for all 32 bins at once:

    row      2 words                  -> ones, carry worth 2
    2 rows   2 such carries           -> twos, carry worth 4
    4 rows   2 such carries           -> fours, carry worth 8   (`_add_group`)
    8 rows   2 such carries           -> eights, carry worth 16 (the loop of `evaluate_groups`)

and only the last carry, every sixteenth word, touches the byte sums.

*Padding.* The tail of the last block is filled with points at infinity: a distance to them is infinite, and one between
two of them not a number, which both land in bin 31 modulo 32, as no distance does that counts. A group number one past
the last stands for four such points, to make a list of rows even. Pairs within the columns' own block of 32 are
evaluated in both orders and with themselves, in a counter of their own that is halved at the end.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.fitness.near_pairs import BLOCK, COLUMN_GROUPS, COLUMNS, GROUP, fill_boxes, list_near, span
from fractal_farm.fitness.octave_counter import (
    BINS,
    CAPACITY,
    N_BINS,
    NEAREST,
    SUMS,
    USED,
    empty,
    empty_sums,
    new_counter,
)
from fractal_farm.fitness.simd import (
    LANES,
    add_bit,
    full_adder,
    load_floats,
    load_words,
    octave,
    one_hot,
    pointer,
    splat,
    squared_length,
    store_words,
    subtract,
)
from fractal_farm.ifs.kernel import kernel


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
    fill_boxes(work.points, n, n_blocks, work.group_boxes, work.block_boxes)
    work.own_totals[:] = 0
    work.totals[:] = 0
    points = (pointer(work.points), np.int64(work.points.shape[1]))
    boxes = box_pointers(work)
    rows, totals = pointer(work.rows), pointer(work.totals)
    others, whole_groups, whole_blocks = pointer(work.others), pointer(work.whole_groups), pointer(work.whole_blocks)
    own, own_totals = pointer(work.own), pointer(work.own_totals)
    n_own = np.int64(COLUMN_GROUPS)
    for first_group in range(0, n_groups, COLUMN_GROUPS):
        column = first_group * GROUP
        for k in range(COLUMN_GROUPS):
            rows[k] = first_group + k
        evaluate_groups(points, column, points, rows, n_own, own, own_totals)
        first_block = first_group // LANES + 1
        n_rows = 0
        for group in range(first_group + COLUMN_GROUPS, n_groups if not prune else first_block * LANES):
            rows[n_rows] = group
            n_rows += 1
        if prune:
            columns = span(boxes[0], boxes[1], first_group)
            n_rows = list_near(columns, first_block, n_blocks, boxes, rows, n_rows, whole_groups, whole_blocks, totals)
        if n_rows % 2 == 1:
            rows[n_rows] = n_groups
            n_rows += 1
        evaluate_groups(points, column, points, rows, n_rows, others, totals)
    empty_all(others, whole_groups, whole_blocks, totals)
    empty(own, np.int64(LANES), own_totals)
    own_totals[NEAREST % BINS] -= n
    rest = n * (n - 1) // 2
    for k in range(N_BINS - 1):
        b = (NEAREST + k) % BINS
        counts[k] = totals[b] + own_totals[b] // 2
        rest -= counts[k]
    counts[N_BINS - 1] = rest


@kernel(forceinline=True)
def box_pointers(work):
    """The boxes of a `PairWorkspace` as `near_pairs` takes them."""
    return (
        pointer(work.group_boxes),
        np.int64(work.group_boxes.shape[1]),
        pointer(work.block_boxes),
        np.int64(work.block_boxes.shape[1]),
    )


@kernel
def empty_all(others, whole_groups, whole_blocks, totals):
    """Move what the three counters hold to the totals."""
    empty(others, np.int64(LANES), totals)
    empty(whole_groups, np.int64(GROUP * COLUMNS), totals)
    empty(whole_blocks, np.int64(BLOCK * COLUMNS), totals)


@kernel
def evaluate_groups(columns, column, points, rows, n_rows, counter, totals):
    """Count the pairs of 32 columns with the groups listed in rows (an even number).

    Args:
        columns: pointer to (3, stride) float32 coordinates, and the stride.
        column: number of the first of the 32.
        points: pointer and stride of the points that the groups are made of.
        rows: pointer to int32 numbers of groups.
        n_rows: int64, how many.
        counter: pointer to a counter.
        totals: pointer to (32,) int64, where a full counter goes.
    """
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
            ones, twos, fours, eight0 = _add_group(columns, column, points, rows[i], ones, twos, fours)
            ones, twos, fours, eight1 = _add_group(columns, column, points, rows[i + 1], ones, twos, fours)
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
def _add_group(columns, column, points, group, ones, twos, fours):
    """Count four rows against 32 columns: the new digits, and a carry worth eight."""
    row = np.int64(group) * GROUP
    ones, two0 = _add_row(columns, column, points, row, ones)
    ones, two1 = _add_row(columns, column, points, row + 1, ones)
    twos, four0 = full_adder(twos, two0, two1)
    ones, two0 = _add_row(columns, column, points, row + 2, ones)
    ones, two1 = _add_row(columns, column, points, row + 3, ones)
    twos, four1 = full_adder(twos, two0, two1)
    fours, eight = full_adder(fours, four0, four1)
    return ones, twos, fours, eight


@kernel(forceinline=True)
def _add_row(columns, column, points, row, ones):
    """Count one row against 32 columns: the new ones, and a carry worth two."""
    coordinates, stride = points
    x = splat(coordinates[row])
    y = splat(coordinates[stride + row])
    z = splat(coordinates[2 * stride + row])
    left = _bins(columns, column, x, y, z)
    right = _bins(columns, column + LANES, x, y, z)
    return full_adder(ones, left, right)


@kernel(forceinline=True)
def _bins(columns, column, x, y, z):
    """The bins of sixteen columns against one row, as words."""
    coordinates, stride = columns
    squared_distance = squared_length(
        subtract(load_floats(coordinates, column), x),
        subtract(load_floats(coordinates, stride + column), y),
        subtract(load_floats(coordinates, 2 * stride + column), z),
    )
    return one_hot(octave(squared_distance, NEAREST))
