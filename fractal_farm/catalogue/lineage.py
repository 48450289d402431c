"""Descent: who came from whom, as far as the manifest tells, which holds kept designs and their ancestors alone.

Parents and children are index arrays over all rows, made once from a few columns; every question is a walk over them
without recursion, so that chains of thousands of generations, and a million rows, are no matter.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue.identities import find_id, id_array
from fractal_farm.catalogue.reader import Catalogue
from fractal_farm.catalogue.schema import KINDS

COLUMNS = (
    "design_id",
    "kind",
    "run_id",
    "operator",
    "island",
    "epoch",
    "generation",
    "n_maps",
    "fitness",
    "gap",
    "parents",
    "symmetry",
)

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Links:
    """From each row to others: those of row i are targets[starts[i]:starts[i + 1]]; -1 is one that is not recorded."""

    starts: IntArray
    targets: IntArray

    def of(self, row: int) -> list[int]:
        """The rows that a row leads to, -1 where one is missing."""
        found: list[int] = self.targets[self.starts[row] : self.starts[row + 1]].tolist()
        return found

    def of_all(self, rows: IntArray) -> IntArray:
        """The rows that any of some rows lead to, each once, without the missing ones."""
        counts = self.starts[rows + 1] - self.starts[rows]
        steps = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        found = np.unique(self.targets[np.repeat(self.starts[rows], counts) + steps])
        return found[found >= 0]


class Lineage:
    """The descent of all rows of a catalogue.

    Attributes:
        table: `COLUMNS` of the kept designs and the ancestors, each once.
        parents: from each row to its parents, in the order of the row.
        children: from each row to its children, in the order of rows.
    """

    def __init__(self, table: Any, root: Path = Path()) -> None:
        """Link rows.

        Args:
            table: with `COLUMNS`, design_ids all different.
            root: the catalogue, for messages.
        """
        self._root = root
        self.table = table.combine_chunks()
        ids = self.table.column("design_id")
        column = self.table.column("parents")
        counts = pc.fill_null(pc.list_value_length(column), 0).to_numpy().astype(np.int64)
        found = pc.index_in(pc.list_flatten(column), value_set=ids.combine_chunks())
        targets = pc.fill_null(found, -1).to_numpy().astype(np.int64)
        self.parents = Links(np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), targets)
        children = np.repeat(np.arange(len(ids)), counts)
        known = targets >= 0
        order = np.argsort(targets[known], kind="stable")
        starts = np.searchsorted(targets[known][order], np.arange(len(ids) + 1))
        self.children = Links(starts.astype(np.int64), children[known][order])

    def __len__(self) -> int:
        return int(self.table.num_rows)

    def find(self, design_id: str) -> int:
        """Row of a design or ancestor.

        Args:
            design_id: 32 hex digits, or the first four or more if no other row begins with them.

        Raises:
            InputError: no such row, or several.
        """
        alike = pc.starts_with(self.table.column("design_id"), design_id.lower()).to_numpy()
        places = np.flatnonzero(alike)
        ids = id_array(self.table.column("design_id").take(pa.array(places)))
        order = np.argsort(ids)
        return int(places[order[find_id(ids[order], design_id, self._root)]])

    def facts(self, rows: Sequence[int] | IntArray) -> list[dict[str, Any]]:
        """Column -> value of some rows."""
        found: list[dict[str, Any]] = self.table.take(pa.array(np.asarray(rows, np.int64))).to_pylist()
        return found

    def walk(self, links: Links, row: int, depth: int | None = None) -> Iterator[tuple[int, IntArray]]:
        """From a row along links, step by step: (steps, rows that so many steps and no fewer lead to)."""
        seen = np.zeros(len(self), bool)
        rows = np.array([row], np.int64)
        steps = 0
        while len(rows):
            yield steps, rows
            if steps == depth:
                return
            seen[rows] = True
            rows = links.of_all(rows)
            rows = rows[~seen[rows]]
            steps += 1

    def reached(self, links: Links, row: int) -> int:
        """How many rows other than itself a row leads to."""
        return sum(len(rows) for _, rows in self.walk(links, row)) - 1

    def common_ancestor(self, first: int, second: int) -> tuple[int, int, int] | None:
        """The ancestor of two rows that is the fewest steps away from both together; a row counts as its own.

        Returns:
            Its row, and the steps from the first and from the second; None if there is none.
        """
        steps = np.full((2, len(self)), -1, np.int64)
        for line, row in enumerate((first, second)):
            for count, rows in self.walk(self.parents, row):
                steps[line, rows] = count
        shared = np.flatnonzero((steps >= 0).all(axis=0))
        if not len(shared):
            return None
        nearest = shared[np.lexsort((shared, steps[:, shared].max(axis=0), steps[:, shared].sum(axis=0)))[0]]
        return int(nearest), int(steps[0, nearest]), int(steps[1, nearest])


def read_lineage(catalogue: Catalogue, run_id: str | None = None) -> Lineage:
    """The descent of a catalogue's designs, or of one run's.

    Raises:
        FarmError: a manifest part is missing or damaged.
    """
    return Lineage(catalogue.designs(COLUMNS, run_id, ancestors=True), catalogue.path)


def is_kept(facts: dict[str, Any]) -> bool:
    """Whether a row is a published design, and not only an ancestor of one."""
    return bool(facts["kind"] == KINDS[0])
