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

from fractal_farm.catalogue.clouds import CLOUD_COLUMNS, CloudArrays, DenseClouds
from fractal_farm.catalogue.digest import BLOCK, DIGEST_COLUMNS, content_digest
from fractal_farm.catalogue.durable import put
from fractal_farm.catalogue.identities import checked_prefix
from fractal_farm.catalogue.layout import FEATURES, FORMAT, HAND, PartName, belongs_to
from fractal_farm.catalogue.parts import PartGoneError, list_parts, read_of_parts
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.catalogue.runs import RunInfo, run_ids, run_info
from fractal_farm.catalogue.scan import RANK, Places, Rows, first_of_each, indices
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.catalogue.shards import ATTRIBUTE, ROOT, root_documents
from fractal_farm.catalogue.signatures import standing_designs
from fractal_farm.catalogue.solids import SolidInfo, add_solid, list_solids
from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome

_PLACE = "place of the row"


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
        self._rows = Rows([])

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
        wanted = _known(DESIGN_SCHEMA.names if columns is None else columns)

        def read(parts: list[PartName]) -> Any:
            rows = self._rows_of(parts if by_hand else _not_by_hand(parts))
            return rows.read(wanted).take(indices(rows.best_first(rows.standing(ancestors=ancestors))))

        return read_of_parts(self.path, run_id, read)

    def select(
        self,
        columns: Sequence[str],
        where: Any = None,
        names: Sequence[str] = (),
        order: tuple[str, bool] = ("fitness", True),
        limit: int | None = None,
        *,
        ancestors: bool = False,
    ) -> tuple[Any, int]:
        """Some of the designs, sorted; nothing is read but what the question needs.

        Args:
            columns: names of `schema.DESIGN_SCHEMA`.
            where: pyarrow expression that is true of the wanted designs; all if None.
            names: columns that the expression refers to.
            order: column to sort by, and whether the largest come first; of equal ones the smallest design_id.
            limit: only the first so many.
            ancestors: also parents of designs that were not kept themselves.

        Returns:
            The table, and how many designs the expression is true of.

        Raises:
            InputError: an unknown column.
            FarmError: a manifest part is missing or damaged.
            pyarrow.ArrowException: an expression or a column to sort by that does not fit its types.
        """
        wanted = _known(columns)

        def read(parts: list[PartName]) -> tuple[Any, int]:
            rows, places = self._selected(parts, where, _known([*names, order[0]]), ancestors=ancestors)
            return rows.take(wanted, rows.first(places, *order, limit)), len(places)

        return read_of_parts(self.path, None, read)

    def selection(self, where: Any = None, names: Sequence[str] = ()) -> tuple[Rows, Places]:
        """The manifest's rows, and the numbers of those that an expression is true of, best first; see `select`."""

        def read(parts: list[PartName]) -> tuple[Rows, Places]:
            rows, places = self._selected(parts, where, _known([*names, "fitness"]))
            return rows, rows.best_first(places)

        return read_of_parts(self.path, None, read)

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
        if run_id is None and limit is not None:
            return DenseClouds(self._arrays, self.select(CLOUD_COLUMNS, limit=limit)[0])
        return DenseClouds(self._arrays, self.designs(CLOUD_COLUMNS, run_id).slice(0, limit))

    def digest(self, run_id: str | None = None) -> str:
        """The content digest, 32 hex digits: equal for equal results, however they came about.

        Ancestors count; what people did by hand does not.
        """

        def read(parts: list[PartName]) -> str:
            rows = self._rows_of(_not_by_hand(parts))
            rows.read(DIGEST_COLUMNS)
            places = rows.first(rows.standing(ancestors=True), "design_id", descending=False)
            return content_digest(
                rows.take(DIGEST_COLUMNS, places[start : start + BLOCK]) for start in range(0, len(places), BLOCK)
            )

        return read_of_parts(self.path, run_id, read)

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

    def solids(self, design_id: str | None = None) -> list[SolidInfo]:
        """The finished solids, in order of design and parameters; only those of one design if it is given."""
        return list(list_solids(self.path, design_id))

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

    def _row(self, design_id: str, columns: Sequence[str]) -> Any:
        """The one-row table of a design."""
        prefix = checked_prefix(design_id)
        found = self._found(prefix, columns) or read_of_parts(
            self.path, None, lambda parts: self._found(prefix, columns, parts)
        )
        if found is None:
            raise InputError(f"{self.path}: no design {design_id}; `farm list` shows the designs")
        return found

    def _selected(
        self, parts: list[PartName], where: Any, keys: Sequence[str], *, ancestors: bool = False
    ) -> tuple[Rows, Places]:
        rows = self._rows_of(parts)
        known = None if ancestors else standing_designs(self.path, parts)
        if known is None:
            rows.read(["design_id", "kind", *keys])
            known = rows.standing(ancestors=ancestors)
        places = known
        if where is not None:
            table = rows.read(keys).append_column(_PLACE, indices(np.arange(len(rows)))).take(indices(places))
            places = table.filter(where).column(_PLACE).to_numpy()
        return rows, places

    def _rows_of(self, parts: list[PartName]) -> Rows:
        return Rows([(self.path, part) for part in parts])

    def _found(self, prefix: str, columns: Sequence[str], parts: list[PartName] | None = None) -> Any:
        """The row of the only design whose id begins with a prefix; None if there is none.

        Args:
            prefix: hex digits.
            columns: columns of the row.
            parts: where to look; where the last look was if None.
        """
        if parts is not None:
            self._rows = self._rows_of(parts)
        try:
            places = self._rows.beginning_with(prefix)
            if not len(places):
                return None
            ranked = self._rows.take(RANK, places)
            places = places[first_of_each(ranked)]
            if len(places) > 1:
                ids = self._rows.take(["design_id"], places[:4]).column(0).to_pylist()
                raise InputError(
                    f"{self.path}: {len(places)} designs begin with {prefix}: {', '.join(ids)} ...; give more digits"
                )
            return self._rows.take(columns, places)
        except PartGoneError:
            if parts is not None:
                raise
            return None


def _known(columns: Sequence[str]) -> list[str]:
    """The columns, each once, if all of them exist."""
    if unknown := [name for name in columns if name not in DESIGN_SCHEMA.names]:
        raise InputError(f"no column {', '.join(unknown)}; the columns are {', '.join(DESIGN_SCHEMA.names)}")
    return list(dict.fromkeys(columns))


def _not_by_hand(parts: Sequence[PartName]) -> list[PartName]:
    return [part for part in parts if not belongs_to(part.writer, HAND)]


def _version(text: str) -> tuple[int, int]:
    major, minor = text.split(".")
    return int(major), int(minor)
