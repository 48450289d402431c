"""What the readers of mesh formats hand on, and how they refuse.

Readers get bytes that anybody may have written. They allocate nothing that the file does not pay for with its own
bytes, and raise `MalformedError` with a reason of a few words, or any other exception where a library finds the fault.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

MAX_FACES = 20_000_000
MAX_VERTICES = 60_000_000
MAX_FACTS_BYTES = 1 << 20
MAX_FACTS_DEPTH = 16

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


class MalformedError(ValueError):
    """Content that is not what its format says; the message is a reason of a few words."""


@dataclass(frozen=True)
class Parsed:
    """A mesh as its file has it.

    Attributes:
        vertices: (n, 3) float64, in the file's own unit and axes.
        faces: (m, 3) int64 into vertices; not checked yet.
        unit: the file's unit of length.
        unit_mm: one of them in mm.
        up: the axis that points up, "y" or "z".
        facts: what the file says about the solid.
        shared: whether faces share vertices; False where each face has its own three.
    """

    vertices: FloatArray
    faces: IntArray
    unit: str = "mm"
    unit_mm: float = 1.0
    up: str = "z"
    facts: dict[str, Any] = field(default_factory=dict)
    shared: bool = True


def parsed_json(text: str | bytes, what: str) -> dict[str, Any]:
    """A JSON object that stands in a file.

    Raises:
        MalformedError: not JSON, too deep, or another value than an object.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        raise MalformedError(f"its {what} cannot be read") from None
    if not isinstance(value, dict):
        raise MalformedError(f"its {what} is not an object")
    return value


def check_count(faces: int) -> None:
    """Refuse more faces than are read."""
    if faces > MAX_FACES:
        raise MalformedError(f"it has {faces} faces, more than {MAX_FACES}")


def check_facts(facts: dict[str, Any]) -> None:
    """Refuse facts that could not be handed on: nested deeply, longer than 1 MiB, or not text that can be written."""
    level: list[Any] = [facts]
    for _ in range(MAX_FACTS_DEPTH):
        level = [item for value in level for item in _items(value)]
        if not level:
            break
    try:
        length = 0 if level else len(json.dumps(facts, ensure_ascii=False).encode())
    except UnicodeEncodeError:
        raise MalformedError("its metadata are no text") from None
    if level or length > MAX_FACTS_BYTES:
        raise MalformedError("its metadata are nested too deeply or longer than 1 MiB")


def _items(value: Any) -> list[Any]:
    return list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else []
