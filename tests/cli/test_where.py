"""Filters of `farm list`: they select what Python would, and run nothing."""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fractal_farm.cli.where import filter_expression
from fractal_farm.errors import InputError

ROWS: list[dict[str, Any]] = [
    {"name": "a", "fitness": 0.9, "n_maps": 2, "gap": None},
    {"name": "b", "fitness": 0.7, "n_maps": 3, "gap": 0.25},
    {"name": "c", "fitness": 0.5, "n_maps": 3, "gap": 0.5},
]
TABLE = pa.Table.from_pylist(ROWS)
LISTS = pa.table(
    {
        "name": ["a", "b", "c"],
        "n_maps": pa.array([2, 3, 100], pa.int8()),
        "operator": ["mutation", "crossover_mutation", "random"],
        "parents": [["cb8f00", "11aa00"], ["00cb8f"], []],
        "genes": [[0.5, 1.5], [0.25], [2.0, 3.0, 4.0]],
        "origin": pa.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], pa.list_(pa.float32(), 3)),
        "born": pa.array([0, 10**15, 2 * 10**15], pa.timestamp("us")),  # 1970, 2001, 2033
    }
)


def selected(text: str) -> list[str]:
    names: list[str] = TABLE.filter(filter_expression(text, TABLE.schema)).column("name").to_pylist()
    return names


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("fitness > 0.6", ["a", "b"]),
        ("fitness > 0.6 and n_maps == 3", ["b"]),
        ("fitness >= 0.9 or name == 'c'", ["a", "c"]),
        ("not fitness > 0.6", ["c"]),
        ("0.6 < fitness < 0.8", ["b"]),
        ("n_maps in (2, 4)", ["a"]),
        ("n_maps not in (2, 4)", ["b", "c"]),
        ("gap is None", ["a"]),
        ("gap is not None and gap * 30 <= 7.5", ["b"]),
        ("-fitness < -0.8", ["a"]),
        ("1 - fitness > 0.4", ["c"]),
        ("  name != 'a'  ", ["b", "c"]),
        ("(fitness + n_maps) / 2 > 1.8", ["b"]),
    ],
)
def test_an_expression_selects_what_it_says(text: str, names: list[str]) -> None:
    assert selected(text) == names


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("'cb8f' in parents", ["a"]),
        ("'cb8f' not in parents", ["b", "c"]),
        ("'.b8f' in parents", []),
        ("len(parents) == 0 or len(genes) == 1", ["b", "c"]),
        ("genes[1] > 1", ["a", "c"]),
        ("origin[2] - origin[0] == 2 and origin[0] < 5", ["a", "b"]),
        ("'mutation' in operator", ["a", "b"]),
        ("operator == 'mutation'", ["a"]),
        ("born > '2001' and born < '2030-01-01'", ["b"]),
        ("n_maps / 2 == 1.5", ["b"]),
        ("n_maps * 100 > 1000", ["c"]),
        ("n_maps < 99999999999999999999999", ["a", "b", "c"]),
        ("genes[999] is None", ["a", "b", "c"]),
    ],
)
def test_lists_texts_times_and_small_integers_can_be_asked_about(text: str, names: list[str]) -> None:
    assert LISTS.filter(filter_expression(text, LISTS.schema)).column("name").to_pylist() == names


@given(
    st.sampled_from(["<", "<=", ">", ">=", "==", "!="]),
    st.sampled_from(["and", "or"]),
    st.sampled_from(["", "not "]),
    st.floats(0, 1),
    st.integers(2, 3),
)
def test_expressions_mean_what_python_means(
    comparison: str, joint: str, negation: str, threshold: float, n_maps: int
) -> None:
    text = f"{negation}fitness {comparison} {threshold!r} {joint} n_maps == {n_maps}"
    assert selected(text) == [row["name"] for row in ROWS if eval(text, {}, row)]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("fitnes > 0.5", "did you mean 'fitness'? the columns are name, fitness, n_maps, gap"),
        ("beauty > 0.5", "unknown column beauty; the columns are name, fitness"),
        ("len(fitness) > 1", "not understood"),
        ("fitness[0] > 1", "not understood"),
        ("'a' in fitness", "not understood"),
        ("fitness = 0.5", "write == for equality"),
        ("fitness >", "not an expression"),
        ("__import__('os').system('true') == 0", "not understood"),
        ("fitness.real > 1", "not understood"),
        ("fitness > [1]", "not understood"),
        ("gap is 3", "not understood"),
        ("name in 'abc'", "not understood"),
        ("fitness ** 2 > 1", "not understood"),
        ("fitness > 1j", "not understood"),
        ("fitness > -'a'", "not understood"),
        ("lambda: 1", "not understood"),
        ("", "not an expression"),
        ("fitness > 1 or " * 100 + "gap > 1", "at most 1000"),
        ("(" * 900, "not an expression"),
        ("fitness < 1" + "0" * 400, "not an expression"),
        ("n_maps in ('a', 3)", "compare numbers with numbers"),
        ("\x00", "not an expression"),
    ],
)
def test_anything_else_is_refused_in_one_line(text: str, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        filter_expression(text, TABLE.schema)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("place", [1000, 9_999_999_999, 10**30])
def test_elements_beyond_any_list_are_refused(place: int) -> None:
    with pytest.raises(InputError, match="not understood"):
        filter_expression(f"genes[{place}] > 1", LISTS.schema)


@given(st.text(max_size=40))
def test_no_text_breaks_the_parser(text: str) -> None:
    try:
        filter_expression(text, TABLE.schema)
    except InputError as error:
        message = str(error)
    else:
        message = ""
    assert "\n" not in message
