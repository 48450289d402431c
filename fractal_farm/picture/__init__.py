"""Pictures of clouds, meshes and catalogues, drawn without OpenGL (DESIGN section 7).

Names are imported when they are asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fractal_farm.picture.cloud import cloud_picture
    from fractal_farm.picture.colours import dual_tone, linear_gradient
    from fractal_farm.picture.image_file import encoded
    from fractal_farm.picture.metal import mesh_picture, turntable
    from fractal_farm.picture.morph import morph_genomes, morph_pictures
    from fractal_farm.picture.scene import compose
    from fractal_farm.picture.scene_file import load_scene
    from fractal_farm.picture.scene_files import scene_glb, scene_page
    from fractal_farm.picture.sheet import captioned_sheet, design_sheet, render_genome
    from fractal_farm.picture.sweep import paper_sweeps, sweep_pictures, sweep_sheet, swept
    from fractal_farm.picture.view import choose_view

__all__ = [
    "captioned_sheet",
    "choose_view",
    "cloud_picture",
    "compose",
    "design_sheet",
    "dual_tone",
    "encoded",
    "linear_gradient",
    "load_scene",
    "mesh_picture",
    "morph_genomes",
    "morph_pictures",
    "paper_sweeps",
    "render_genome",
    "scene_glb",
    "scene_page",
    "sweep_pictures",
    "sweep_sheet",
    "swept",
    "turntable",
]

_HOME = {
    "captioned_sheet": "sheet",
    "choose_view": "view",
    "cloud_picture": "cloud",
    "compose": "scene",
    "design_sheet": "sheet",
    "dual_tone": "colours",
    "encoded": "image_file",
    "linear_gradient": "colours",
    "load_scene": "scene_file",
    "mesh_picture": "metal",
    "morph_genomes": "morph",
    "morph_pictures": "morph",
    "paper_sweeps": "sweep",
    "render_genome": "sheet",
    "scene_glb": "scene_files",
    "scene_page": "scene_files",
    "sweep_pictures": "sweep",
    "sweep_sheet": "sweep",
    "swept": "sweep",
    "turntable": "metal",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
