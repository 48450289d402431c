"""What speaks against a mesh, and what would help: measures against a material's limits (DESIGN section 6, point 5)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from fractal_farm.solid.materials import Material, materials
from fractal_farm.solid.thickest import Thickest
from fractal_farm.solid.thickness import ThinPlace
from fractal_farm.solid.topology import EdgeFault, Piece

Triple = tuple[float, float, float]

WALL_TOLERANCE = 0.95  # a wall of 0.8 mm passes from 0.76 mm: what rays and simplified facets cost
_MOST_PLACES = 8
_LARGEST_SCALE = 10.0
_NOTHING = 1e-9
_MOST_SIZES = 3
_SURELY_ANOTHER_UNIT = 1.0


@dataclass(frozen=True)
class Finding:
    """Something that speaks against a mesh.

    Attributes:
        severity: "failure", or "warning", which does not decide the verdict.
        what: is wrong, a few words.
        where: places in mm, the worst first, at most eight; empty where it is the whole mesh.
        how_much: measured and allowed.
        remedy: what would help.
    """

    severity: Literal["failure", "warning"]
    what: str
    where: tuple[Triple, ...]
    how_much: str
    remedy: str

    @property
    def line(self) -> str:
        """All of it in one line."""
        places = f" at {', '.join(place_text(place) for place in self.where)} mm" if self.where else ""
        return f"{self.severity}: {self.what}{places}: {self.how_much}; {self.remedy}"


@dataclass(frozen=True)
class Measures:
    """What is judged; see `Certificate` for the units. `made_with` is the metadata of the mesh."""

    inverted: bool
    manifold: str
    faults: tuple[EdgeFault, ...]
    bodies: tuple[Piece, ...]
    cavities: tuple[Piece, ...]
    volume_mm3: float | None
    box_mm: Triple
    wall_mm: float | None
    wall_limit_mm: float
    thin_places: tuple[ThinPlace, ...]
    thickest: Thickest | None
    made_with: Mapping[str, Any]


def judge(measures: Measures, material: Material) -> tuple[Finding, ...]:
    """All findings, failures first, otherwise in the order in which they should be mended."""
    found = [finding for rule in _RULES for finding in rule(measures, material)]
    return tuple(sorted(found, key=lambda finding: finding.severity != "failure"))


def place_text(place: Triple) -> str:
    """A place as a person reads it: (1.2, -3.4, 5.6)."""
    return f"({', '.join(f'{round(value, 1) + 0.0:.1f}' for value in place)})"


def box_text(box: Triple) -> str:
    """Sides of a box as a person reads them: 1.2 x 3.4 x 5.6."""
    return " x ".join(f"{side:.3g}" for side in box)


_FAULTS = {
    "open": ("is not closed", "edges belong to one face only", "close the holes"),
    "crowded": ("is not a manifold", "edges belong to more than two faces", "unite the parts that touch there"),
    "twisted": ("has faces turned the wrong way", "edges join faces that disagree", "make the normals consistent"),
}


def _surface(measures: Measures, _: Material) -> Iterator[Finding]:
    for fault in measures.faults:
        what, how_much, remedy = _FAULTS[fault.kind]
        spread = f"within {box_text(fault.box_mm)} mm" if any(fault.box_mm) else "in one place"
        yield Finding("failure", what, (fault.place_mm,), f"{fault.edges} {how_much}, {spread}", remedy)
    if measures.manifold != "NoError" and not measures.faults:
        yield Finding("failure", "is not a manifold", (), f"manifold3d says {measures.manifold}", "export it again")


def _orientation(measures: Measures, _: Material) -> Iterator[Finding]:
    if measures.inverted:
        volume = measures.volume_mm3 or 0.0
        yield Finding(
            "failure", "is inside out", (), f"its volume is -{volume:.4g} mm3, its faces look inwards", "flip all faces"
        )
    turned = [body for body in measures.bodies if body.kind == "inside out"]
    if turned:
        yield Finding(
            "failure",
            f"has {_counted(len(turned), 'body', 'bodies')} inside out",
            _places(turned),
            f"volume -{turned[0].volume_mm3:.4g} mm3 in {box_text(turned[0].box_mm)} mm",
            "flip the faces of these",
        )
    if measures.volume_mm3 is not None and abs(measures.volume_mm3) <= _NOTHING * max(measures.box_mm) ** 3:
        yield Finding("failure", "encloses nothing", (), "its volume is 0", "give it a thickness")


def _one_body(measures: Measures, _: Material) -> Iterator[Finding]:
    bodies = measures.bodies
    if len(bodies) < 2:
        return
    others = bodies[1:]
    total = sum(body.volume_mm3 for body in bodies)
    share = f", {bodies[0].volume_mm3 / total:.1%} of the volume in the largest" if total > 0.0 else ""
    nested = sum(body.kind == "inside a body" for body in others)
    within = f"; {nested} within another" if nested else ""
    sizes = ", ".join(f"{box_text(body.box_mm)} mm" for body in others[:_MOST_PLACES])
    more = ", ..." if len(others) > _MOST_PLACES else ""
    gap = measures.made_with.get("gap_mm")
    join = f"wall >= {_up(float(gap), 2)} mm joins them" if isinstance(gap, (int, float)) else "join them"
    yield Finding(
        "failure",
        f"falls into {len(bodies)} bodies",
        _places(others),
        f"besides the largest: {sizes}{more}{share}{within}",
        f"{join}, or keep the largest alone",
    )


def _wall(measures: Measures, material: Material) -> Iterator[Finding]:
    wall, limit, thin = measures.wall_mm, measures.wall_limit_mm, measures.thin_places
    if wall is None:
        yield Finding("failure", "has no thickness", (), "no ray through it leaves it again", "close the surface")
        return
    where = tuple(place.place_mm for place in thin[:_MOST_PLACES])
    sizes = ", ".join(f"{place.thickness_mm:.2f} mm over {box_text(place.box_mm)} mm" for place in thin[:_MOST_SIZES])
    there = f": {sizes}{', ...' if len(thin) > _MOST_SIZES else ''}" if sizes else ""
    if wall < limit:
        yield Finding(
            "failure",
            "is too thin",
            where,
            f"its wall is {wall:.2f} mm at the 1 % quantile, {material.name} needs {limit:.2f} mm{there}",
            _thicker(measures, wall),
        )
    elif thin:
        share = sum(place.share for place in thin)
        yield Finding(
            "warning",
            "is thin in places",
            where,
            f"{share:.2%} of the surface has less than {limit:.2f} mm{there}",
            "look at them: a neck or a web breaks or does not fill; smooth or thicken there",
        )


def _thicker(measures: Measures, wall: float) -> str:
    limit, longest = measures.wall_limit_mm, max(measures.box_mm)
    used = measures.made_with.get("wall_used_mm")
    if isinstance(used, (int, float)):
        ways = [f"wall >= {_up(float(used) + limit - wall, 2)} mm"]
    else:
        ways = [f"thicken by {_up(limit - wall, 2)} mm"]
    if limit <= _LARGEST_SCALE * wall:
        ways.append(f"scale to a longest side of >= {_up(longest * limit / wall, 1)} mm")
    suited = [each.name for each in materials().values() if WALL_TOLERANCE * each.wall <= wall]
    if suited:
        ways.append(f"choose {' or '.join(suited)}")
    return ", or ".join(ways)


def _box(measures: Measures, material: Material) -> Iterator[Finding]:
    box = measures.box_mm
    least, total, longest = min(box), sum(box), max(box)
    hint = "; is its unit mm?" if longest < _SURELY_ANOTHER_UNIT else ""
    if least < material.smallest_side:
        by = f"scale to >= {_up(longest * material.smallest_side / least, 1)} mm" if least > 0.0 else "thicken it"
        yield Finding(
            "failure",
            "is too flat",
            (),
            f"its box is {box_text(box)} mm, {material.name} asks for a side of {material.smallest_side:g} mm",
            by + hint,
        )
    if total < material.sum_of_sides:
        yield Finding(
            "failure",
            "is too small",
            (),
            f"its sides add up to {total:.3g} mm, {material.name} asks for {material.sum_of_sides:g} mm",
            f"scale to a longest side of >= {_up(longest * material.sum_of_sides / total, 1)} mm{hint}",
        )


def _massive(measures: Measures, material: Material) -> Iterator[Finding]:
    thickest = measures.thickest
    if thickest is not None and thickest.diameter_mm > material.solid:
        smaller = max(measures.box_mm) * material.solid / thickest.diameter_mm
        yield Finding(
            "warning",
            "is massive",
            (thickest.place_mm,),
            f"a ball of {thickest.diameter_mm:.2f} mm fits in, {material.name} should have {material.solid:g} at most",
            f"shell it, or scale to a longest side of <= {math.floor(10.0 * smaller) / 10.0:g} mm",
        )


def _hollows(measures: Measures, _: Material) -> Iterator[Finding]:
    cavities = measures.cavities
    if cavities:
        volume = sum(cavity.volume_mm3 for cavity in cavities)
        yield Finding(
            "warning",
            f"has {_counted(len(cavities), 'closed cavity', 'closed cavities')}",
            _places(cavities),
            f"{volume:.4g} mm3 that nothing can leave; the largest is {box_text(cavities[0].box_mm)} mm",
            "fill it, or open it with a drain hole",
        )


_Rule = Callable[[Measures, Material], Iterator[Finding]]
_RULES: tuple[_Rule, ...] = (_surface, _orientation, _one_body, _wall, _box, _massive, _hollows)


def _places(pieces: tuple[Piece, ...] | list[Piece]) -> tuple[Triple, ...]:
    return tuple(piece.place_mm for piece in pieces[:_MOST_PLACES])


def _counted(number: int, one: str, many: str) -> str:
    return f"1 {one}" if number == 1 else f"{number} {many}"


def _up(value: float, digits: int) -> str:
    """A length rounded up: what is printed passes."""
    return f"{math.ceil(value * 10**digits - 1e-9) / 10**digits:g}"
