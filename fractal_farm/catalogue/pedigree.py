"""A family tree of one design, in the order in which it is drawn: its ancestors, or its descendants.

Descent is no tree: a design may be reached along many lines. It is unfolded where the line to it is shortest, and
only named elsewhere, so that what is drawn grows with the designs and not with the lines between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from fractal_farm.catalogue.lineage import Lineage, Links, is_kept

Direction = Literal["ancestors", "descendants"]

_SEED = "seed"


@dataclass(frozen=True)
class Relative:
    """One line of a drawn tree.

    Attributes:
        row: of the lineage; -1 for a parent that the catalogue does not hold.
        level: steps from the design in question, along this line.
        again: it is unfolded elsewhere.
        folded: relatives one step on that are not drawn, because the tree ends here.
        migrated_from: island of the parent's birth where that is not the child's; None otherwise, and for seeds, which
            all islands begin with.
        design_id: 32 hex digits.
    """

    row: int
    level: int
    again: bool
    folded: int
    migrated_from: int | None
    design_id: str


@dataclass(frozen=True)
class Pedigree:
    """The relatives of a design.

    Attributes:
        lines: in drawing order, the design itself first.
        steps: row -> the fewest steps to it, of all relatives within the depth.
        facts: row -> column -> value.
    """

    lines: list[Relative]
    steps: dict[int, int]
    facts: dict[int, dict[str, Any]]

    def edges(self) -> Iterator[tuple[str, str, bool]]:
        """(parent, child, whether born on different islands) among the relatives and their missing parents."""
        of_id = {facts["design_id"]: facts for facts in self.facts.values()}
        drawn = {line.design_id for line in self.lines}
        for child in self.facts.values():
            for parent in dict.fromkeys(child["parents"] or ()):
                if parent in drawn:
                    yield parent, child["design_id"], _origin(of_id.get(parent, child), child) is not None


def pedigree(lineage: Lineage, row: int, direction: Direction, depth: int | None = None) -> Pedigree:
    """The family of a row.

    Args:
        lineage: of the catalogue.
        row: the design in question.
        direction: whether parents or children are followed.
        depth: steps to follow; all if None.
    """
    links = lineage.parents if direction == "ancestors" else lineage.children
    steps = {found: count for count, rows in lineage.walk(links, row, depth) for found in rows.tolist()}
    facts = dict(zip(steps, lineage.facts(list(steps)), strict=True))
    return Pedigree(list(_lines(links, row, direction, depth, steps, facts)), steps, facts)


def _lines(
    links: Links, row: int, direction: Direction, depth: int | None, steps: dict[int, int], facts: dict[int, Any]
) -> Iterator[Relative]:
    """Depth first, without recursion; relatives of a line come in the order of its row."""
    unfolded: set[int] = set()
    waiting: list[tuple[int, int, int | None, str]] = [(row, 0, None, facts[row]["design_id"])]
    while waiting:
        current, level, origin, identity = waiting.pop()
        if current < 0:
            yield Relative(-1, level, False, 0, None, identity)
            continue
        again = current in unfolded or level > steps[current]
        ends = level == depth
        relatives = [] if again else _relatives(links, current, direction, facts)
        yield Relative(current, level, again, len(relatives) if ends else 0, origin, identity)
        if again or ends:
            continue
        unfolded.add(current)
        for relative, name in reversed(relatives):
            waiting.append((relative, level + 1, _migration(facts, current, relative, direction), name))


def _relatives(links: Links, row: int, direction: Direction, facts: dict[int, Any]) -> list[tuple[int, str]]:
    """Rows one step on, each once, with the ids of those that are known."""
    rows = links.of(row)
    if direction == "ancestors":
        return list(dict.fromkeys(zip(rows, facts[row]["parents"] or (), strict=True)))
    return [(relative, facts[relative]["design_id"] if relative in facts else "") for relative in dict.fromkeys(rows)]


def _migration(facts: dict[int, Any], current: int, relative: int, direction: Direction) -> int | None:
    if relative < 0:
        return None
    parent, child = (relative, current) if direction == "ancestors" else (current, relative)
    return _origin(facts[parent], facts[child])


def _origin(parent: dict[str, Any], child: dict[str, Any]) -> int | None:
    """The island that a parent came from; None if it was at home, as the seeds are on all islands, or made by hand."""
    home: int | None = parent["island"]
    stayed = child["island"] in (home, None) or parent["operator"] == _SEED
    return None if stayed else home


def summary(found: Pedigree) -> dict[str, int]:
    """How many relatives, how far, how many without parents, kept, and born of a parent from another island."""
    others = [facts for row, facts in found.facts.items() if found.steps[row] > 0]
    links = list(found.edges())
    return {
        "relatives": len(others),
        "steps": max(found.steps.values()),
        "founders": sum(not facts["parents"] for facts in found.facts.values()),
        "kept": sum(map(is_kept, others)),
        "links": len(links),
        "between_islands": sum(migrated for _, _, migrated in links),
    }
