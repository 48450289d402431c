"""Pictures that follow each other as one file: WebP, GIF, or MP4 with the extra `video`.

MP4 holds VP9, which browsers show and which is free of patents and of the GPL; of PyAV's encoders no other is used.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from PIL import Image

from fractal_farm.errors import FarmError, InputError

SUFFIXES = (".webp", ".gif", ".mp4")
_QUALITY = 85
_VIDEO_QUALITY = "24"  # constant rate factor of VP9; lower is better


def animated(pictures: Sequence[Image.Image], suffix: str, milliseconds: int = 60, *, back: bool = False) -> bytes:
    """An animation that repeats for ever.

    Args:
        pictures: of one size.
        suffix: one of `SUFFIXES`.
        milliseconds: that each is shown, 10 to 10,000.
        back: whether it goes back through the pictures, so that it repeats without a jump.

    Raises:
        InputError: another suffix, or no pictures.
        FarmError: MP4 without the extra `video`.
    """
    if suffix not in SUFFIXES:
        raise InputError(f"{suffix or 'no suffix'}: an animation is one of {', '.join(SUFFIXES)}")
    if not pictures or not 10 <= milliseconds <= 10_000:
        raise InputError("an animation needs pictures, each for 10 to 10000 milliseconds")
    frames = [*pictures, *pictures[-2:0:-1]] if back else list(pictures)
    if suffix == ".mp4":
        return _mp4(frames, milliseconds)
    content = io.BytesIO()
    first, *others = frames
    first.save(
        content, suffix[1:], save_all=True, append_images=others, duration=milliseconds, loop=0, quality=_QUALITY
    )
    return content.getvalue()


def check_video(suffix: str) -> None:
    """Refuse MP4 in one line where nothing can write it, before anything is drawn.

    Raises:
        FarmError: the extra `video` is not installed.
    """
    if suffix == ".mp4":
        _pyav()


def _mp4(frames: Sequence[Image.Image], milliseconds: int) -> bytes:
    av = _pyav()
    width, height = (side + side % 2 for side in frames[0].size)  # colour has half the resolution
    content = io.BytesIO()
    with av.open(content, "w", format="mp4") as container:
        stream = container.add_stream("libvpx-vp9", rate=Fraction(1000, milliseconds))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.options = {"crf": _VIDEO_QUALITY, "b": "0", "threads": "1", "cpu-used": "4"}
        for frame in frames:
            array = np.asarray(frame.convert("RGB"))
            padded = np.pad(array, ((0, height - array.shape[0]), (0, width - array.shape[1]), (0, 0)), mode="edge")
            for packet in stream.encode(av.VideoFrame.from_ndarray(padded, format="rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return content.getvalue()


def _pyav() -> Any:
    try:
        import av
    except ImportError:
        raise FarmError(
            "MP4 needs PyAV, which is not installed; install fractal-farm[video], or write .webp or .gif"
        ) from None
    return av
