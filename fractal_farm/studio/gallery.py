"""What the pages draw from, in memory: the columns and maps of all designs, followed while the catalogue grows.

Row numbers never change while a server lives: the designs of the beginning stand best first, and what comes later is
put behind them, best first of each look. `Holdings` are one state of it, immutable; `Gallery.refresh` makes the next.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue import Catalogue, judgements, run_is_live
from fractal_farm.catalogue.identities import DIGITS
from fractal_farm.catalogue.layout import PartName
from fractal_farm.catalogue.parts import PartGoneError, list_parts, read_of_parts
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.catalogue.scan import Places, Rows
from fractal_farm.catalogue.signatures import row_signatures
from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome
from fractal_farm.studio.columns import BLOCK, COLUMNS, Maps, version_of
from fractal_farm.studio.groups import Groups, group_sizes
from fractal_farm.studio.reading import judged_columns, read_columns, read_maps

AT_ONCE = 200_000
"""Above so many designs groups are looked for while the pages are shown already."""
_MARKS = ("descriptor", "d0", "d2")
_PIECE = 1 << 16
_HEX = frozenset("0123456789abcdef")


@dataclass(frozen=True)
class Holdings:
    """One state of a catalogue.

    Attributes:
        arrays: column name -> (n,) array; see `columns.COLUMNS`.
        maps_per_row: the most maps that a design has.
        version: hash of the content.
        parts: the manifest parts that were read.
        epoch: how often rows that were there before have changed otherwise than by judgements.
        judged: how often somebody has judged.
    """

    arrays: dict[str, npt.NDArray[Any]]
    maps_per_row: int
    version: str
    parts: tuple[PartName, ...]
    epoch: int
    judged: int

    def __len__(self) -> int:
        return len(self.arrays["n_maps"])


class Gallery:
    """The designs of a catalogue and their rows.

    Args:
        root: directory of the catalogue.
    """

    def __init__(self, root: Path) -> None:
        self.catalogue = Catalogue.open(root)
        self.root = root
        self._changing = threading.Lock()
        self._mapping = threading.Lock()
        self._looking = threading.Lock()
        self._groups = Groups()
        self._rows_of: list[tuple[npt.NDArray[Any], npt.NDArray[np.int64]]] = []
        self._versions: dict[str, int] = {}
        self._maps: Maps | None = None
        parts, rows, places = _standing(root)
        self._first = (rows, places)
        arrays = read_columns(rows, places)
        self._number(arrays["design_id"], 0)
        grouped = len(places) <= AT_ONCE
        found = self._grouped(rows, places) if grouped else np.arange(len(places))
        self._pending = None if grouped else (rows, places)
        self.current = self._held(Holdings(arrays, 0, "", tuple(parts), 0, -1), found)

    @property
    def live(self) -> bool:
        """Whether a run is at work in the catalogue."""
        return any(run_is_live(self.root, run.run_id) for run in self.catalogue.runs())

    def row_of(self, design_id: str) -> int | None:
        """Row of a design, from the 32 digits of its id; None if it has none."""
        high, low = np.frombuffer(bytes.fromhex(design_id), ">u8").astype(np.uint64)
        for keys, rows in self._rows_of:
            place = int(np.searchsorted(keys["high"], high))
            while place < len(keys) and keys["high"][place] == high:
                if keys["low"][place] == low:
                    return int(rows[place])
                place += 1
        return None

    def identity(self, text: str) -> str:
        """The id of a design, from it, its first digits or its code.

        Raises:
            InputError: no such design, or several.
        """
        if len(text) == DIGITS and set(text) <= _HEX and self.row_of(text) is not None:
            return text
        return str(self.design(text)["design_id"])

    def design(self, identity: str) -> dict[str, Any]:
        """The manifest's row of a design; see `Catalogue.design`."""
        with self._looking:
            return self.catalogue.design(identity)

    def genome(self, identity: str) -> Genome:
        """The genome of a design; see `Catalogue.design`."""
        return genome_of(self.design(identity))

    def rows_in(self, version: str) -> int | None:
        """Number of rows of a version that was given out; None if it never was."""
        return self._versions.get(version)

    def maps(self, block: int, rows: int) -> bytes | None:
        """The maps of a block of a version with so many rows; None if it has no such block."""
        start, stop = block * BLOCK, min((block + 1) * BLOCK, rows)
        if start >= stop:
            return None
        return self.all_maps().rows(start, stop, self.current.maps_per_row).astype("<f4").tobytes()

    def all_maps(self) -> Maps:
        """The maps of all rows; read when first asked for."""
        with self._mapping:
            if self._maps is None:
                self._maps = Maps(*read_maps(*self._first))
            return self._maps

    @property
    def ungrouped(self) -> list[str] | None:
        """The parts in whose designs groups are still to be looked for (`designs_of_parts`); None once they are."""
        return None if self._pending is None else [part.file_name for part in self.current.parts]

    def finish_groups(self, found: npt.NDArray[np.uint32] | None) -> None:
        """Take the groups of all designs that were there in the beginning.

        Args:
            found: (n,) the row of the first design of each one's shape; None: they stay alone.
        """
        assert self._pending is not None
        rows, places = self._pending
        with self._changing:
            self._pending = None
            representatives = np.arange(len(places)) if found is None else found.astype(np.int64)
            first = np.flatnonzero(representatives == np.arange(len(places))) if found is not None else np.zeros(0, int)
            self._groups = Groups(marks_of(rows, places[first]), first, len(places))
            self.current = self._held(replace(self.current, epoch=self.current.epoch + 1), representatives)

    def refresh(self) -> bool:
        """Look for new designs and judgements; whether there were any.

        Raises:
            FarmError: a part or a judgement is damaged.
        """
        if self._pending is not None:
            return False
        with self._changing:
            parts = tuple(list_parts(self.root))
            try:
                fresh = self._fresh(parts) if parts != self.current.parts else None
            except PartGoneError:  # merged since it was listed: the next look finds the merged one
                return False
            if fresh is None and _times_judged(self.root) == self.current.judged:
                self.current = replace(self.current, parts=parts)
                return False
            known, groups = self.current, self.current.arrays["representative"]
            if fresh is not None:
                rows, places, arrays, counts, flat = fresh
                with self._mapping:
                    if self._maps is None:
                        self._maps = Maps(*read_maps(*self._first))
                    self._maps = self._maps.joined(counts, flat)
                self._number(arrays["design_id"], len(known))
                groups = np.concatenate([groups, self._grouped(rows, places)])
                joined = {name: np.concatenate([known.arrays[name], values]) for name, values in arrays.items()}
                known = replace(known, arrays=joined)
            self.current = self._held(replace(known, parts=parts), groups)
        return True

    def _fresh(self, parts: Sequence[PartName]) -> Any:
        """What stands in new parts and has no row yet, best first; None if there is nothing."""
        before = set(self.current.parts)
        rows, places = designs_of_parts(self.root, [part for part in parts if part not in before])
        ids = read_columns(rows, places)["design_id"]
        new = np.array([self.row_of(identity.tobytes().hex()) is None for identity in ids], bool)
        if not new.any():
            return None
        places = places[new]
        return rows, places, read_columns(rows, places), *read_maps(rows, places)

    def _number(self, ids: npt.NDArray[np.uint8], first: int) -> None:
        words = np.ascontiguousarray(ids).view(">u8").astype(np.uint64)
        order = np.lexsort((words[:, 1], words[:, 0]))
        keys = np.empty(len(ids), [("high", np.uint64), ("low", np.uint64)])
        keys["high"], keys["low"] = words[order, 0], words[order, 1]
        self._rows_of.append((keys, order + first))

    def _grouped(self, rows: Rows, places: Places) -> npt.NDArray[np.int64]:
        return self._groups.add(marks_of(rows, places))

    def _held(self, holdings: Holdings, representatives: npt.NDArray[Any]) -> Holdings:
        """The same with groups and judgements, under its version."""
        judged = _times_judged(self.root)
        thought = judgements(self.root)
        ids = holdings.arrays["design_id"]
        rows = {identity: row for identity in thought if (row := self.row_of(identity)) is not None}
        found = representatives.astype("<u4")
        arrays = {
            **holdings.arrays,
            **judged_columns(ids, thought, rows),
            "representative": found,
            "group_size": group_sizes(found),
        }
        arrays = {column.name: arrays[column.name] for column in COLUMNS}
        most = int(arrays["n_maps"].max(initial=2))
        version = version_of(arrays, most)
        self._versions[version] = len(ids)
        return replace(holdings, arrays=arrays, maps_per_row=most, version=version, judged=judged)


def marks_of(rows: Rows, places: Places) -> npt.NDArray[np.float64]:
    """The signatures (n, 6) of some rows."""
    pieces = [np.zeros((0, 6))]
    for start in range(0, len(places), _PIECE):
        pieces.append(row_signatures(rows.take(_MARKS, places[start : start + _PIECE])))
    return np.concatenate(pieces)


def designs_of_parts(root: Path, parts: Sequence[PartName]) -> tuple[Rows, Places]:
    """The rows of some parts, and those that are designs, best first."""
    rows = Rows([(root, part) for part in parts])
    return rows, rows.best_first(rows.standing(ancestors=False))


def _standing(root: Path) -> tuple[list[PartName], Rows, Places]:
    """The parts of a catalogue, their rows, and those that are designs, best first."""

    def read(parts: list[PartName]) -> tuple[list[PartName], Rows, Places]:
        rows, places = designs_of_parts(root, parts)
        if not len(places):
            raise InputError(f"{root}: no designs yet; let a run begin, and look again")
        return parts, rows, places

    return read_of_parts(root, None, read)


def _times_judged(root: Path) -> int:
    return sum(1 for _ in (root / "runs" / "hand").glob("judgement~*.json"))
