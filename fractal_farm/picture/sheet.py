"""Pictures of designs: one, or a sheet of many with captions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.picture.cloud import cloud_picture
from fractal_farm.picture.colours import coloured, legible
from fractal_farm.picture.ground import NIGHT
from fractal_farm.picture.points import display_points

_GUTTER = 10
_CAPTION = 28
_LABEL = 30
_INK = (158, 164, 178)
_LABEL_INK = (222, 226, 234)
_POINTS_A_PIXEL = 0.6


def render_genome(
    genome: Genome | npt.ArrayLike,
    size: int = 512,
    n_points: int | None = None,
    colouring: str = "gradient",
) -> Image.Image:
    """A picture of one design: all of its attractor, in the paper's colours, brightened where they are too dark.

    Args:
        genome: a `Genome` or an (N, 7) array.
        size: width and height, pixels, 16 to 8192.
        n_points: about how many points to draw; enough for the size if None.
        colouring: "gradient" or "dual".

    Raises:
        InputError: an invalid genome, or arguments out of range.
    """
    valid = as_genome(genome)
    if n_points is None:
        n_points = max(20_000, int(_POINTS_A_PIXEL * size * size))
    if n_points < 100:
        raise InputError(f"n_points is {n_points}; draw at least 100")
    points, radius = display_points(valid, n_points)
    colours = legible(coloured(points, colouring))
    return Image.fromarray(cloud_picture(points, size, colours, point_radius=radius))


def design_sheet(
    designs: Sequence[tuple[Genome, str]],
    columns: int = 6,
    tile: int = 256,
    colouring: str = "gradient",
) -> Image.Image:
    """A sheet of designs with a caption under each.

    Args:
        designs: genomes and captions, in reading order.
        columns: designs in a row, at least 1.
        tile: width and height of one picture, pixels.
        colouring: "gradient" or "dual".

    Raises:
        InputError: no designs, no columns, or arguments out of range.
    """
    return captioned_sheet(
        [(render_genome(genome, tile, colouring=colouring), caption) for genome, caption in designs], columns
    )


def captioned_sheet(pictures: Sequence[tuple[Image.Image, str]], columns: int = 6) -> Image.Image:
    """Square pictures of one size, each with its caption under it.

    Args:
        pictures: with their captions, in reading order.
        columns: pictures in a row, at least 1.

    Raises:
        InputError: no pictures, or no columns.
    """
    if columns < 1:
        raise InputError(f"columns is {columns}; give at least 1")
    return labelled_rows([("", pictures[start : start + columns]) for start in range(0, len(pictures), columns)])


def labelled_rows(rows: Sequence[tuple[str, Sequence[tuple[Image.Image, str]]]]) -> Image.Image:
    """Rows of square pictures of one size, each picture with its caption under it, a row with its label above it.

    Args:
        rows: labels, which may be empty, and pictures with their captions, from top to bottom.

    Raises:
        InputError: no pictures.
    """
    if not rows or not rows[0][1]:
        raise InputError("no designs to draw; choose at least one")
    tile = rows[0][1][0][0].width
    columns = max(len(pictures) for _, pictures in rows)
    step = tile + _GUTTER
    height = sum(step + _CAPTION + (_LABEL if label else 0) for label, _ in rows)
    ground = tuple(int(255 * value + 0.5) for value in NIGHT)
    sheet = Image.new("RGB", (columns * step + _GUTTER, height + _GUTTER), ground)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(13)
    top = _GUTTER
    for label, pictures in rows:
        if label:
            draw.text((_GUTTER, top + _LABEL / 2 - 2), label, _LABEL_INK, ImageFont.load_default(16), anchor="lm")
            top += _LABEL
        for index, (picture, caption) in enumerate(pictures):
            left = _GUTTER + index * step
            sheet.paste(picture, (left, top))
            draw.text((left + tile / 2, top + tile + _CAPTION / 2 - 2), caption, _INK, font, anchor="mm")
        top += step + _CAPTION
    return sheet
