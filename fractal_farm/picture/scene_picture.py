"""A scene as a picture: in perspective, with depth between its objects, soft light and a little bloom."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.picture.balls import SUPERSAMPLE, draw_balls, light_on
from fractal_farm.picture.cloud import MAX_SIZE, to_bytes
from fractal_farm.picture.colours import Colour
from fractal_farm.picture.ground import NIGHT
from fractal_farm.picture.scene import Scene
from fractal_farm.picture.view import tilted

FloatArray = npt.NDArray[np.float64]

_MARGIN = 0.05
_AFORE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_BLOOM = 0.35
_BLOOM_WIDTH = 0.012  # of the picture's height
_GLOW = 0.10


def scene_picture(scene: Scene, width: int = 900, height: int = 1200) -> npt.NDArray[np.uint8]:
    """Draw a scene.

    Args:
        scene: what `compose` returns.
        width: pixels, 16 to 8192.
        height: the same.

    Returns:
        (height, width, 3) uint8.

    Raises:
        InputError: a size out of range.
    """
    return next(iter(scene_turntable(scene, width, height, 1)))


def scene_turntable(scene: Scene, width: int, height: int, frames: int) -> list[npt.NDArray[np.uint8]]:
    """Pictures of a whole turn of the scene about its upright axis, at one scale; see `scene_picture`.

    Raises:
        InputError: a size or the number of frames is out of range.
    """
    for name, value, most in (("width", width, MAX_SIZE), ("height", height, MAX_SIZE), ("turntable", frames, 360)):
        if not (1 if name == "turntable" else 16) <= value <= most:
            raise InputError(f"{name} is {value}; give {1 if name == 'turntable' else 16} to {most}")
    copies = [(thing, copy) for thing in scene.things for copy in range(len(thing.places))]
    points = np.concatenate([thing.placed(copy) for thing, copy in copies])
    sizes = [float(np.cbrt(abs(np.linalg.det(thing.places[copy, :3, :3])))) for thing, copy in copies]
    counts = [len(thing.points) for thing, _ in copies]
    radii = np.repeat([thing.radius * size for (thing, _), size in zip(copies, sizes, strict=True)], counts)
    glow = np.repeat([thing.glow for thing, _ in copies], counts)
    colours = np.concatenate([thing.colours for thing, _ in copies])
    light = np.stack(light_on(points, radii), axis=1)
    middle = scene.box().mean(axis=0)
    ground = _ground(scene.ground, width, height)
    scale = None
    pictures = []
    for frame in range(frames):
        view = _view(math.radians(scene.camera.turn) + 2.0 * math.pi * frame / frames, scene.camera.tilt)
        if scale is None:
            reach = _all_round(points - middle, view, frames > 1)
            scale = min(width / reach[0], height / reach[1]) * (1.0 - 2.0 * _MARGIN) * SUPERSAMPLE
        seen = (points - middle) @ view.T
        away = scene.camera.distance * float(np.ptp(points, axis=0).max())
        nearness = away / np.maximum(away - seen[:, 2], 1e-3 * away)
        placed = np.stack(
            [
                0.5 * SUPERSAMPLE * width + scale * seen[:, 0] * nearness,
                0.5 * SUPERSAMPLE * height - scale * seen[:, 1] * nearness,
                scale * seen[:, 2],
            ],
            axis=1,
        )
        picture = ground.copy()
        draw_balls(placed, radii * scale * nearness, colours, light, glow, view, picture)
        pictures.append(to_bytes(_bloomed(picture, ground)))
    return pictures


def _view(turn: float, tilt: float) -> FloatArray:
    """Rows right, up and towards the viewer."""
    c, s = math.cos(turn), math.sin(turn)
    return tilted(_AFORE @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), math.radians(tilt))


def _all_round(offsets: FloatArray, view: FloatArray, turning: bool) -> tuple[float, float]:
    """Width and height that a scene takes as seen, or in a whole turn."""
    seen = offsets @ view.T
    across = 2.0 * float(np.hypot(offsets[:, 0], offsets[:, 1]).max()) if turning else 2.0 * np.abs(seen[:, 0]).max()
    return max(float(across), 1e-9), max(2.0 * float(np.abs(seen[:, 1]).max()), 1e-9)


def _ground(colour: Colour | None, width: int, height: int) -> npt.NDArray[np.float32]:
    """(height, width, 3) float32: an even colour, or night with a soft light behind the middle."""
    if colour is not None:
        return np.full((height, width, 3), colour, np.float32)
    x = np.linspace(-1.0, 1.0, width)[None, :] * min(1.0, width / height)
    y = np.linspace(-1.0, 1.0, height)[:, None] * min(1.0, height / width)
    glow = _GLOW * np.exp(-1.6 * (x * x + y * y))
    lit: npt.NDArray[np.float32] = (np.array(NIGHT) + glow[..., None] * np.array([0.75, 0.85, 1.1])).astype(np.float32)
    return lit


def _bloomed(picture: npt.NDArray[np.float32], ground: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """The picture with a little of its brightest places spread around them."""
    from scipy.ndimage import gaussian_filter

    width = _BLOOM_WIDTH * len(picture)
    bright = np.maximum(picture - 0.62, 0.0) * (picture.max(axis=2, keepdims=True) > ground.max() + 0.05)
    halo = sum(gaussian_filter(bright, (scale * width, scale * width, 0)) for scale in (0.5, 1.5))
    bloomed = 1.0 - (1.0 - np.clip(picture, 0, 1)) * (1.0 - np.clip(_BLOOM * halo, 0, 1))
    return np.asarray(bloomed, np.float32)
