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

from fractal_farm.catalogue.identities import DIGITS, SHORTEST_PREFIX, id_pieces, id_words
from fractal_farm.catalogue.layout import PartName
from fractal_farm.catalogue.parts import ROW_GROUP, open_part, read_columns
from fractal_farm.catalogue.schema import DESIGN_SCHEMA, KINDS, ORDER_OF_BIRTH, PLANTED
from fractal_farm.errors import FarmError

RANK = ("design_id", "kind", "operator", *ORDER_OF_BIRTH, "run_id", "created_us", "writer")
"""Of rows with equal design_id the first in this order stands; a design comes before an ancestor, and what was bred
before what was planted: the founder of one run is a child of another. Designs made by hand have no place of birth."""

_MIX = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F))

Places = npt.NDArray[np.int64]


class Rows:
    """The rows of some parts, one after the other; each column is read when it is first asked for.

    Args:
        parts: the directory of the catalogue, and the name, of each; `PartGoneError` may come of those that are gone.
    """

    def __init__(self, parts: Sequence[tuple[Path, PartName]]) -> None:
        self._parts = [(root, name) for root, name in parts if name.rows]
        self._ends = np.cumsum([name.rows for _, name in self._parts], dtype=np.int64)
        self._columns: list[dict[str, Any]] = [{} for _ in self._parts]
        self._files: dict[PartName, Any] = {}

    def __len__(self) -> int:
        return int(self._ends[-1]) if self._parts else 0

    def read(self, columns: Sequence[str]) -> Any:
        """Columns of all rows as a table, in order of the rows."""
        return pa.concat_tables([empty_table(columns), *(self._whole(k, columns) for k in range(len(self._parts)))])

    def take(self, columns: Sequence[str], places: Places) -> Any:
        """Columns of some rows, in the order of `places`."""
        order = np.argsort(places, kind="stable")
        inside = places[order]
        bounds = np.searchsorted(inside, np.concatenate([[0], self._ends]))
        tables = [empty_table(columns)]
        for number, (_, name) in enumerate(self._parts):
            mine = inside[bounds[number] : bounds[number + 1]]
            if len(mine):
                tables.append(self._chosen(number, columns, mine - (self._ends[number] - name.rows)))
        back = np.empty(len(places), np.int64)
        back[order] = np.arange(len(places))
        return pa.concat_tables(tables).take(indices(back))

    def standing(self, *, ancestors: bool) -> Places:
        """The rows that stand, one for each design_id, in order of the rows.

        Args:
            ancestors: also rows of kind "ancestor" whose design has no row of its own.
        """
        if ancestors:
            places = np.arange(len(self))
        else:
            places = places_of(pc.indices_nonzero(pc.starts_with(self.read(["kind"]).column(0), KINDS[0])))
        repeated = _repeated(self.read(["design_id"]).column(0), places)
        if not len(repeated):
            return places
        first = first_of_each(self.take(RANK, repeated))
        return np.sort(np.concatenate([np.setdiff1d(places, repeated, assume_unique=True), repeated[first]]))

    def beginning_with(self, prefix: str) -> Places:
        """The rows whose design_id begins with these digits, four or more."""
        wanted = prefix.encode()
        head = np.frombuffer(wanted[:SHORTEST_PREFIX], np.uint32)
        found, before = [np.zeros(0, np.int64)], 0
        for words in id_pieces(self.read(["design_id"]).column(0)):
            near = np.flatnonzero(words.view(np.uint32)[:, 0] == head)
            digits = words[near].view(np.uint8).reshape(-1, DIGITS)[:, : len(wanted)]
            found.append(before + near[(digits == np.frombuffer(wanted, np.uint8)).all(axis=1)])
            before += len(words)
        return np.concatenate(found)

    def first(self, places: Places, column: str, descending: bool, limit: int | None = None) -> Places:
        """Some rows, or the first so many of them, in the order of a column, and of design_id where it is equal."""
        if limit is not None:
            places = _near_the_end(self.read([column]).column(0), places, descending, limit)
        keys: list[tuple[str, str]] = [(column, "descending" if descending else "ascending")]
        keys += [("design_id", "ascending")] if column != "design_id" else []
        order = pc.sort_indices(self.take([name for name, _ in keys], places), keys)
        return np.asarray(places[places_of(order)[:limit]], np.int64)

    def best_first(self, places: Places) -> Places:
        """Some rows in order of (-fitness, design_id)."""
        return self.first(places, "fitness", descending=True)

    def _whole(self, number: int, columns: Sequence[str]) -> Any:
        """Columns of a part, read or remembered."""
        root, name = self._parts[number]
        known = self._columns[number]
        if missing := [column for column in dict.fromkeys(columns) if column not in known]:
            table = read_columns(root, name, self._open(root, name), missing)
            if table.num_rows != name.rows:
                raise FarmError(f"{name.file_name}: holds {table.num_rows} rows; its name says {name.rows}")
            known.update(zip(missing, table.columns, strict=True))
        return pa.Table.from_arrays([known[column] for column in columns], schema=empty_table(columns).schema)

    def _chosen(self, number: int, columns: Sequence[str], rows: Places) -> Any:
        """Rows of a part, given in ascending order; of a merged one only the groups that hold them are read."""
        root, name = self._parts[number]
        if all(column in self._columns[number] for column in columns):
            return self._whole(number, columns).take(indices(rows))
        if not name.is_merged:
            return read_columns(root, name, self._open(root, name), columns).take(indices(rows))
        groups, group_of = np.unique(rows // ROW_GROUP, return_inverse=True)
        table = read_columns(root, name, self._open(root, name), columns, groups.tolist())
        return table.take(indices(group_of * ROW_GROUP + rows % ROW_GROUP))

    def _open(self, root: Path, name: PartName) -> Any:
        """A part; merged ones stay open."""
        file = self._files.get(name) or open_part(root, name)
        if name.is_merged:
            self._files[name] = file
        return file


def indices(places: npt.NDArray[Any]) -> Any:
    """Row numbers as an Arrow array; Arrow's own way would import pandas, which takes longer than a query."""
    return pa.Array.from_buffers(pa.int64(), len(places), [None, pa.py_buffer(np.ascontiguousarray(places, np.int64))])


def places_of(numbers: Any) -> Places:
    """The inverse of `indices`, of unsigned 64-bit integers too."""
    return np.frombuffer(numbers.buffers()[1], np.int64, len(numbers), 8 * numbers.offset)


def numbers(column: Any) -> npt.NDArray[Any]:
    """A column of integers or floats without nulls; Arrow's own way would import pandas."""
    kind = column.type
    pieces = [
        np.ndarray(len(chunk), kind.to_pandas_dtype(), chunk.buffers()[1], chunk.offset * kind.byte_width)
        for chunk in column.chunks
        if len(chunk)
    ]
    return np.concatenate([np.zeros(0, kind.to_pandas_dtype()), *pieces])


def first_of_each(table: Any) -> Places:
    """Indices of the rows that stand in a table with the columns of `RANK`, in order of design_id."""
    planted = pc.starts_with(table.column("operator"), PLANTED)
    table = table.set_column(table.column_names.index("operator"), "operator", planted)
    keys = [(name, "descending" if name == "kind" else "ascending") for name in RANK]
    order = places_of(pc.sort_indices(table, keys))
    ids = id_words(table.column("design_id"))[order]
    first = np.ones(len(ids), bool)
    first[1:] = (ids[1:] != ids[:-1]).any(axis=1)
    return np.asarray(order[first], np.int64)


def one_of_each(column: Any, places: Places) -> Places:
    """Of some rows the first of each id of a column of design_ids, in their order."""
    repeated = _repeated(column, places)
    if not len(repeated):
        return places
    _, first = np.unique(id_words(column)[repeated], axis=0, return_index=True)
    return np.sort(np.concatenate([np.setdiff1d(places, repeated, assume_unique=True), repeated[first]]))


def _near_the_end(column: Any, places: Places, descending: bool, limit: int) -> Places:
    """Of some rows those that may be among the first so many in the order of a column; all where that is not plain."""
    kind = column.type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)) or column.null_count or limit >= len(places):
        return places
    values = numbers(column)[places]
    if np.isnan(values).any():
        return places
    values = -values if descending else values
    return np.asarray(places[values <= np.partition(values, limit - 1)[limit - 1]], np.int64)


def _repeated(column: Any, places: Places) -> Places:
    """Those of some rows whose design_id others of them have too."""
    with np.errstate(over="ignore"):
        marks = np.concatenate([words[:, 0] * _MIX[0] + words[:, 1] * _MIX[1] for words in id_pieces(column)])[places]
    ordered = np.sort(marks)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if not len(twice):
        return np.zeros(0, np.int64)
    candidates = places[np.isin(marks, twice)]
    ids = id_words(column)[candidates]
    _, back, counts = np.unique(ids, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(candidates[counts[back.ravel()] > 1], np.int64)


def empty_table(columns: Sequence[str]) -> Any:
    """A table of no rows with these columns."""
    return pa.Table.from_batches([], pa.schema([DESIGN_SCHEMA.field(name) for name in columns]))
