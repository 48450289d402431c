"""Parameters by purpose and material: `presets.toml` says what a piece is for, `materials.toml` what it is made of.

`preset("pendant-silver", size_mm=25)` gives `SolidParameters`; what is named explicitly goes before the preset.
"""

from __future__ import annotations

import functools
import tomllib
from dataclasses import dataclass, fields
from importlib.resources import files
from typing import Any

from fractal_farm.errors import InputError
from fractal_farm.solid.materials import Material, material
from fractal_farm.solid.parameters import SolidParameters

SHELL_WALLS = 1.25
"""Thickness of a shell in walls: what holds a hollow is handled more roughly than a wire within."""
_HOLLOW_SHELLS = 3.0
_DRAIN_VOXELS = 3.0
_FIELDS = tuple(field.name for field in fields(SolidParameters))


@dataclass(frozen=True)
class Preset:
    """An entry of the file.

    Attributes:
        name: what it is asked for by.
        title: for people.
        material: its profile.
        shelled: whether what is thicker than the material allows is hollowed.
        values: fields of `SolidParameters`.
    """

    name: str
    title: str
    material: Material
    shelled: bool
    values: dict[str, Any]


def preset(name: str, **given: Any) -> SolidParameters:
    """The parameters of a preset.

    Args:
        name: see `presets`.
        **given: fields of `SolidParameters` that go before those of the preset; None leaves the preset's. Lengths that
            follow from others (shell from wall) follow from those given.

    Raises:
        InputError: there is no such preset or field, or a value is out of range.
    """
    return parameters_of(name, **given)


def parameters_of(name: str | None, **given: Any) -> SolidParameters:
    """`preset`, or what is given alone with the defaults of `SolidParameters` if there is no name."""
    return SolidParameters(**solid_values(name, **given))


def solid_values(name: str | None, **given: Any) -> dict[str, Any]:
    """The fields of `SolidParameters` that `parameters_of` sets, not validated yet but for their names."""
    given = {key: value for key, value in given.items() if value is not None}
    for key in given:
        if key not in _FIELDS:
            raise InputError(f"parameter is {key!r}; choose from {', '.join(_FIELDS)}")
    if name is None:
        return given
    if name not in presets():
        raise InputError(f"preset is {name!r}; choose from {', '.join(presets())}")
    chosen = presets()[name]
    profile = chosen.material
    values = {**chosen.values, **given}
    # Struts are wires that others hold at both ends. What is much larger than the preset's size gets a wall that voxels
    # can still show.
    least = max(profile.wall, profile.wire) if values.get("bridges") else profile.wall
    shown = SolidParameters.MIN_WALL_VOXELS * values["size_mm"] / SolidParameters.AUTOMATIC[1]
    values.setdefault("wall_mm", max(least, shown))
    if chosen.shelled:
        values.setdefault("shell_mm", SHELL_WALLS * values["wall_mm"])
    if values.get("shell_mm"):
        solid = max(profile.solid, _HOLLOW_SHELLS * values["shell_mm"])
        values.setdefault("shell_above_mm", solid)
        if "drain_mm" not in given:
            finest = SolidParameters(*(values.get(key, getattr(SolidParameters, key)) for key in _FIELDS[:3])).voxel_mm
            drain = max(values.get("drain_mm", SolidParameters.drain_mm), _DRAIN_VOXELS * finest)
            values["drain_mm"] = min(drain, 0.5 * values["shell_above_mm"])
    return values


@functools.cache
def presets() -> dict[str, Preset]:
    """All presets by name, in the order of the file."""
    table = tomllib.loads(files("fractal_farm.solid").joinpath("presets.toml").read_text("utf-8"))
    return {
        name: Preset(name, entry.pop("title"), material(entry.pop("material")), entry.pop("shelled", False), entry)
        for name, entry in table.items()
    }
