"""Scenes as somebody writes them: `configs/christmas_tree.yaml` is one, after the paper's figure 7.

A scene has objects, each a design with a size, a place, a rotation and a colouring; copies of an object may hang on
another. z is up, x to the right, y away from the viewer; lengths are of one unit, angles are in degrees.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

from PIL import ImageColor
from pydantic import Field, PlainValidator, Strict, ValidationError, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from fractal_farm.errors import InputError
from fractal_farm.genome_file import PhenotypeSection
from fractal_farm.picture.colours import Colour
from fractal_farm.untrusted import Section, explain, read_yaml

Number = Annotated[float, Field(ge=-1e6, le=1e6, strict=True)]
Triple = Annotated[tuple[Number, Number, Number], Strict(False)]
_COLOUR_WORDS = "the name of a colour in CSS, '#rrggbb', or [red, green, blue] from 0 to 1"
_HEX = re.compile(r"#[0-9a-fA-F]{6}")


def _colour(value: Any) -> Colour:
    if isinstance(value, str) and (value.isalpha() or _HEX.fullmatch(value)):
        try:
            red, green, blue, *_ = ImageColor.getrgb(value)
        except ValueError:
            raise PydanticCustomError("no_colour", "no colour") from None
        return red / 255, green / 255, blue / 255
    if (
        isinstance(value, (list, tuple))
        and len(value) == 3
        and all(type(part) in (int, float) and 0 <= part <= 1 for part in value)
    ):
        return float(value[0]), float(value[1]), float(value[2])
    raise PydanticCustomError("no_colour", "no colour")


ColourField = Annotated[Colour, PlainValidator(_colour), WithJsonSchema({"wording": _COLOUR_WORDS})]


class Colouring(Section):
    """How the points of an object are coloured: one of three ways; without any, linear gradient."""

    plain: ColourField | None = Field(None, description="all points alike")
    first: ColourField | None = Field(None, description="C1 of dual tone, C = C1 - C2 (x, y, z) / range")
    second: ColourField | None = Field(None, description="C2 of dual tone")
    metal: Literal["gold", "silver", "copper", "steel"] | None = Field(None, description="a metal, dull in pictures")

    @model_validator(mode="after")
    def _one_way(self) -> Colouring:
        if (self.first is None) != (self.second is None):
            raise ValueError("dual tone needs both first and second; without them it is linear gradient")
        if (self.plain is not None) + (self.first is not None) + (self.metal is not None) > 1:
            raise ValueError("give one of plain, metal, or first and second; without them it is linear gradient")
        return self


class Hanging(Section):
    """Copies that hang on the outer points of another object, spread evenly around it."""

    holder: str = Field(description="name of an object that comes before")
    copies: int = Field(ge=1, le=1000, description="how many")
    lowest: float = Field(0.05, ge=0, le=1, description="share of the height from which on they hang")
    highest: float = Field(0.9, ge=0, le=1, description="and up to which")
    taper: float = Field(
        0.3, ge=0, le=0.9, description="by how much a copy at the top would be smaller than at the foot"
    )


class ObjectSection(Section):
    """A design in a scene."""

    name: str = Field(min_length=1, max_length=100)
    genome: str | None = Field(None, description="name of one of the scene's genomes")
    design: str | None = Field(None, description="id or code of a design of the catalogue")
    like: str | None = Field(None, description="description by which it is found in the catalogue, such as star")
    rank: int = Field(1, ge=1, le=1000, description="which of those found, 1 for the best")
    points: int = Field(5_000, ge=100, le=500_000)
    size: float = Field(1.0, gt=0, le=1e6, description="longest side of its box")
    pose: Literal["as grown", "facing"] = Field("facing", description="facing: turned so that it looks best from afore")
    rotation: Triple = Field((0.0, 0.0, 0.0), description="pitch, yaw, roll")
    places: list[Triple] = Field(default=[(0.0, 0.0, 0.0)], min_length=1, max_length=1000, description="of box centres")
    hang: Hanging | None = None
    colours: Colouring = Colouring()
    thickness: float = Field(1.0, gt=0, le=20, description="of points, in that of touching ones")
    glow: float = Field(0.0, ge=0, le=1, description="how far it shines by itself")

    @model_validator(mode="after")
    def _some_design(self) -> ObjectSection:
        if (self.design is None) == (self.genome is None and self.like is None):
            raise ValueError(
                f"object {self.name}: give genome, design or like, and of these only genome and like together"
            )
        return self


class Camera(Section):
    """Where a scene is seen from."""

    turn: float = Field(0.0, ge=-360, le=360, description="about the upright axis")
    tilt: float = Field(6.0, ge=-89, le=89, description="from above")
    distance: float = Field(3.5, ge=1.5, le=1000, description="in extents of the scene")


class SceneFile(Section):
    """A scene."""

    title: str = Field("", max_length=200)
    ground: ColourField | None = Field(None, description="colour behind the scene; night if none")
    camera: Camera = Camera()
    phenotype: PhenotypeSection | None = None
    genomes: Annotated[dict[str, Any], Field(max_length=1000)] = Field(
        default={}, json_schema_extra={"keys": "names", "wording": "a mapping of names to genomes"}
    )
    objects: list[ObjectSection] = Field(min_length=1, max_length=1000)


def load_scene(path: Path | str) -> SceneFile:
    """The scene in a file.

    Raises:
        InputError: one line that names the file, the field, its value and what is allowed.
    """
    path = Path(path)
    try:
        scene = SceneFile.model_validate(read_yaml(path))
    except ValidationError as error:
        raise InputError(explain(error, SceneFile, lambda _key: str(path))) from None
    names: set[str] = set()
    for each in scene.objects:
        if each.name in names:
            raise InputError(f"{path}: two objects are called {each.name}; give each its own name")
        if each.genome is not None and each.genome not in scene.genomes:
            known = ", ".join(scene.genomes) or "none"
            raise InputError(f"{path}: object {each.name}: no genome {each.genome}; the scene's genomes are: {known}")
        if each.hang is not None and each.hang.holder not in names:
            raise InputError(f"{path}: object {each.name} hangs on {each.hang.holder}, which is no object before it")
        if each.hang is not None and each.hang.highest <= each.hang.lowest:
            raise InputError(f"{path}: object {each.name}: hang.highest must be above hang.lowest")
        names.add(each.name)
    return scene
