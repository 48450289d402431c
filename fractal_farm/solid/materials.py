"""What materials ask of a solid: profiles from `materials.toml`, each with its source and date (DESIGN section 6)."""

from __future__ import annotations

import functools
import tomllib
from dataclasses import dataclass
from importlib.resources import files

from fractal_farm.errors import InputError


@dataclass(frozen=True)
class Material:
    """A profile.

    Attributes:
        name: what it is asked for by.
        title: for people.
        wall: least thickness of a form that carries itself, mm.
        wire: least thickness of a wire that others hold at both ends, mm.
        solid: largest thickness that should not be shelled, mm.
        density: g/cm^3.
        shrink: share of a length that is lost between model and piece.
        polish: share of the mass that polishing takes.
        smallest_side: least side of the box, mm; 0 where nothing is asked.
        sum_of_sides: least sum of the three sides of the box, mm; 0 where nothing is asked.
        source: where the profile comes from.
        date: when it was written down.
    """

    name: str
    title: str
    wall: float
    wire: float
    solid: float
    density: float
    shrink: float
    polish: float
    smallest_side: float
    sum_of_sides: float
    source: str
    date: str

    def grams(self, volume_mm3: float) -> float:
        """Mass of a volume as it is cast or printed, before polishing, g."""
        return volume_mm3 * self.density * 1e-3


def material(name: str) -> Material:
    """The profile of this name.

    Raises:
        InputError: there is none.
    """
    if name not in materials():
        raise InputError(f"material is {name!r}; choose from {', '.join(materials())}")
    return materials()[name]


@functools.cache
def materials() -> dict[str, Material]:
    """All profiles by name, in the order of the file."""
    table = tomllib.loads(files("fractal_farm.solid").joinpath("materials.toml").read_text("utf-8"))
    return {name: Material(name=name, **entry) for name, entry in table.items()}
