"""Filters such as `fitness > 0.9 and n_maps == 3`: Python's expressions, of which a few kinds are understood.

The expression is parsed, never run: names are columns, and only comparisons, `and`, `or`, `not`, arithmetic,
`in`, `is None`, `len`, elements of lists and constants pass. What comes out is a pyarrow expression.
"""

from __future__ import annotations

import ast
import contextlib
import difflib
import operator
import re
from collections.abc import Callable, Iterator
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.errors import InputError

LENGTH_LIMIT = 1000
_LARGEST = 2**63 - 1

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


def filter_expression(text: str, schema: Any) -> Any:
    """The pyarrow expression of a filter.

    Args:
        text: such as `fitness > 0.9 and n_maps == 3`, `0.1 < gap < 0.2 or island in (1, 2)`, `"cb8f" in parents`
            (the first digits will do), `len(parents) == 2`, `probabilities[0] > 0.5`, `created_us > "2026-11-23"`.
        schema: of the table: the columns that may occur.

    Raises:
        InputError: not an expression, an unknown column, or something that is not understood.
    """
    if len(text) > LENGTH_LIMIT:
        raise InputError(f"--where: {len(text)} characters; at most {LENGTH_LIMIT}")
    try:
        tree = ast.parse(text.strip(), mode="eval")
        return _logical(tree.body, text, schema)
    except pa.ArrowException as error:
        raise _unfitting(text, error) from None
    except (SyntaxError, RecursionError, MemoryError, ValueError, OverflowError):
        hint = "; write == for equality" if "=" in text and "==" not in text else ""
        raise InputError(f"--where {text!r}: not an expression such as 'fitness > 0.9 and n_maps == 3'{hint}") from None


def _logical(node: ast.expr, text: str, schema: Any) -> Any:
    if isinstance(node, ast.BoolOp):
        combine = operator.and_ if isinstance(node.op, ast.And) else operator.or_
        result = _logical(node.values[0], text, schema)
        for value in node.values[1:]:
            result = combine(result, _logical(value, text, schema))
        return result
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return ~_logical(node.operand, text, schema)
    if isinstance(node, ast.Compare):
        sides = [node.left, *node.comparators]
        result = None
        for left, comparison, right in zip(sides, node.ops, sides[1:], strict=False):
            part = _comparison(left, comparison, right, text, schema)
            result = part if result is None else result & part
        return result
    if isinstance(node, ast.Name):
        return _value(node, text, schema)
    raise _not_understood(node, text)


def _comparison(left: ast.expr, comparison: ast.cmpop, right: ast.expr, text: str, schema: Any) -> Any:
    if isinstance(comparison, (ast.Is, ast.IsNot)):
        if not (isinstance(right, ast.Constant) and right.value is None):
            raise _not_understood(right, text)
        empty = _value(left, text, schema).is_null()
        return empty if isinstance(comparison, ast.Is) else ~empty
    if isinstance(comparison, (ast.In, ast.NotIn)):
        if isinstance(right, ast.Name):
            inside = _contains(right, _constant(left, text), text, schema)
            return inside if isinstance(comparison, ast.In) else ~inside
        if not isinstance(right, (ast.Tuple, ast.List, ast.Set)):
            raise _not_understood(right, text)
        values = [_constant(item, text) for item in right.elts]
        inside = _value(left, text, schema).isin(values)
        return inside if isinstance(comparison, ast.In) else ~inside
    return _COMPARISONS[type(comparison)](_value(left, text, schema), _value(right, text, schema))


def _contains(column: ast.Name, value: Any, text: str, schema: Any) -> Any:
    """Whether a column's text, or the beginning of one of its texts, is this one."""
    kind = _type(column, schema)
    if not isinstance(value, str) or not value:
        raise _not_understood(column, text)
    if pa.types.is_string(kind):
        return pc.match_substring(pc.field(column.id), value)
    if pa.types.is_list(kind) and pa.types.is_string(kind.value_type):
        return pc.match_substring_regex(pc.binary_join(pc.field(column.id), " "), f"(^| ){re.escape(value)}")
    raise _not_understood(column, text)


def _value(node: ast.expr, text: str, schema: Any) -> Any:
    if isinstance(node, ast.Name):
        kind = _type(node, schema)
        # Times compare with texts in ISO 8601.
        return pc.field(node.id).cast(pa.string()) if pa.types.is_timestamp(kind) else pc.field(node.id)
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
        return _element(node.value, node.slice, text, schema)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "len" and len(node.args) == 1:
        (argument,) = node.args
        if isinstance(argument, ast.Name) and _is_list(_type(argument, schema)) and not node.keywords:
            return pc.list_value_length(pc.field(argument.id))
    if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        # Real numbers, as in Python: pyarrow would cut quotients of integers, and wrap products of small ones.
        sides = (_value(side, text, schema).cast(pa.float64()) for side in (node.left, node.right))
        return _ARITHMETIC[type(node.op)](*sides)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
        return pc.negate(_value(node.operand, text, schema))
    return pc.scalar(_constant(node, text))


def _element(column: ast.Name, place: ast.expr, text: str, schema: Any) -> Any:
    """An element of a list, counted from 0; null where the list is shorter."""
    kind = _type(column, schema)
    number: Any = _constant(place, text)
    if not _is_list(kind) or type(number) is not int or not 0 <= number < LENGTH_LIMIT:
        raise _not_understood(column, text)
    one = pc.list_slice(pc.field(column.id), number, number + 1, return_fixed_size_list=True)
    return pc.list_element(one, 0)


def _type(column: ast.Name, schema: Any) -> Any:
    if column.id not in schema.names:
        close = difflib.get_close_matches(column.id, schema.names, n=1)
        hint = f"did you mean '{close[0]}'? " if close else ""
        raise InputError(f"--where: unknown column {column.id}; {hint}the columns are {', '.join(schema.names)}")
    return schema.field(column.id).type


def _is_list(kind: Any) -> bool:
    return bool(pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind))


def _constant(node: ast.expr, text: str) -> float | str | bool:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        value = _constant(node.operand, text)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return -value
    elif isinstance(node, ast.Constant) and isinstance(node.value, (int, float, str)):
        # What no column of whole numbers can hold is compared as Arrow can: as a real number.
        is_huge = isinstance(node.value, int) and node.value > _LARGEST
        return float(node.value) if is_huge else node.value
    raise _not_understood(node, text)


def _not_understood(node: ast.AST, text: str) -> InputError:
    what = ast.get_source_segment(text.strip(), node) or text
    return InputError(
        f"--where: {what!r} is not understood; use columns, numbers, texts, and, or, not, in, len(), [], == < > + - * /"
    )


def selection_of(text: str | None) -> tuple[Any, tuple[str, ...]]:
    """The expression of a filter over a catalogue's columns, and the columns that it refers to; None if it is None.

    Raises:
        InputError: see `filter_expression`.
    """
    if text is None:
        return None, ()
    expression = filter_expression(text, DESIGN_SCHEMA)
    names = (node.id for node in ast.walk(ast.parse(text.strip(), mode="eval")) if isinstance(node, ast.Name))
    return expression, tuple(name for name in dict.fromkeys(names) if name in DESIGN_SCHEMA.names)


@contextlib.contextmanager
def explained_selection(text: str | None) -> Iterator[None]:
    """What Arrow says of an expression that does not fit its columns, as an `InputError`."""
    try:
        yield
    except (pa.ArrowException, TypeError) as error:
        raise _unfitting(text, error) from None


def _unfitting(text: str | None, error: Exception) -> InputError:
    return InputError(f"--where {text!r}: {str(error).splitlines()[0]}; compare numbers with numbers")
