"""Scale and wall of a solid, known from the gap before anything is computed (DESIGN section 6, points 2 and 3).

The solid is the set of points within r of the attractor scaled to S mm, S + 2 r = size. It is one body when 2 r is at
least gap x S, and where two balls of radius r meet across a gap their neck is sqrt((2 r)^2 - gap^2) thick. So 2 r =
hypot(wall, gap), if it may grow, leaves no neck thinner than the wall. Bridges (`struts`) join what the wall does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fractal_farm.errors import FarmError
from fractal_farm.solid.parameters import SolidParameters

NECK = 1.1


@dataclass(frozen=True)
class SolidPlan:
    """How the attractor becomes a solid.

    Attributes:
        attractor_mm: longest side of the scaled attractor.
        radius_mm: of the balls; the thickness of the solid is twice that.
        thickened: whether the gap asks for more than the wall.
    """

    attractor_mm: float
    radius_mm: float
    thickened: bool


def plan_solid(gap: float, parameters: SolidParameters, name: str) -> SolidPlan:
    """The plan for an attractor with this gap.

    Args:
        gap: see `fractal_farm.ifs.gap`.
        parameters: what is asked for.
        name: of the design, for the message.

    Raises:
        FarmError: the design would fall apart, and neither may it thicken nor has it bridges; says what would pass.
    """
    size, wall = parameters.size_mm, parameters.wall_mm
    if parameters.bridges:
        return SolidPlan(size - wall, 0.5 * wall, False)
    if parameters.thicken:
        # (size - S)^2 = wall^2 + gap^2 S^2, the smaller root, written without cancellation
        both = size * size - wall * wall
        attractor = both / (size + math.sqrt(size * size - (1.0 - gap * gap) * both))
        return SolidPlan(attractor, 0.5 * (size - attractor), NECK * gap * (size - wall) > wall)
    attractor = size - wall
    if NECK * gap * attractor > wall:
        least_wall = size * NECK * gap / (1.0 + NECK * gap)
        largest_size = wall * (1.0 + NECK * gap) / (NECK * gap)
        raise FarmError(
            f"design {name} falls apart at {size:g} mm with a wall of {wall:g} mm, its pieces are "
            f"{gap * attractor:.2f} mm apart: wall >= {_up(least_wall)} mm, or size <= {_down(largest_size)} mm, "
            "or thicken, or bridges"
        )
    return SolidPlan(attractor, 0.5 * wall, False)


def _up(value: float) -> str:
    return f"{math.ceil(value * 100.0) / 100.0:.2f}"


def _down(value: float) -> str:
    return f"{math.floor(value * 10.0) / 10.0:.1f}"
