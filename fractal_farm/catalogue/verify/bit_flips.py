"""Undoing a single flipped bit: CRC32C does not only find it, it says which one it was.

The checksum is linear: flipping one bit changes it by a pattern that depends on the bit's distance from the end
alone, and no two distances below 2^31 - 1 share a pattern. Longer damage may imitate one flipped bit (with a
probability of 8 n / 2^32 for n bytes), so what comes out is a candidate that its format has to confirm.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue.layout import crc32c

_POLYNOMIAL = 0x82F63B78
_BLOCK_BITS = 16

Patterns = npt.NDArray[np.uint32]


def unflipped(content: bytes, checksum: int) -> bytes | None:
    """The content with the one bit flipped back that gives it this CRC32C, or None if no bit does."""
    pattern = crc32c(content) ^ checksum
    columns = np.array([_POLYNOMIAL, *(1 << k for k in range(31))], np.uint32)
    block = np.array([_POLYNOMIAL], np.uint32)
    for _ in range(_BLOCK_BITS):
        block = np.concatenate([block, _product(columns, block)])
        columns = _product(columns, columns)
    for start in range(0, 8 * len(content), len(block)):
        found = np.flatnonzero(block == pattern)
        if len(found) and (distance := start + int(found[0])) < 8 * len(content):
            return flipped(content, 8 * (len(content) - 1 - distance // 8) + 7 - distance % 8)
        block = _product(columns, block)
    return None


def unflipped_by_trial(content: bytes, is_sound: Callable[[bytes], bool]) -> bytes | None:
    """The only content one bit away that is sound, or None; for short documents that seal themselves."""
    sound = [each for bit in range(8 * len(content)) if is_sound(each := flipped(content, bit))]
    return sound[0] if len(sound) == 1 else None


def flipped(content: bytes, bit: int) -> bytes:
    """The content with one bit flipped; bit 0 is the lowest of the first byte."""
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def _product(columns: Patterns, patterns: Patterns) -> Patterns:
    """A 32 x 32 matrix over GF(2), given by its columns, times each pattern: by table, a byte at a time."""
    result = np.zeros_like(patterns)
    for byte in range(4):
        table = np.zeros(1, np.uint32)
        for column in columns[8 * byte : 8 * byte + 8]:
            table = np.concatenate([table, table ^ column])
        result ^= table[(patterns >> np.uint32(8 * byte)) & np.uint32(255)]
    return result
