"""Pictures of clouds and catalogues, drawn without OpenGL (DESIGN section 7)."""

from fractal_farm.picture.cloud import cloud_picture, dual_tone, linear_gradient
from fractal_farm.picture.sheet import design_sheet, render_genome

__all__ = ["cloud_picture", "design_sheet", "dual_tone", "linear_gradient", "render_genome"]
