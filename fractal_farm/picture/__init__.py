"""Pictures of clouds, meshes and catalogues, drawn without OpenGL (DESIGN section 7).

Names are imported when they are asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fractal_farm.picture.cloud import cloud_picture
    from fractal_farm.picture.colours import dual_tone, linear_gradient
    from fractal_farm.picture.metal import mesh_picture
    from fractal_farm.picture.sheet import design_sheet, render_genome
    from fractal_farm.picture.view import choose_view

__all__ = [
    "choose_view",
    "cloud_picture",
    "design_sheet",
    "dual_tone",
    "linear_gradient",
    "mesh_picture",
    "render_genome",
]

_HOME = {
    "choose_view": "view",
    "cloud_picture": "cloud",
    "design_sheet": "sheet",
    "dual_tone": "colours",
    "linear_gradient": "colours",
    "mesh_picture": "metal",
    "render_genome": "sheet",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
