"""The design code, cut into the underside of a base, so that a piece in the hand can be found again (`farm show`)."""

from __future__ import annotations

import math

import manifold3d
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

LEAST_STROKE = 0.25
"""Millimetres: narrower grooves close when they are polished."""

DEPTH = 0.4
"""In walls; a base is two walls thick."""

_FILLED = 0.85  # radius of the writing, in that of the base
_OVERLAP = 0.06  # of a stroke: pixels that touch at a corner become one groove


def least_radius(code: str) -> float:
    """The radius of the smallest base that a code finds room on, mm."""
    return 0.5 * math.hypot(*_pixels(code).shape) * LEAST_STROKE / _FILLED


def engraving(code: str, centre: npt.NDArray[np.float64], radius: float, wall_mm: float) -> manifold3d.Manifold:
    """What is cut out of a base: letters that are read from below.

    Args:
        code: a design code, written in three lines.
        centre: (3,) mm, of the underside, which faces down.
        radius: of the underside, mm, `least_radius` or more.
        wall_mm: of the solid.
    """
    letters = _pixels(code)
    height, width = letters.shape
    stroke = 2.0 * _FILLED * radius / math.hypot(height, width)
    rows, columns = np.nonzero(letters)
    side = (1.0 + _OVERLAP) * stroke
    square = manifold3d.CrossSection.square((side, side), center=True)
    # From below, x runs to the left.
    right = (0.5 * (width - 1) - columns) * stroke
    up = (0.5 * (height - 1) - rows) * stroke
    pixels = [square.translate((x, y)) for x, y in zip(right.tolist(), up.tolist(), strict=True)]
    text = manifold3d.CrossSection.batch_boolean(pixels, manifold3d.OpType.Add)
    depth = DEPTH * wall_mm
    return text.extrude(2.0 * depth).translate((centre[0], centre[1], centre[2] - depth))


def _pixels(code: str) -> npt.NDArray[np.bool_]:
    """The code in three lines, a stroke one or two pixels wide, without empty rows and columns around."""
    mark, first, second, *rest = code.split("-")
    text = "\n".join([f"{mark}-{first}", second, "-".join(rest)])
    font = ImageFont.load_default_imagefont()
    draw = ImageDraw.Draw(Image.new("1", (1, 1)))
    left, top, right, bottom = draw.multiline_textbbox((0, 0), text, font, align="center", spacing=0)
    image = Image.new("1", (math.ceil(right - left), math.ceil(bottom - top)))
    ImageDraw.Draw(image).multiline_text((-left, -top), text, 1, font, align="center", spacing=0)
    drawn = np.asarray(image)
    filled = np.argwhere(drawn)
    (low_row, low_column), (high_row, high_column) = filled.min(axis=0), filled.max(axis=0)
    return drawn[low_row : high_row + 1, low_column : high_column + 1]
