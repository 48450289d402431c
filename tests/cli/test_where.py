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
        ("fitnes > 0.5", "did you mean 'fitness'"),
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
        ("\x00", "not an expression"),
    ],
)
def test_anything_else_is_refused_in_one_line(text: str, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        filter_expression(text, TABLE.schema)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)


@given(st.text(max_size=40))
def test_no_text_breaks_the_parser(text: str) -> None:
    try:
        filter_expression(text, TABLE.schema)
    except InputError as error:
        message = str(error)
    else:
        message = ""
    assert "\n" not in message
