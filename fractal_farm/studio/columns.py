"""The columns of a catalogue as the pages take them: little-endian arrays, one number a design (issue 7, 'Data').

`columns.bin` holds the rows from a given one on: each column in the order of `COLUMNS`, padded with zeros to a multiple
of 8 bytes. Nothing here reads a file: `reading` does.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue.schema import DESIGN_SCHEMA

BLOCK = 1024
"""Designs whose maps are sent together."""
MAP_NUMBERS = 13
"""A map is sent as its 3 x 4 numbers [A | b], row-major, and its probability."""
UNKNOWN = 0xFFFFFFFF
"""What a column of whole numbers holds where nothing is known."""
ID_BYTES = 16
_ALIGNED = 8

Arrays = Mapping[str, npt.NDArray[Any]]


class Column(NamedTuple):
    """One column: name, type ("id": 16 bytes, or a little-endian number), and how it is shown."""

    name: str
    type: str
    label: str
    unit: str
    digits: int
    help: str


def _of_schema(name: str, kind: str, label: str, digits: int, unit: str | None = None) -> Column:
    about = DESIGN_SCHEMA.field(name).metadata
    told = about[b"unit"].decode() if unit is None else unit
    return Column(name, kind, label, "" if told == "1" else told, digits, about[b"meaning"].decode())


COLUMNS = (
    _of_schema("design_id", "id", "Design", 0),
    _of_schema("n_maps", "u1", "Maps", 0),
    _of_schema("fitness", "f4", "Fitness", 3),
    _of_schema("d0", "f4", "D0", 3),
    _of_schema("d2", "f4", "D2", 3),
    _of_schema("lle", "f4", "LLE", 3),
    _of_schema("gap", "f4", "Gap", 4, ""),
    _of_schema("similarity_dimension", "f4", "Similarity dimension", 3),
    _of_schema("grams", "f4", "Weight in silver", 2),
    _of_schema("niche", "u4", "Niche", 0),
    _of_schema("symmetry", "u1", "Symmetry", 0),
    Column("rating", "u1", "Rating", "stars", 0, "1 to 5 stars that somebody gave; 0: none"),
    Column("favourite", "u1", "Favourite", "", 0, "1 if it is one of the favourites"),
    Column("rejected", "u1", "Rejected", "", 0, "1 if somebody rejected it"),
    Column("by_hand", "u1", "By hand", "", 0, "1 if somebody made it, and not a run"),
    Column("representative", "u4", "Group", "", 0, "row of the design that stands for its shape; its own if it does"),
    Column("group_size", "u4", "Alike", "designs", 0, "number of designs of its shape, itself included"),
    Column("created", "u4", "Made", "s", 0, "time of its commit, seconds since 1970, UTC"),
)

DTYPES: dict[str, np.dtype[Any]] = {
    "f4": np.dtype("<f4"),
    "u1": np.dtype("u1"),
    "u4": np.dtype("<u4"),
    "id": np.dtype((np.void, ID_BYTES)),
}


def encoded(arrays: Arrays, start: int = 0, stop: int | None = None) -> Iterator[memoryview]:
    """The bytes of `columns.bin` for the rows from `start` to `stop`, in pieces.

    Args:
        arrays: column name -> (n,) of its type; design_id is (n, 16) uint8.
        start: first row.
        stop: row after the last; all if None.
    """
    for column in COLUMNS:
        values = np.ascontiguousarray(arrays[column.name][start:stop])
        yield values.reshape(-1).view(np.uint8).data
        if rest := -values.nbytes % _ALIGNED:
            yield memoryview(bytes(rest))


def encoded_bytes(rows: int) -> int:
    """Length of `columns.bin` for so many rows."""
    return sum(-(-rows * DTYPES[column.type].itemsize // _ALIGNED) * _ALIGNED for column in COLUMNS)


def version_of(arrays: Arrays, maps_per_row: int) -> str:
    """16 hex digits over the content: equal for equal data."""
    digest = hashlib.blake2b(json.dumps([COLUMNS, maps_per_row]).encode(), digest_size=8, person=b"farm-studio-1")
    for piece in encoded(arrays):
        digest.update(piece)
    return digest.hexdigest()


class Maps:
    """The maps of designs in order of their rows, as float32, without the room that smaller genomes leave.

    Args:
        counts: (n,) maps of each design.
        flat: (sum of counts, 13) float32.
    """

    def __init__(self, counts: npt.NDArray[np.uint8], flat: npt.NDArray[np.float32]) -> None:
        self._starts = np.concatenate([[0], np.cumsum(counts, dtype=np.int64)])
        self._flat = flat

    def __len__(self) -> int:
        return len(self._starts) - 1

    def rows(self, start: int, stop: int, maps_per_row: int) -> npt.NDArray[np.float32]:
        """The maps of some rows: (rows, maps_per_row, 13) float32, 0 where a design has fewer maps."""
        starts = self._starts[start : stop + 1]
        counts = np.diff(starts)
        result = np.zeros((len(counts), maps_per_row, MAP_NUMBERS), np.float32)
        used = np.arange(maps_per_row) < counts[:, None]
        result[used] = self._flat[starts[0] : starts[-1]]
        return result

    def joined(self, counts: npt.NDArray[np.uint8], flat: npt.NDArray[np.float32]) -> Maps:
        """These and further designs after them."""
        known = np.diff(self._starts).astype(np.uint8)
        return Maps(np.concatenate([known, counts]), np.concatenate([self._flat, flat]))


def id_bytes(words: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint8]:
    """Design ids as (n, 16) bytes, from (n, 4) uint64 that hold their 32 digits as text (`identities.id_words`)."""
    digits = np.ascontiguousarray(words).view(np.uint8).reshape(-1, 2 * ID_BYTES)
    values = np.where(digits < ord("a"), digits - ord("0"), digits - (ord("a") - 10)).astype(np.uint8)
    return np.asarray((values[:, ::2] << 4) | values[:, 1::2], np.uint8)
