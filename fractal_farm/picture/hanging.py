"""Where copies hang on another object: on its outer points, spread over its outside like the scales of a cone.

The places of all hung objects of a scene follow one spiral of golden angles, with as much of the outside for each, and
the objects take turns in it, so that none lie upon each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fractal_farm.picture.scene_file import Hanging

FloatArray = npt.NDArray[np.float64]

_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
_HIGH = 0.05  # of the height, and half an angle, within which the outermost point is looked for
_WIDE = 0.18
_BELOW = 0.42  # of the size, from the point to the middle of what hangs there
_OUT = 0.12
_TOWARDS_VIEWER = 0.6


def turns_of(copies: Sequence[int]) -> list[list[int]]:
    """Which places along the spiral the copies of each object take: all in turn, the more copies the more often."""
    order = sorted(((copy + 0.5) / count, index) for index, count in enumerate(copies) for copy in range(count))
    turns: list[list[int]] = [[] for _ in copies]
    for number, (_, index) in enumerate(order):
        turns[index].append(number)
    return turns


def hung(
    points: FloatArray, size: float, hanging: Hanging, numbers: Sequence[int], total: int, rotation: FloatArray
) -> FloatArray:
    """Places of copies.

    Args:
        points: (n, 3) of the holder, z up.
        size: of a copy at the foot.
        hanging: how many, and where.
        numbers: (copies,) places along the spiral, from 0 on.
        total: copies of all objects that are hung.
        rotation: (3, 3) of each copy before it is turned outwards.

    Returns:
        (copies, 4, 4) float64; each copy shows its front (-y) outwards.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    height = float(high[2] - low[2]) or 1.0
    middle = 0.5 * (low + high)[:2]
    around = np.arctan2(points[:, 1] - middle[1], points[:, 0] - middle[0])
    away = np.hypot(points[:, 0] - middle[0], points[:, 1] - middle[1])
    places = np.tile(np.eye(4), (hanging.copies, 1, 1))
    for copy, number in enumerate(numbers):
        share = (number + 0.5) / total
        # A cone has its area at its foot.
        level = hanging.lowest + (hanging.highest - hanging.lowest) * (1.0 - math.sqrt(1.0 - share))
        angle = math.remainder(number * _GOLDEN_ANGLE, 2.0 * math.pi)
        apart = np.abs(np.remainder(around - angle + math.pi, 2.0 * math.pi) - math.pi)
        near = np.hypot((points[:, 2] - low[2] - level * height) / (_HIGH * height), apart / _WIDE)
        candidates = np.flatnonzero(near < 1.0)
        tip = int(candidates[away[candidates].argmax()]) if len(candidates) else int(near.argmin())
        own = size * (1.0 - hanging.taper * level)
        outwards = np.array([math.cos(around[tip]), math.sin(around[tip]), 0.0])
        places[copy, :3, :3] = own * (_facing(outwards) @ rotation)
        places[copy, :3, 3] = points[tip] + _OUT * own * outwards - [0.0, 0.0, _BELOW * own]
    return places


def _facing(outwards: FloatArray) -> FloatArray:
    """A turn about z (3, 3) that takes the front, -y, outwards, but less so aside, where only an edge would show."""
    aside = math.atan2(float(outwards[0]), -float(outwards[1]))
    angle = aside - _TOWARDS_VIEWER * math.sin(aside)
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
