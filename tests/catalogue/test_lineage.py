"""Constructed families: what is counted, walked and drawn is what was put in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from fractal_farm.catalogue.fertility import most_fertile, operator_yields
from fractal_farm.catalogue.lineage import COLUMNS, Lineage
from fractal_farm.catalogue.pedigree import pedigree, summary
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.errors import InputError


def identity(name: str) -> str:
    """32 hex digits that begin with a name's bytes."""
    return name.encode().hex().ljust(32, "0")


def family(*members: tuple[str, str], **columns: dict[str, Any]) -> Lineage:
    """A lineage of (name, names of parents) pairs; `columns` maps a column to values by name."""
    rows = []
    for name, parents in members:
        row = {
            "design_id": identity(name),
            "kind": "design",
            "run_id": "r",
            "operator": "mutation" if len(parents.split()) == 1 else "crossover" if parents else "random",
            "island": 0,
            "epoch": 0,
            "generation": 0,
            "n_maps": 2,
            "fitness": 0.9,
            "gap": 0.01,
            "parents": [identity(parent) for parent in parents.split()],
        }
        rows.append(row | {column: values[name] for column, values in columns.items() if name in values})
    return Lineage(pa.Table.from_pylist(rows, pa.schema([DESIGN_SCHEMA.field(name) for name in COLUMNS])))


def names(lineage: Lineage, rows: Any) -> list[str]:
    return [bytes.fromhex(facts["design_id"]).rstrip(b"\0").decode() for facts in lineage.facts(rows)]


# d has the parents b and c, both children of a; e comes from d and from x, which is not recorded; f stands alone.
DIAMOND = (("e", "d x"), ("d", "b c"), ("b", "a"), ("c", "a"), ("a", ""), ("f", ""))


def test_walks_follow_the_shortest_lines_in_both_directions() -> None:
    lineage = family(*DIAMOND)
    place = {name: lineage.find(identity(name)) for name, _ in DIAMOND}
    up = [(steps, set(names(lineage, rows))) for steps, rows in lineage.walk(lineage.parents, place["e"])]
    assert up == [(0, {"e"}), (1, {"d"}), (2, {"b", "c"}), (3, {"a"})]
    down = [(steps, set(names(lineage, rows))) for steps, rows in lineage.walk(lineage.children, place["a"], 2)]
    assert down == [(0, {"a"}), (1, {"b", "c"}), (2, {"d"})]
    assert lineage.reached(lineage.children, place["a"]) == 4
    assert lineage.reached(lineage.parents, place["f"]) == 0


def test_the_nearest_common_ancestor_is_found_and_may_be_one_of_the_two() -> None:
    lineage = family(*DIAMOND)
    place = {name: lineage.find(identity(name)) for name, _ in DIAMOND}
    assert lineage.common_ancestor(place["b"], place["c"]) == (place["a"], 1, 1)
    assert lineage.common_ancestor(place["e"], place["b"]) == (place["b"], 2, 0)
    assert lineage.common_ancestor(place["d"], place["d"]) == (place["d"], 0, 0)
    assert lineage.common_ancestor(place["a"], place["f"]) is None


def test_a_drawn_family_names_each_line_and_unfolds_each_design_once() -> None:
    lineage = family(*DIAMOND, island={"a": 3, "b": 1}, kind={"c": "ancestor"})
    found = pedigree(lineage, lineage.find(identity("e")), "ancestors")
    drawn = [(line.level, bytes.fromhex(line.design_id)[:1].decode(), line.again) for line in found.lines]
    assert drawn == [
        (0, "e", False),
        (1, "d", False),
        (2, "b", False),
        (3, "a", False),
        (2, "c", False),
        (3, "a", True),
        (1, "x", False),
    ]
    assert [line.migrated_from for line in found.lines] == [None, None, 1, 3, None, 3, None]
    assert found.lines[-1].row == -1
    assert {(parent[:2], child[:2], moved) for parent, child, moved in found.edges()} == {
        ("64", "65", False),
        ("78", "65", False),
        ("62", "64", True),
        ("63", "64", False),
        ("61", "62", True),
        ("61", "63", True),
    }
    assert summary(found) == {
        "relatives": 4,
        "steps": 3,
        "founders": 1,
        "kept": 3,
        "links": 6,
        "between_islands": 3,
    }
    cut = pedigree(lineage, lineage.find(identity("e")), "ancestors", 1)
    assert [(line.level, line.folded) for line in cut.lines] == [(0, 0), (1, 2), (1, 0)]
    children = pedigree(lineage, lineage.find(identity("a")), "descendants")
    assert sorted(bytes.fromhex(line.design_id)[:1].decode() for line in children.lines) == list("abcdde")


def test_seeds_are_at_home_on_every_island() -> None:
    lineage = family(("b", "a"), ("a", ""), island={"b": 2}, operator={"a": "seed"})
    found = pedigree(lineage, lineage.find(identity("b")), "ancestors")
    assert [line.migrated_from for line in found.lines] == [None, None]
    assert [moved for _, _, moved in found.edges()] == [False]


def test_chains_of_ten_thousand_generations_and_their_webs_are_walked_without_recursion() -> None:
    length = 10_000
    chain = [(f"{k:05}", f"{k - 1:05}" if k else "") for k in range(length)]
    web = [(f"w{k:05}", f"w{k - 1:05} w{k - 2:05}" if k > 1 else "") for k in range(length)]  # 2^k lines
    lineage = family(*chain, *web)
    for name, count in ((f"{length - 1:05}", length), (f"w{length - 1:05}", length)):
        found = pedigree(lineage, lineage.find(identity(name)), "ancestors")
        assert len(found.steps) == count
        assert len(found.lines) <= 2 * count
    assert lineage.common_ancestor(lineage.find(identity("04000")), lineage.find(identity("09000"))) == (4000, 0, 5000)


def test_a_design_without_descent_and_an_unknown_one() -> None:
    lineage = family(*DIAMOND)
    assert len(pedigree(lineage, lineage.find(identity("f")), "descendants").lines) == 1
    with pytest.raises(InputError, match="no design ffff"):
        lineage.find("ffff")
    with pytest.raises(InputError, match="no design ffff"):
        family().find("ffff")


def test_operators_and_ancestors_are_counted_by_what_is_published() -> None:
    lineage = family(
        ("a", ""),
        ("b", "a a"),
        ("c", "a"),
        ("d", "b c"),
        ("e", "q"),
        kind={"c": "ancestor"},
        fitness={"a": 0.8, "b": 0.9, "c": 0.7, "d": 0.95},
        gap={"b": 0.5, "d": None},
        n_maps={"e": 3},
    )
    yields = {(entry.operator, entry.n_maps): entry for entry in operator_yields(lineage, gap=0.02)}
    assert set(yields) == {("random", 2), ("crossover", 2), ("mutation", 2), ("mutation", 3)}
    crossed = yields["crossover", 2]
    assert (crossed.published, crossed.ancestors) == (2, 0)
    assert crossed.mean_fitness == pytest.approx(0.925)
    assert crossed.gain == pytest.approx((0.9 - 0.8 + 0.95 - 0.9) / 2)
    assert (crossed.printable, crossed.fertile) == (0.0, 0.5)
    assert (yields["mutation", 2].published, yields["mutation", 2].ancestors) == (0, 1)
    assert np.isnan(yields["mutation", 3].gain)
    fertile = most_fertile(lineage, 5, gap=0.02)
    assert names(lineage, [entry.row for entry in fertile]) == ["a", "b", "c"]
    assert [(entry.children, entry.descendants) for entry in fertile] == [(1, 2), (1, 1), (1, 1)]
    assert [entry.mean_fitness for entry in fertile] == pytest.approx([0.9, 0.95, 0.95])
