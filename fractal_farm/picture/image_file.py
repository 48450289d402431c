"""A picture as the bytes of a file."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image


def encoded(picture: Image.Image | npt.NDArray[np.uint8], form: str = "PNG", **options: Any) -> bytes:
    """A picture in a form that Pillow writes, as small as it makes it.

    Args:
        picture: an image, or (height, width, 3) or (height, width, 4) pixels.
        form: "PNG" or "JPEG".
        options: of Pillow's writer, as `quality`.
    """
    content = io.BytesIO()
    image = picture if isinstance(picture, Image.Image) else Image.fromarray(picture)
    image.save(content, form, optimize=True, **options)
    return content.getvalue()
