"""Filters such as `fitness > 0.9 and n_maps == 3`: Python's expressions, of which a few kinds are understood.

The expression is parsed, never run: names are columns, and only comparisons, `and`, `or`, `not`, arithmetic,
`in`, `is None` and constants pass. What comes out is a pyarrow expression.
"""

from __future__ import annotations

import ast
import contextlib
import difflib
import operator
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.errors import InputError

LENGTH_LIMIT = 1000

_COMPARISONS: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


def filter_expression(text: str, columns: Sequence[str]) -> Any:
    """The pyarrow expression of a filter.

    Args:
        text: such as `fitness > 0.9 and n_maps == 3` or `0.1 < gap < 0.2 or island in (1, 2)`.
        columns: names that may occur.

    Raises:
        InputError: not an expression, an unknown column, or something that is not understood.
    """
    if len(text) > LENGTH_LIMIT:
        raise InputError(f"--where: {len(text)} characters; at most {LENGTH_LIMIT}")
    try:
        tree = ast.parse(text.strip(), mode="eval")
        return _logical(tree.body, text, columns)
    except (SyntaxError, RecursionError, MemoryError, ValueError):
        hint = "; write == for equality" if "=" in text and "==" not in text else ""
        raise InputError(f"--where {text!r}: not an expression such as 'fitness > 0.9 and n_maps == 3'{hint}") from None


def _logical(node: ast.expr, text: str, columns: Sequence[str]) -> Any:
    if isinstance(node, ast.BoolOp):
        combine = operator.and_ if isinstance(node.op, ast.And) else operator.or_
        result = _logical(node.values[0], text, columns)
        for value in node.values[1:]:
            result = combine(result, _logical(value, text, columns))
        return result
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return ~_logical(node.operand, text, columns)
    if isinstance(node, ast.Compare):
        sides = [node.left, *node.comparators]
        result = None
        for left, comparison, right in zip(sides, node.ops, sides[1:], strict=False):
            part = _comparison(left, comparison, right, text, columns)
            result = part if result is None else result & part
        return result
    if isinstance(node, ast.Name):
        return _value(node, text, columns)
    raise _not_understood(node, text)


def _comparison(left: ast.expr, comparison: ast.cmpop, right: ast.expr, text: str, columns: Sequence[str]) -> Any:
    if isinstance(comparison, (ast.Is, ast.IsNot)):
        if not (isinstance(right, ast.Constant) and right.value is None):
            raise _not_understood(right, text)
        empty = _value(left, text, columns).is_null()
        return empty if isinstance(comparison, ast.Is) else ~empty
    if isinstance(comparison, (ast.In, ast.NotIn)):
        if not isinstance(right, (ast.Tuple, ast.List, ast.Set)):
            raise _not_understood(right, text)
        values = [_constant(item, text) for item in right.elts]
        inside = _value(left, text, columns).isin(values)
        return inside if isinstance(comparison, ast.In) else ~inside
    return _COMPARISONS[type(comparison)](_value(left, text, columns), _value(right, text, columns))


def _value(node: ast.expr, text: str, columns: Sequence[str]) -> Any:
    if isinstance(node, ast.Name):
        if node.id not in columns:
            close = difflib.get_close_matches(node.id, columns, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"the columns are {', '.join(columns)}"
            raise InputError(f"--where: unknown column {node.id}; {hint}")
        return pc.field(node.id)
    if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        return _ARITHMETIC[type(node.op)](_value(node.left, text, columns), _value(node.right, text, columns))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
        return pc.negate(_value(node.operand, text, columns))
    return pc.scalar(_constant(node, text))


def _constant(node: ast.expr, text: str) -> float | str | bool:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = _constant(node.operand, text)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return -value
    elif isinstance(node, ast.Constant) and isinstance(node.value, (int, float, str)):
        return node.value
    raise _not_understood(node, text)


def _not_understood(node: ast.AST, text: str) -> InputError:
    what = ast.get_source_segment(text.strip(), node) or text
    return InputError(
        f"--where: {what!r} is not understood; use columns, numbers, texts, and, or, not, in, == < > + - * /"
    )


def selection_of(text: str | None) -> tuple[Any, tuple[str, ...]]:
    """The expression of a filter over a catalogue's columns, and the columns that it refers to; None if it is None.

    Raises:
        InputError: see `filter_expression`.
    """
    if text is None:
        return None, ()
    expression = filter_expression(text, DESIGN_SCHEMA.names)
    names = (node.id for node in ast.walk(ast.parse(text.strip(), mode="eval")) if isinstance(node, ast.Name))
    return expression, tuple(name for name in dict.fromkeys(names) if name in DESIGN_SCHEMA.names)


@contextlib.contextmanager
def explained_selection(text: str | None) -> Iterator[None]:
    """What Arrow says of an expression that does not fit its columns, as an `InputError`."""
    try:
        yield
    except (pa.ArrowException, TypeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"--where {text!r}: {reason}; compare numbers with numbers") from None
