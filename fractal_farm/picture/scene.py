"""Scenes: designs with places, sizes, rotations and colours, as clouds of small balls (paper section 5.1, figure 7).

`compose` turns the description of a scene into things to draw; `scene_picture`, `scene_glb` and `scene_page` show
them. Designs that are named by id or description are asked for from whoever calls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fractal_farm.errors import InputError
from fractal_farm.genome_file import genome_from
from fractal_farm.ifs.even_points import even_points
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.picture.colours import Colour, dual_tone, legible, linear_gradient
from fractal_farm.picture.hanging import hung, turns_of
from fractal_farm.picture.metal import TINTS
from fractal_farm.picture.scene_file import Camera, Colouring, ObjectSection, SceneFile
from fractal_farm.picture.view import TILT, choose_view, tilted

FloatArray = npt.NDArray[np.float64]
Asked = Callable[[ObjectSection], Genome]

_TOUCHING = 0.62  # of the median distance to the nearest point
_LEAST_RADIUS = 0.35  # of what an even plane of as many points would have
_FROM_ABOVE_TO_UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class Thing:
    """One object of a scene, in its own box and in the places where it stands.

    Attributes:
        name: of the object.
        genome: its design.
        points: (n, 3) float64, the middle of the box at 0 and its longest side 1; z up, y away from the viewer.
        turn: (3, 3) rotation that took the design's own coordinates there.
        radius: of each point, in the same unit.
        colours: (n, 3) float64 red, green, blue in [0, 1].
        metal: name of a metal, or None.
        glow: how far it shines by itself, 0 to 1.
        places: (k, 4, 4) float64, from its box to the scene.
    """

    name: str
    genome: Genome
    points: FloatArray
    turn: FloatArray
    radius: float
    colours: FloatArray
    metal: str | None
    glow: float
    places: FloatArray

    def placed(self, copy: int) -> FloatArray:
        """The points (n, 3) of one of its copies in the scene."""
        matrix = self.places[copy]
        placed: FloatArray = self.points @ matrix[:3, :3].T + matrix[:3, 3]
        return placed


@dataclass(frozen=True)
class Scene:
    """Things, and how they are looked at."""

    title: str
    things: tuple[Thing, ...]
    camera: Camera
    ground: Colour | None

    @property
    def n_points(self) -> int:
        """Number of points, all copies counted."""
        return sum(len(thing.points) * len(thing.places) for thing in self.things)

    def box(self) -> FloatArray:
        """(2, 3) float64, lower and upper corner of all points."""
        corners = [thing.placed(copy) for thing in self.things for copy in range(len(thing.places))]
        return np.array(
            [
                np.min([each.min(axis=0) for each in corners], axis=0),
                np.max([each.max(axis=0) for each in corners], axis=0),
            ]
        )


def compose(file: SceneFile, asked: Asked | None = None, source: str = "scene") -> Scene:
    """The scene that a file describes.

    Args:
        file: what `load_scene` returns.
        asked: finds the design of an object with `design` or `like`; without it, `like` gives way to `genome`.
        source: what messages call the file.

    Raises:
        InputError: an invalid genome, or a design is asked for and nobody is there to ask.
    """
    phenotype = file.phenotype.phenotype() if file.phenotype else Phenotype()
    genomes = {name: genome_from(value, phenotype, f"{source}: genome {name}") for name, value in file.genomes.items()}
    things: dict[str, Thing] = {}
    hanging = [each for each in file.objects if each.hang]
    turns = dict(
        zip(
            (each.name for each in hanging),
            turns_of([each.hang.copies for each in hanging if each.hang]),
            strict=True,
        )
    )
    n_hung = sum(map(len, turns.values()))
    for each in file.objects:
        if asked is not None and (each.genome is None or each.like is not None):
            genome = asked(each)
        elif each.genome is not None:
            genome = genomes[each.genome]
        else:
            raise InputError(f"{source}: object {each.name} is a design of a catalogue; say which one with --catalogue")
        thing = _thing(each, genome)
        if each.hang is not None:
            holder = things[each.hang.holder]
            places = hung(holder.placed(0), each.size, each.hang, turns[each.name], n_hung, rotation_of(each.rotation))
            thing = _moved(thing, places)
        things[each.name] = thing
    return Scene(file.title, tuple(things.values()), file.camera, file.ground)


def rotation_of(angles: Sequence[float]) -> FloatArray:
    """The paper's R = R_z(roll) R_x(pitch) R_y(yaw), (3, 3), of pitch, yaw and roll in degrees."""
    pitch, yaw, roll = (math.radians(angle) for angle in angles)
    x = np.array([[1, 0, 0], [0, math.cos(pitch), -math.sin(pitch)], [0, math.sin(pitch), math.cos(pitch)]])
    y = np.array([[math.cos(yaw), 0, math.sin(yaw)], [0, 1, 0], [-math.sin(yaw), 0, math.cos(yaw)]])
    z = np.array([[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]])
    rotation: FloatArray = z @ x @ y
    return rotation


def _thing(each: ObjectSection, genome: Genome) -> Thing:
    grown = even_points(genome, each.points)
    colours = _painted(grown, each.colours)
    turn = np.eye(3)
    if each.pose == "facing":
        turn = _FROM_ABOVE_TO_UPRIGHT @ tilted(choose_view(grown), -TILT)
    posed = grown @ turn.T
    low, high = posed.min(axis=0), posed.max(axis=0)
    extent = float((high - low).max()) or 1.0
    points = (posed - 0.5 * (low + high)) / extent
    places = np.tile(np.eye(4), (len(each.places), 1, 1))
    places[:, :3, :3] = each.size * rotation_of(each.rotation)
    places[:, :3, 3] = each.places
    radius = each.thickness * _spacing(points)
    return Thing(each.name, genome, points, turn, radius, colours, each.colours.metal, each.glow, places)


def _moved(thing: Thing, places: FloatArray) -> Thing:
    return Thing(**{**thing.__dict__, "places": places})


def _painted(points: FloatArray, colours: Colouring) -> FloatArray:
    if colours.metal is not None:
        return np.tile(np.array(TINTS[colours.metal]), (len(points), 1))
    if colours.plain is not None:
        return np.tile(np.array(colours.plain), (len(points), 1))
    if colours.first is not None and colours.second is not None:
        return dual_tone(points, colours.first, colours.second)
    return legible(linear_gradient(points))


def _spacing(points: FloatArray) -> float:
    """The radius at which most points touch their neighbour."""
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(points).query(points, 2)
    return max(_TOUCHING * float(np.median(distances[:, 1])), _LEAST_RADIUS / math.sqrt(len(points)) / 2.0)
