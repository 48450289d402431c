"""Pictures of designs: one, or a sheet of many with captions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.random_iteration import attractor_points
from fractal_farm.picture.cloud import GROUND, cloud_picture, dual_tone, linear_gradient

Colouring = Literal["gradient", "dual"]
_GUTTER = 12
_CAPTION = 26
_INK = (150, 156, 168)


def render_genome(
    genome: Genome | npt.ArrayLike, size: int = 512, n_points: int | None = None, colouring: Colouring = "gradient"
) -> Image.Image:
    """A picture of one design.

    Args:
        genome: a `Genome` or an (N, 7) array.
        size: width and height, pixels.
        n_points: points to draw; enough to fill the picture if None.
        colouring: "gradient" or "dual", the two of the paper.

    Raises:
        InputError: an invalid genome, or arguments out of range.
    """
    painters = {"gradient": linear_gradient, "dual": dual_tone}
    if colouring not in painters:
        raise InputError(f"colouring is {colouring!r}; choose one of {', '.join(painters)}")
    count = n_points if n_points is not None else max(20_000, 2 * size * size)
    points = attractor_points(genome, count, "display")
    return Image.fromarray(cloud_picture(points, size, painters[colouring](points)))


def design_sheet(
    designs: Sequence[tuple[Genome, str]], columns: int = 6, tile: int = 256, colouring: Colouring = "gradient"
) -> Image.Image:
    """A sheet of designs with a caption under each.

    Args:
        designs: genomes and captions, in reading order.
        columns: designs in a row.
        tile: width and height of one picture, pixels.
        colouring: "gradient" or "dual".

    Raises:
        InputError: no designs.
    """
    if not designs:
        raise InputError("no designs to draw; choose at least one")
    columns = min(columns, len(designs))
    rows = -(-len(designs) // columns)
    width = columns * (tile + _GUTTER) + _GUTTER
    height = rows * (tile + _CAPTION + _GUTTER) + _GUTTER
    ground = tuple(int(255 * value) for value in GROUND)
    sheet = Image.new("RGB", (width, height), ground)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(13)
    for index, (genome, caption) in enumerate(designs):
        left = _GUTTER + (index % columns) * (tile + _GUTTER)
        top = _GUTTER + (index // columns) * (tile + _CAPTION + _GUTTER)
        sheet.paste(render_genome(genome, tile, colouring=colouring), (left, top))
        draw.text((left + tile / 2, top + tile + _CAPTION / 2), caption, _INK, font, anchor="mm")
    return sheet
