"""The rows of a catalogue, a column at a time: what a question does not need is not read.

`Rows` numbers the rows of some parts. Which of them stand (one for each design_id), and in which order, is decided on
a few columns; the others are read for the rows that were chosen alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue.layout import PartName
from fractal_farm.catalogue.parts import ROW_GROUP, read_rows
from fractal_farm.catalogue.schema import DESIGN_SCHEMA, KINDS, ORDER_OF_BIRTH
from fractal_farm.errors import FarmError

RANK = ("design_id", "kind", *ORDER_OF_BIRTH, "run_id", "created_us", "writer")
"""Of rows with equal design_id the first in this order stands; a design comes before an ancestor."""

_ID_DIGITS = 32
_SHORTEST_PREFIX = 4
_MIX = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F))

Places = npt.NDArray[np.int64]


class Rows:
    """The rows of some parts, one after the other; each column is read when it is first asked for.

    Args:
        root: directory of the catalogue.
        parts: as `list_parts` gives them; what they hold may raise `PartGoneError`.
    """

    def __init__(self, root: Path, parts: Sequence[PartName]) -> None:
        self._root = root
        self._parts = [part for part in parts if part.rows]
        self._ends = np.cumsum([part.rows for part in self._parts], dtype=np.int64)
        self._columns: dict[str, Any] = {}

    def __len__(self) -> int:
        return int(self._ends[-1]) if self._parts else 0

    def read(self, columns: Sequence[str]) -> Any:
        """Columns of all rows as a table, in order of the rows."""
        if missing := [name for name in dict.fromkeys(columns) if name not in self._columns]:
            empty = _empty(missing)
            tables = [self._whole(part, missing) for part in self._parts]
            table = pa.concat_tables([empty, *tables])
            self._columns.update(zip(missing, table.columns, strict=True))
        return pa.Table.from_arrays([self._columns[name] for name in columns], schema=_empty(columns).schema)

    def _whole(self, part: PartName, columns: Sequence[str]) -> Any:
        table = read_rows(self._root, part, columns)
        if table.num_rows != part.rows:
            raise FarmError(f"{part.file_name}: holds {table.num_rows} rows; its name says {part.rows}")
        return table

    def take(self, columns: Sequence[str], places: Places) -> Any:
        """Columns of some rows, in the order of `places`."""
        if all(name in self._columns for name in columns):
            return self.read(columns).take(pa.array(places))
        order = np.argsort(places, kind="stable")
        inside = places[order]
        bounds = np.searchsorted(inside, np.concatenate([[0], self._ends]))
        tables = [_empty(columns)]
        for number, part in enumerate(self._parts):
            mine = inside[bounds[number] : bounds[number + 1]]
            if len(mine):
                tables.append(_chosen_rows(self._root, part, columns, mine - (self._ends[number] - part.rows)))
        back = np.empty(len(places), np.int64)
        back[order] = np.arange(len(places))
        return pa.concat_tables(tables).take(pa.array(back))

    def standing(self, *, ancestors: bool) -> Places:
        """The rows that stand, one for each design_id, in order of the rows.

        Args:
            ancestors: also rows of kind "ancestor" whose design has no row of its own.
        """
        places = np.arange(len(self))
        if not ancestors:
            places = places[_designs(self.read(["kind"]).column(0))]
        ids = id_words(self.read(["design_id"]).column(0))[places]
        repeated = places[_repeated(ids)]
        if not len(repeated):
            return places
        first = first_of_each(self.take(RANK, repeated))
        return np.sort(np.concatenate([np.setdiff1d(places, repeated, assume_unique=True), repeated[first]]))

    def beginning_with(self, prefix: str) -> Places:
        """The rows whose design_id begins with these digits, four or more."""
        wanted = prefix.encode()
        digits = id_words(self.read(["design_id"]).column(0)).view(np.uint8).reshape(-1, _ID_DIGITS)
        head = np.frombuffer(wanted[:_SHORTEST_PREFIX], "<u4")
        near = np.flatnonzero(digits.view("<u4")[:, 0] == head)
        alike = (digits[near, : len(wanted)] == np.frombuffer(wanted, np.uint8)).all(axis=1)
        return np.asarray(near[alike], np.int64)

    def first(self, places: Places, column: str, descending: bool, limit: int | None = None) -> Places:
        """Some rows, or the first so many of them, in the order of a column, and of design_id where it is equal."""
        keys: list[tuple[str, str]] = [(column, "descending" if descending else "ascending")]
        keys += [("design_id", "ascending")] if column != "design_id" else []
        table = self.take([name for name, _ in keys], places)
        # Arrow selects the first of numbers alone; of other types it is not safe.
        kind = table.schema.types[0]
        plain = (pa.types.is_floating(kind) or pa.types.is_integer(kind)) and not table.column(0).null_count
        if plain and limit is not None and limit < len(places):
            return places[pc.select_k_unstable(table, limit, keys).to_numpy()]
        return places[pc.sort_indices(table, keys).to_numpy()[:limit]]

    def best_first(self, places: Places) -> Places:
        """Some rows in order of (-fitness, design_id)."""
        return self.first(places, "fitness", descending=True)


def first_of_each(table: Any) -> Places:
    """Indices of the rows that stand in a table with the columns of `RANK`, in order of design_id."""
    order = pc.sort_indices(table, [(name, "descending" if name == "kind" else "ascending") for name in RANK])
    ids = id_words(table.column("design_id"))[order.to_numpy()]
    first = np.ones(len(ids), bool)
    first[1:] = (ids[1:] != ids[:-1]).any(axis=1)
    return np.asarray(order.to_numpy()[first], np.int64)


def one_of_each(column: Any) -> Places:
    """Indices of the first row of each id of a column of design_ids, in their order."""
    ids = id_words(column)
    places = np.arange(len(ids))
    repeated = _repeated(ids)
    if not len(repeated):
        return places
    _, first = np.unique(ids[repeated], axis=0, return_index=True)
    return np.sort(np.concatenate([np.setdiff1d(places, repeated, assume_unique=True), repeated[first]]))


def id_words(column: Any) -> npt.NDArray[np.uint64]:
    """A column of design_ids as (n, 4) uint64: the 32 digits as they are, eight a word."""
    pieces = [np.zeros((0, 4), np.uint64)]
    for chunk in column.chunks if isinstance(column, pa.ChunkedArray) else [column]:
        if not len(chunk):
            continue
        _, offsets, digits = chunk.buffers()
        ends = np.frombuffer(offsets, np.int32)[chunk.offset : chunk.offset + len(chunk) + 1]
        if chunk.null_count or (np.diff(ends) != _ID_DIGITS).any():
            raise FarmError(f"design_id: not {_ID_DIGITS} digits in every row; see `farm verify`")
        words = np.frombuffer(digits, np.uint8)[ends[0] : ends[-1]]
        pieces.append(np.ascontiguousarray(words).view("<u8").reshape(-1, 4))
    return np.concatenate(pieces)


def _repeated(ids: npt.NDArray[np.uint64]) -> npt.NDArray[np.intp]:
    """Indices of the ids that occur more than once."""
    with np.errstate(over="ignore"):
        marks = ids[:, 0] * _MIX[0] + ids[:, 1] * _MIX[1]
    ordered = np.sort(marks)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(twice):
        return np.zeros(0, np.intp)
    candidates = np.flatnonzero(np.isin(marks, twice))
    _, back, counts = np.unique(ids[candidates], axis=0, return_inverse=True, return_counts=True)
    return np.asarray(candidates[counts[back.ravel()] > 1], np.intp)


def _designs(kinds: Any) -> npt.NDArray[np.bool_]:
    return np.asarray(pc.equal(kinds, KINDS[0]).to_numpy(), bool)


def _chosen_rows(root: Path, part: PartName, columns: Sequence[str], rows: Places) -> Any:
    """Rows of a part, given in ascending order; of a merged one only the row groups that hold them are read."""
    if not part.is_merged:
        return read_rows(root, part, columns).take(pa.array(rows))
    groups, group_of = np.unique(rows // ROW_GROUP, return_inverse=True)
    starts = np.arange(len(groups)) * ROW_GROUP
    table = read_rows(root, part, columns, groups.tolist())
    return table.take(pa.array(starts[group_of] + rows % ROW_GROUP))


def _empty(columns: Sequence[str]) -> Any:
    return pa.schema([DESIGN_SCHEMA.field(name) for name in columns]).empty_table()
