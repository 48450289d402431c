"""Attractor -> solid -> mesh -> files (DESIGN section 6). Names are imported when they are asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fractal_farm.solid.files import FORMATS, solid_files
    from fractal_farm.solid.parameters import SolidParameters
    from fractal_farm.solid.pipeline import make_solid, solidify
    from fractal_farm.solid.presets import preset

__all__ = ["FORMATS", "SolidParameters", "make_solid", "preset", "solid_files", "solidify"]

_HOME = {
    "FORMATS": "files",
    "SolidParameters": "parameters",
    "make_solid": "pipeline",
    "preset": "presets",
    "solid_files": "files",
    "solidify": "pipeline",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
