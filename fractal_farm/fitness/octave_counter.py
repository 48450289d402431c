"""Counters for 32 bins at once, sliced into bits, that cost less than two instructions for sixteen items.

An item is a word with one bit set: its bin. Sixteen words lie in one vector (`simd.Words`). Full adders sum the words
bit by bit (carry-save): the vectors ones, twos, fours, eights hold the binary digits of all 32 counts of each lane,
and of every sixteen vectors one carry is left, each bit worth sixteen. Its bits are spread over eight vectors of byte
sums (vector k, byte j: bin k + 8 j), and bytes are moved to int64 totals before they can overflow.

A counter is a flat uint32 array: 4 vectors of digits, 8 vectors of byte sums, and the number of vectors in the sums.
Kernels take it, and the totals (32,) int64, as pointers.
"""

# mypy: disable-error-code="no-untyped-def, no-untyped-call"

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fractal_farm.fitness.simd import EXPONENT_BIAS, LANES, add_bit, add_bytes, load_words, no_bits, store_words
from fractal_farm.ifs.kernel import kernel

N_BINS = 16  # octaves of squared distance that are told apart
NEAREST = EXPONENT_BIAS - 21  # float32 exponent of 2^-21 <= d^2 < 2^-20: bin 0, with all that is nearer
BEYOND = NEAREST + N_BINS - 1  # that of d^2 >= 2^-6: bin 15, with all that is farther

BINS = 32
SUMS = 4 * LANES  # where the byte sums begin
USED = 12 * LANES  # where the number of vectors in them is
CAPACITY = 255  # what a byte holds


def new_counter() -> npt.NDArray[np.uint32]:
    """A counter at zero."""
    return np.zeros(USED + 1, np.uint32)


@kernel(forceinline=True)
def count(counter, words, worth, totals):
    """Add one vector of words to the byte sums; `worth` is what each set bit counts."""
    if counter[USED] == CAPACITY:
        empty_sums(counter, worth, totals)
    counter[USED] += np.uint32(1)
    store_words(counter, SUMS, add_bit(load_words(counter, SUMS), words, 0))
    store_words(counter, SUMS + 1 * LANES, add_bit(load_words(counter, SUMS + 1 * LANES), words, 1))
    store_words(counter, SUMS + 2 * LANES, add_bit(load_words(counter, SUMS + 2 * LANES), words, 2))
    store_words(counter, SUMS + 3 * LANES, add_bit(load_words(counter, SUMS + 3 * LANES), words, 3))
    store_words(counter, SUMS + 4 * LANES, add_bit(load_words(counter, SUMS + 4 * LANES), words, 4))
    store_words(counter, SUMS + 5 * LANES, add_bit(load_words(counter, SUMS + 5 * LANES), words, 5))
    store_words(counter, SUMS + 6 * LANES, add_bit(load_words(counter, SUMS + 6 * LANES), words, 6))
    store_words(counter, SUMS + 7 * LANES, add_bit(load_words(counter, SUMS + 7 * LANES), words, 7))


@kernel
def empty_sums(counter, worth, totals):
    """Move the byte sums, each worth `worth`, to the totals."""
    for k in range(8):
        add_bytes(totals, k, load_words(counter, SUMS + k * LANES), worth)
        store_words(counter, SUMS + k * LANES, no_bits())
    counter[USED] = np.uint32(0)


@kernel
def empty(counter, worth, totals):
    """Move everything to the totals; `worth` is what a bit of the byte sums counts."""
    empty_sums(counter, worth, totals)
    for digit in range(4):
        count(counter, load_words(counter, digit * LANES), worth, totals)
        empty_sums(counter, np.int64(1 << digit), totals)
        store_words(counter, digit * LANES, no_bits())
