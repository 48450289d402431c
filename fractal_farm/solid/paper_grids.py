"""The grids that the paper's jewellery was computed on (section 5.2), and how fine a grid is for a solid of ours.

J0698 had 85 x 199 x 144 cubes and J0619 200 x 156 x 126; the genomes of both are not printed, and none of table 1 has
their proportions. What carries over is the edge of a voxel: the longest side of the solid is 199 or 200 of them, and
the other sides are as many as the design is wide.
"""

from __future__ import annotations

import re

from fractal_farm.errors import InputError

PAPER_GRIDS = {"J0698": (85, 199, 144), "J0619": (200, 156, 126)}
PAPER_RESOLUTION = 200
_FEWEST, _MOST = 32, 1000
_GRID = re.compile(r"(\d{1,4})x(\d{1,4})x(\d{1,4})")


def paper_resolution(jewel: str) -> int:
    """Voxels along the longest side of a solid, neither finer nor coarser than the paper's grid for "J0698" or "J0619".

    Raises:
        InputError: another name.
    """
    if jewel not in PAPER_GRIDS:
        raise InputError(f"jewel is {jewel!r}; the paper gives grids for {' and '.join(PAPER_GRIDS)}")
    return max(PAPER_GRIDS[jewel])


def grid_resolution(grid: str) -> int:
    """Voxels along the longest side of a solid that is as fine as a grid.

    Args:
        grid: "85x199x144", any three numbers whose largest is 32 to 1000; "J0698" or "J0619"; or "paper", the finer of
            these two.

    Raises:
        InputError: something else.
    """
    if grid in PAPER_GRIDS:
        return paper_resolution(grid)
    if grid == "paper":
        return PAPER_RESOLUTION
    numbers = _GRID.fullmatch(grid.replace(" ", "").lower())
    sides = [int(number) for number in numbers.groups()] if numbers else [0]
    if not (min(sides) >= 1 and _FEWEST <= max(sides) <= _MOST):
        raise InputError(
            f"grid is {grid!r}; give three numbers such as 85x199x144, the largest {_FEWEST} to {_MOST}, or one of the "
            f"paper's: paper, {', '.join(PAPER_GRIDS)}"
        )
    return max(sides)
