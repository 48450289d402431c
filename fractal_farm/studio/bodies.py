"""What requests may say: each body has its model, and whatever does not fit is one line of what is wrong."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, ValidationError, model_validator

from fractal_farm.errors import InputError
from fractal_farm.solid.parameters import BAILS, BASES
from fractal_farm.untrusted import Section, explain

Identity = Annotated[str, Field(min_length=4, max_length=64, pattern=r"^[0-9A-Za-z -]+$")]
"""An id, its first digits, or a design code; which design it means is looked up."""

MOST_POINTS = 1_000_000
MOST_VIEWS = 100

Model = TypeVar("Model", bound=Section)


class ScoreBody(Section):
    """POST api/score."""

    genome: dict[str, Any]


class PointsBody(Section):
    """POST api/points."""

    genome: dict[str, Any]
    count: int = Field(100_000, ge=1, le=MOST_POINTS)
    view: Literal["density", "even"] = "density"


class KeepBody(Section):
    """POST api/keep."""

    genome: dict[str, Any]
    parent: Identity | None = None
    parents: Annotated[list[Identity], Field(max_length=8)] = Field(default_factory=list)


class JudgeBody(Section):
    """POST api/judge."""

    design_id: Identity
    favourite: bool | None = None
    rating: int | None = Field(None, ge=0, le=5)
    rejected: bool | None = None

    @model_validator(mode="after")
    def _says_something(self) -> JudgeBody:
        if self.favourite is None and self.rating is None and self.rejected is None:
            raise ValueError("nothing is said; give favourite, rating or rejected")
        return self


class BreedBody(Section):
    """POST api/breed."""

    design_ids: Annotated[list[Identity], Field(min_length=1, max_length=64)]
    epochs: int = Field(1, ge=1, le=50)
    seed: int | None = Field(None, ge=0, le=1 << 53)
    steer: bool = False


class ParametersBody(Section):
    """The parameters of POST api/solid; ranges that hang together are judged by `SolidParameters`."""

    size_mm: float | None = Field(None, ge=1, le=1000)
    wall_mm: float | None = Field(None, ge=0.01, le=100)
    resolution: int | None = Field(None, ge=32, le=600)
    thicken: bool | None = None
    bridges: bool | None = None
    closing_mm: float | None = Field(None, ge=0, le=100)
    shell_mm: float | None = Field(None, ge=0, le=100)
    shell_above_mm: float | None = Field(None, ge=0, le=1000)
    drain_mm: float | None = Field(None, ge=0, le=100)
    base: Literal[BASES] | None = None  # type: ignore[valid-type]
    bail: Literal[BAILS] | None = None  # type: ignore[valid-type]
    bail_hole_mm: float | None = Field(None, ge=0.5, le=20)
    engrave: bool | None = None
    sprue: bool | None = None


class SolidBody(Section):
    """POST api/solid."""

    design_id: Identity | None = None
    genome: dict[str, Any] | None = None
    preset: Annotated[str, Field(max_length=64)] | None = None
    material: Annotated[str, Field(max_length=64)] | None = None
    parameters: ParametersBody = ParametersBody()

    @model_validator(mode="after")
    def _of_one_design(self) -> SolidBody:
        if (self.design_id is None) == (self.genome is None):
            raise ValueError("give design_id or genome, one of them")
        return self


class ViewBody(Section):
    """POST api/views; a null query takes the view away."""

    name: Annotated[str, Field(min_length=1, max_length=80)]
    query: Annotated[str, Field(max_length=4000)] | None


def parsed(content: bytes, model: type[Model]) -> Model:
    """The body of a request as its model.

    Raises:
        InputError: not JSON, or not of that form; one line.
    """
    try:
        value = json.loads(content)
    except RecursionError:
        raise InputError("body: nested too deeply") from None
    except ValueError:
        raise InputError("body: not JSON; send an object in UTF-8") from None
    if not isinstance(value, dict):
        raise InputError("body: not an object; send a JSON object")
    try:
        return model.model_validate(value)
    except ValidationError as error:
        raise InputError(explain(error, model, lambda _key: "body")) from None
    except RecursionError:
        raise InputError("body: nested too deeply") from None
