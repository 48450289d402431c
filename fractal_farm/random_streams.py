"""Every source of randomness of a run, by name.

A stream is a counter-based generator (Philox) addressed by what it is for: run seed, purpose, island,
generation, block and attempt. Nothing is consumed in an order that depends on time, place or the number of
workers. Blocks have a fixed shape whose row is the slot, so a slot's numbers never depend on its neighbours.
"""

from __future__ import annotations

import enum

import numpy as np


class Purpose(enum.IntEnum):
    """What a stream is for; the values are part of a run's identity and never change."""

    FOUNDERS = 1
    PARENTS = 2
    CROSSOVER = 3
    MUTATION = 4
    EMIGRANTS = 5
    REPLACEMENT = 6
    TOPOLOGY = 7
    SCALES = 8
    SYMMETRY = 9


def stream(
    seed: int, purpose: Purpose, island: int = 0, generation: int = 0, block: int = 0, attempt: int = 0
) -> np.random.Generator:
    """The stream of one purpose at one place.

    Args:
        seed: the run's seed, 0 .. 2^64 - 1.
        purpose: what the numbers are for.
        island: 0 .. 2^31 - 1.
        generation: 0 .. 2^31 - 1.
        block: block of slots within the generation, 0 .. 2^31 - 1.
        attempt: repetition of a draw for the same slots, 0 .. 2^31 - 1.

    Returns:
        A generator that owns 2^128 draws of its own.
    """
    high = np.array([0, 0, generation << 32 | block, island << 32 | attempt], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(counter=high, key=np.array([seed, purpose], dtype=np.uint64)))
