"""`Catalogue`: everything that a catalogue holds, read while it grows or years later.

Readers take no lock: what has a name is complete, and never changes. Each call lists the manifest anew, so
that a running farm's latest commits are seen.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue.clouds import CLOUD_COLUMNS, CloudArrays, DenseClouds
from fractal_farm.catalogue.digest import DIGEST_COLUMNS, content_digest
from fractal_farm.catalogue.durable import put
from fractal_farm.catalogue.layout import FEATURES, FORMAT, HAND, PartName, belongs_to
from fractal_farm.catalogue.parts import list_parts, read_rows
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.catalogue.runs import RunInfo, run_ids, run_info
from fractal_farm.catalogue.schema import DESIGN_SCHEMA, KINDS, ORDER_OF_BIRTH, PLANTED
from fractal_farm.catalogue.shards import ATTRIBUTE, ROOT, root_documents
from fractal_farm.catalogue.solids import SolidInfo, add_solid, list_solids
from fractal_farm.errors import FarmError, InputError
from fractal_farm.ifs.genome import Genome

_SHORTEST_PREFIX = 4
_RANK = ("design_id", "kind", "operator", *ORDER_OF_BIRTH, "run_id", "created_us", "writer")
"""Of rows with equal design_id the first in this order stands; a design comes before an ancestor, and what was bred
before what was planted: the founder of one run is a child of another. Designs made by hand have no place of birth."""


@dataclass(frozen=True)
class Usage:
    """What a catalogue takes.

    Attributes:
        files: number of files.
        bytes: their size.
        rows: designs committed, before duplicates are dropped.
    """

    files: int
    bytes: int
    rows: int


class Catalogue:
    """A catalogue on disk; use `Catalogue.open` or `Catalogue.create`.

    Attributes:
        path: its directory.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._arrays = CloudArrays(path)
        self._parts: list[PartName] = []
        self._index: Any = None
        self._ids = np.empty(0, "S32")

    @classmethod
    def create(cls, path: str | os.PathLike[str]) -> Catalogue:
        """Make an empty catalogue in a new or empty directory.

        Raises:
            InputError: the directory holds something, or is a file.
            FarmError: the file system failed.
        """
        root = Path(path)
        if root.exists() and not root.is_dir():
            raise InputError(f"{root}: is a file; name a new directory")
        if root.is_dir() and any(not entry.name.startswith(".") for entry in root.iterdir()):
            kind = "holds a catalogue already" if (root / ROOT).exists() else "is not empty"
            raise InputError(f"{root}: {kind}; name a new directory")
        for key, content in root_documents().items():
            put(root / key, content)
        return cls(root)

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Catalogue:
        """Open a catalogue for reading; a farm may be writing to it.

        Raises:
            InputError: nothing there, not a catalogue, or of a format that this version cannot read.
        """
        root = Path(path)
        try:
            content = json.loads((root / ROOT).read_bytes())
            about = content["attributes"][ATTRIBUTE]
            needed = _version(about["min_reader"])
            features = set(about["features"])
        except FileNotFoundError:
            missing = "no such directory" if not root.exists() else "not a catalogue (it has no zarr.json)"
            raise InputError(f"{root}: {missing}; give the directory of a run") from None
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(
                f"{root}: not a catalogue of the farm, or its zarr.json is damaged (`farm verify {root} --repair`); "
                "give the directory of a run"
            ) from None
        if needed > _version(FORMAT) or features - FEATURES:
            wanted = ", ".join([f"format {about['min_reader']}", *sorted(features - FEATURES)])
            raise InputError(
                f"{root}: needs a reader of {wanted}, this one reads {FORMAT}; install a newer fractal-farm"
            )
        return cls(root)

    def designs(
        self,
        columns: Sequence[str] | None = None,
        run_id: str | None = None,
        *,
        ancestors: bool = False,
        by_hand: bool = True,
    ) -> Any:
        """The designs committed so far, each once, best first.

        Args:
            columns: names of `schema.DESIGN_SCHEMA`; all if None.
            run_id: only designs that this run kept.
            ancestors: also parents of designs that were not kept themselves (kind "ancestor").
            by_hand: also designs that somebody made (run "hand").

        Returns:
            pyarrow Table, sorted by (-fitness, design_id). Of equal design_ids the row smallest in (epoch,
            island, generation, slot) stands.

        Raises:
            InputError: an unknown column.
            FarmError: a manifest part is missing or damaged.
        """
        wanted = list(DESIGN_SCHEMA.names if columns is None else columns)
        if unknown := [name for name in wanted if name not in DESIGN_SCHEMA.names]:
            raise InputError(f"no column {', '.join(unknown)}; the columns are {', '.join(DESIGN_SCHEMA.names)}")
        parts = [part for part in list_parts(self.path, run_id) if by_hand or not belongs_to(part.writer, HAND)]
        table = self._rows(parts, [*dict.fromkeys([*wanted, *_RANK, "fitness"])])
        standing = _first_of_each(table)
        if not ancestors:
            standing = standing.filter(pc.equal(table.column("kind").take(standing), KINDS[0]))
        keys = table.select(["fitness", "design_id"]).take(standing)
        order = pc.sort_indices(keys, [("fitness", "descending"), ("design_id", "ascending")])
        return table.select(wanted).take(standing.take(order))

    def design(self, design_id: str) -> dict[str, Any]:
        """One row of the manifest: column -> value.

        Args:
            design_id: 32 hex digits, or the first four or more if no other design begins with them.

        Raises:
            InputError: no such design, or several.
            FarmError: a manifest part is missing or damaged.
        """
        found: dict[str, Any] = self._row(design_id, DESIGN_SCHEMA.names).to_pylist()[0]
        return found

    def genome(self, design_id: str) -> Genome:
        """The genome of a design; see `design`."""
        return genome_of(self.design(design_id))

    def points(self, design_id: str) -> npt.NDArray[np.float64]:
        """The points of a design as they are stored: quantised after scoring, in Morton order.

        They are the same whether the cloud was kept or is grown again from the genome.

        Args:
            design_id: see `design`.

        Returns:
            (n, 3) float64, IFS units.

        Raises:
            InputError: no such design, or several.
            FarmError: the cloud or a manifest part is missing or damaged.
        """
        return DenseClouds(self._arrays, self._row(design_id, CLOUD_COLUMNS))[0]

    def dense_points(self, run_id: str | None = None, limit: int | None = None) -> DenseClouds:
        """The clouds of all designs as one (design, point, axis) array in the order of `designs`; lazy.

        Args:
            run_id: only designs that this run kept.
            limit: only the best so many.

        Raises:
            InputError: the clouds differ in their number of points.
            FarmError: a manifest part is missing or damaged.
        """
        return DenseClouds(self._arrays, self.designs(CLOUD_COLUMNS, run_id).slice(0, limit))

    def digest(self, run_id: str | None = None) -> str:
        """The content digest, 32 hex digits: equal for equal results, however they came about.

        Ancestors count; what people did by hand does not.
        """
        return content_digest(self.designs(DIGEST_COLUMNS, run_id, ancestors=True, by_hand=False))

    def runs(self) -> list[RunInfo]:
        """The runs of this catalogue, in order of their ids."""
        return [run_info(self.path, run_id) for run_id in run_ids(self.path)]

    def usage(self) -> Usage:
        """Files, bytes and rows, from names and sizes alone."""
        files = size = 0
        for directory, _, names in os.walk(self.path):
            for name in names:
                try:
                    size += (Path(directory) / name).stat().st_size
                except FileNotFoundError:
                    continue
                files += 1
        return Usage(files, size, sum(part.rows for part in list_parts(self.path)))

    def solids(self) -> list[SolidInfo]:
        """The finished solids, in order of design and parameters."""
        return list(list_solids(self.path))

    def add_solid(self, design_id: str, parameters_hash: str, files: Mapping[str, bytes]) -> bool:
        """Store a solid; all of its files appear at once.

        Args:
            design_id: 32 hex digits.
            parameters_hash: hash of the parameters that the solid was made with.
            files: plain file name -> content; "solid.json" is one of them.

        Returns:
            False if this solid is there already; it is left as it is.

        Raises:
            InputError: a name that cannot be a file's, or no solid.json.
            StorageFullError: no space left; nothing stays behind.
            FarmError: the file system failed.
        """
        return add_solid(self.path, design_id, parameters_hash, files)

    def _rows(self, parts: Sequence[PartName], columns: Sequence[str]) -> Any:
        empty = pa.schema([DESIGN_SCHEMA.field(name) for name in columns]).empty_table()
        tables = [read_rows(self.path, part, columns) for part in parts if part.rows]
        return pa.concat_tables([empty, *tables]).combine_chunks()

    def _row(self, design_id: str, columns: Sequence[str]) -> Any:
        """The one-row table of a design."""
        prefix = design_id.lower()
        if len(prefix) < _SHORTEST_PREFIX or set(prefix) - set("0123456789abcdef"):
            raise InputError(f"design {design_id!r}: give at least {_SHORTEST_PREFIX} hex digits of its id")
        low, high = self._matches(prefix)
        if low == high:
            self._refresh()
            low, high = self._matches(prefix)
        if low == high:
            raise InputError(f"{self.path}: no design {design_id}; `farm list` shows the designs")
        if high - low > 1:
            shown = ", ".join(found.decode() for found in self._ids[low : min(high, low + 4)])
            raise InputError(f"{self.path}: {high - low} designs begin with {design_id}: {shown} ...; give more digits")
        place = self._index.slice(low, 1).to_pylist()[0]
        return read_rows(self.path, self._parts[place["part"]], columns).slice(place["row"], 1)

    def _matches(self, prefix: str) -> tuple[int, int]:
        """Range of the sorted ids that begin with a prefix; 'g' follows all hex digits."""
        low, high = np.searchsorted(self._ids, [prefix.encode(), prefix.encode() + b"g"])
        return int(low), int(high)

    def _refresh(self) -> None:
        """List the manifest anew: sorted ids, and where each row lies."""
        self._parts = [part for part in list_parts(self.path) if part.rows]
        table = self._rows(self._parts, _RANK)
        sizes = [part.rows for part in self._parts]
        if sum(sizes) != table.num_rows:
            raise FarmError(f"{self.path}: a manifest part has other than the rows that its name says")
        table = table.append_column("part", pa.array(np.repeat(np.arange(len(sizes)), sizes)))
        row = np.concatenate([np.arange(size) for size in sizes]) if sizes else np.empty(0, np.int64)
        table = table.append_column("row", pa.array(row)).take(_first_of_each(table))
        self._index = table.select(["part", "row"])
        self._ids = np.array(table.column("design_id").to_pylist(), "S32")


def _first_of_each(table: Any) -> Any:
    """Indices of the rows that stand, one for each design_id, in order of design_id."""
    planted = pc.equal(table.column("operator"), PLANTED)
    table = table.set_column(table.column_names.index("operator"), "operator", planted)
    order = pc.sort_indices(table, [(name, "descending" if name == "kind" else "ascending") for name in _RANK])
    ids = np.array(table.column("design_id").to_pylist(), "S32")[order.to_numpy()]
    first = np.ones(len(ids), bool)
    first[1:] = ids[1:] != ids[:-1]
    return order.filter(pa.array(first))


def _version(text: str) -> tuple[int, int]:
    major, minor = text.split(".")
    return int(major), int(minor)
