"""Symmetries of designs: the shape is the union of the attractor A and its images under a few isometries.

What the isometries turn about follows from the maps (`copies`): p is the fixed point of the smallest map, q that of the
largest, and the axis is the one about which the smallest map turns, through p. All copies meet in p, or, along a helix,
each ends where the next begins: a symmetric design is one piece wherever A is. The kinds:

- rotation:n   n copies, each turned by 1/n of a turn about the axis
- mirror       A and its reflection in the plane of the axis and q
- dihedral:n   the reflections of all copies of rotation:n besides
- helix:n      n copies, each turned by a sixth of a turn about the axis and carried on from p to q

This module alone knows them. A symmetry is written as its name; its place in `SYMMETRIES` is its code in arrays.
Nothing here imports numba, which islands breed genomes without, and numpy only where it is needed: commands name the
kinds in their help.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from fractal_farm.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

NO_SYMMETRY = "none"
MAX_COPIES = 12
HELIX_TURN = 1.0 / 6.0


class Symmetry(NamedTuple):
    """One set of isometries, in the numbers that kernels take.

    Attributes:
        name: how it is written.
        copies: number of isometries, the identity included.
        turn: of one copy after the other, in full turns.
        mirrored: whether each turned copy stands beside its reflection.
        carried: whether each copy begins where the one before it ends.
    """

    name: str
    copies: int
    turn: float
    mirrored: bool
    carried: bool


SYMMETRIES = (
    Symmetry(NO_SYMMETRY, 1, 0.0, False, False),
    *(Symmetry(f"rotation:{n}", n, 1.0 / n, False, False) for n in range(2, 13)),
    Symmetry("mirror", 2, 0.0, True, False),
    *(Symmetry(f"dihedral:{n}", 2 * n, 1.0 / n, True, False) for n in range(2, 7)),
    *(Symmetry(f"helix:{n}", n, HELIX_TURN, False, True) for n in range(2, 9)),
)
"""In the order of their codes, which stand in records: new ones come last."""

ALLOWED = "none, rotation:2 to rotation:12, mirror, dihedral:2 to dihedral:6, helix:2 to helix:8"
_SHOWN = 40  # characters of a wrong name
_CODES = {symmetry.name: code for code, symmetry in enumerate(SYMMETRIES)}


def symmetry_code(name: object, where: str) -> int:
    """The code of a symmetry.

    Args:
        name: as somebody wrote it.
        where: what complaints begin with.

    Raises:
        InputError: there is no such symmetry.
    """
    if not isinstance(name, str) or name not in _CODES:
        raise InputError(f"{where}: symmetry is {str(name)[:_SHOWN]!r}; allowed: {ALLOWED}")
    return _CODES[name]


def symmetry_codes(names: Iterable[str]) -> npt.NDArray[np.uint8]:
    """The codes of symmetries that are known to exist, (n,) uint8."""
    import numpy as np

    return np.array([_CODES[name] for name in names], np.uint8)
