"""The numerics can be read: short functions, and numbers with names."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "fractal_farm"
SOURCES = sorted([*(PACKAGE / "ifs").glob("*.py"), *(PACKAGE / "fitness").glob("*.py")])
LONGEST = 60
# Indices of 3 x 4 maps, small counts, halves and powers of two up to the 16 of a shift speak for themselves.
PLAIN = {*range(13), 16, 0.5}


def functions(source):
    tree = ast.parse(source.read_text())
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: f"{source.parent.name}/{source.name}")
def test_no_function_is_longer_than_a_screen(source):
    lengths = {node.name: node.end_lineno - node.lineno + 1 for node in functions(source)}
    assert {name: length for name, length in lengths.items() if length > LONGEST} == {}


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: f"{source.parent.name}/{source.name}")
def test_every_number_in_a_function_is_plain_or_has_a_name(source):
    magic = [
        (node.name, leaf.lineno, leaf.value)
        for node in functions(source)
        for leaf in ast.walk(node)
        if isinstance(leaf, ast.Constant) and isinstance(leaf.value, (int, float)) and leaf.value not in PLAIN
    ]
    assert magic == []
