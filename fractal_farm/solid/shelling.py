"""Hollowing of what is thicker than a threshold T, and holes that drain it, in the voxel domain (DESIGN section 6).

The samples that lie T/2 deep are the cores of thick parts; a hollow is what lies within T/2 - shell of a core. Every
point of it is at least `shell` deep, parts thinner than T stay solid, and its walls are rounded. Each hollow is opened
along a straight line that leaves the solid for good, so that powder, resin or investment comes out, and an eye or a
wire can follow it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from fractal_farm.errors import FarmError
from fractal_farm.solid.offsets import Field, distance_to, opened

_NEAR = 2.0  # voxels from the surface in which it is told finely
_SMOOTHING = 0.75
_SPARED = 0.25  # voxels added to the shell, for what smoothing and marching cubes may take
_PLACES = 150
_STEP = 0.5  # voxels
_DOWNWARD = 0.15  # how much longer a drain may be for pointing down
_DIRECTIONS = 64

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Hollows:
    """What was taken out.

    Attributes:
        count: number of hollows, each with a drain.
        share: of the samples inside before.
        axes: (count, 2, 3) float64, voxels: where each drain begins, inside, and where it leaves the solid.
    """

    count: int
    share: float
    axes: FloatArray


def hollow(field: Field, shell: float, above: float, drain: float, least: float, downwards: bool) -> Hollows:
    """Take out what lies deep in thick parts, and drain it, in place.

    Args:
        field: (nx, ny, nz) float32, signed distance in voxels, negative inside, of one body without cavities.
        shell: thickness that stays, voxels.
        above: thickness that is still left solid, voxels; above 2 shell.
        drain: diameter of the holes, voxels, at most half of `above`. Hollows smaller than a ball of it stay solid.
        least: half of the wall, voxels: a drain that passes close below the surface takes what is thinner along.
        downwards: whether drains may point down.

    Raises:
        FarmError: a hollow has no straight way out; says what would pass.
    """
    depth = distance_to(field, 0.0)
    core = depth >= 0.5 * above
    if not core.any():
        return Hollows(0, 0.0, np.empty((0, 2, 3)))
    inside = int(np.count_nonzero(field < 0.0))
    cavity = distance_to(depth, 0.5 * above, 0.5 * above - shell + _NEAR)
    cavity -= np.float32(0.5 * above - shell - _SPARED)
    ndimage.gaussian_filter(cavity, _SMOOTHING, truncate=2.5, output=cavity)
    labels, count = ndimage.label(cavity < 0.0)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    axes = []
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        own = labels[box] == label
        places = np.argwhere(own & core[box]) + [side.start for side in box]
        if sizes[label] < math.pi / 6.0 * drain**3 or len(places) == 0:
            cavity[box][own] = 1.0
            continue
        axes.append(_way_out(field, places, downwards))
    np.maximum(field, -cavity, out=field)
    for begin, end in axes:
        _drill(field, begin, end, 0.5 * drain, least)
    left = int(np.count_nonzero(field < 0.0))
    return Hollows(len(axes), 1.0 - left / inside, np.array(axes).reshape(-1, 2, 3))


def _way_out(field: Field, places: npt.NDArray[np.int64], downwards: bool) -> tuple[FloatArray, FloatArray]:
    """The shortest straight line from one of (n, 3) places that leaves the solid and does not meet it again."""
    places = places[:: max(1, len(places) // _PLACES)]
    directions = _sphere(_DIRECTIONS)
    if not downwards:
        directions = directions[directions[:, 2] > -0.2]
    distances = np.arange(0.0, math.hypot(*field.shape), _STEP)
    least, found = math.inf, None
    for direction in directions:
        samples = np.rint(places[:, None, :] + direction * distances[:, None]).astype(np.int64)
        within = np.all((samples >= 0) & (samples < field.shape), axis=2)
        np.clip(samples, 0, np.array(field.shape) - 1, out=samples)
        solid = within & (field[samples[..., 0], samples[..., 1], samples[..., 2]] < 0.0)
        # Free is what stays outside once it has left: the solid samples are the first ones.
        lengths = np.count_nonzero(solid, axis=1) * _STEP
        free = solid.shape[1] - np.argmax(solid[:, ::-1], axis=1) == np.count_nonzero(solid, axis=1)
        if not free.any():
            continue
        lengths[~free] = math.inf
        place = int(lengths.argmin())
        cost = lengths[place] * (1.0 + (_DOWNWARD * (1.0 + direction[2]) if downwards else 0.0))
        if cost < least:
            least, found = cost, (places[place].astype(np.float64), places[place] + direction * lengths[place])
    if found is None:
        raise FarmError("a hollow inside has no straight way out: leave shell_mm out, or raise shell_above_mm")
    return found


def _drill(field: Field, begin: FloatArray, end: FloatArray, radius: float, least: float) -> None:
    """A round hole from `begin`, flat there, to `radius` beyond `end`, voxels; what is thinner beside it goes, too."""
    length = float(np.linalg.norm(end - begin))
    axis = (end - begin) / length
    corners = np.stack([begin, end + radius * axis])
    room = radius + 4.0 * least + 2.0
    low = np.maximum(np.floor(corners.min(axis=0) - room).astype(int), 0)
    high = np.minimum(np.ceil(corners.max(axis=0) + room).astype(int) + 1, field.shape)
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    steps = np.stack(np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high, strict=True)), indexing="ij"), axis=-1)
    steps = steps - begin
    along = steps @ axis
    across = np.sqrt(np.maximum((steps * steps).sum(axis=-1) - along * along, 0.0))
    hole = np.minimum(np.minimum(radius - across, along), length + radius - along)
    field[box] = np.maximum(field[box], hole.astype(np.float32))
    near = hole > -2.0 * least
    field[box][near] = opened(field[box], least)[near]


def _sphere(count: int) -> FloatArray:
    """(count + 6, 3) unit vectors: along the axes, and spread evenly (Fibonacci)."""
    number = np.arange(count) + 0.5
    z = 1.0 - 2.0 * number / count
    angle = number * math.pi * (1.0 + math.sqrt(5.0))
    flat = np.sqrt(1.0 - z * z)
    spread = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])
    return np.concatenate([np.eye(3)[::-1] * -1.0, np.eye(3), spread])
