"""Which designs and which operators led on, counted over what the manifest holds.

That is the published designs, and ancestors of theirs that were not published themselves. Candidates that came to
nothing left no row, so that these are counts of successes, not rates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pyarrow.compute as pc

from fractal_farm.catalogue.lineage import Lineage
from fractal_farm.catalogue.schema import KINDS


@dataclass(frozen=True)
class OperatorYield:
    """What came of an operator, for one number of maps.

    Attributes:
        operator: its name.
        n_maps: number of maps of the designs.
        published: kept designs that it made.
        ancestors: rows beside them: not kept, but parents, or their parents, of kept ones.
        mean_fitness: of the published.
        gain: mean of fitness less that of the fitter parent, over the published with a parent on record; nan if none.
        printable: share of the published with a gap of at most the limit.
        fertile: share of the published that are parents of another row.
    """

    operator: str
    n_maps: int
    published: int
    ancestors: int
    mean_fitness: float
    gain: float
    printable: float
    fertile: float


@dataclass(frozen=True)
class Ancestor:
    """A design and what came of it.

    Attributes:
        row: of the lineage.
        children: published designs that name it as a parent.
        descendants: published designs that come from it, children included.
        mean_fitness: of the children.
        printable: share of the children with a gap of at most the limit.
    """

    row: int
    children: int
    descendants: int
    mean_fitness: float
    printable: float


def operator_yields(lineage: Lineage, gap: float) -> list[OperatorYield]:
    """What came of each operator and number of maps, those with most published designs first.

    Args:
        lineage: of the catalogue.
        gap: the largest that counts as printable, over the longest side.
    """
    table = lineage.table
    encoded = pc.fill_null(table.column("operator"), "unknown").combine_chunks().dictionary_encode()
    operators, names = encoded.indices.to_numpy(), encoded.dictionary.to_pylist()
    n_maps = table.column("n_maps").to_numpy()
    kept, fitness, printable = _judged(lineage, gap)
    gains = _gains(lineage, fitness)
    fertile = np.diff(lineage.children.starts) > 0
    yields = []
    for number, name in enumerate(names):
        for count in np.unique(n_maps[operators == number]).tolist():
            group = (operators == number) & (n_maps == count)
            mine = group & kept
            published = int(mine.sum())
            yields.append(
                OperatorYield(
                    name,
                    count,
                    published,
                    int(group.sum()) - published,
                    _mean(fitness[mine]),
                    _mean(gains[mine & np.isfinite(gains)]),
                    _mean(printable[mine]),
                    _mean(fertile[mine]),
                )
            )
    return sorted(yields, key=lambda entry: (-entry.published, entry.operator, entry.n_maps))


def most_fertile(lineage: Lineage, count: int, gap: float) -> list[Ancestor]:
    """The rows with most published children, of equal ones in the order of rows.

    Args:
        lineage: of the catalogue.
        count: how many.
        gap: the largest that counts as printable, over the longest side.
    """
    kept, fitness, printable = _judged(lineage, gap)
    children = lineage.children
    parents = np.repeat(np.arange(len(lineage)), np.diff(children.starts))
    distinct = np.ones(len(parents), bool)  # a design that is both parents of a child has one child
    distinct[1:] = (parents[1:] != parents[:-1]) | (children.targets[1:] != children.targets[:-1])
    litters = np.bincount(parents[distinct & kept[children.targets]], minlength=len(lineage))
    best = [row for row in np.argsort(-litters, kind="stable")[:count].tolist() if litters[row]]
    found = []
    for row in best:
        litter = children.of_all(np.array([row]))
        litter = litter[kept[litter]]
        line = np.concatenate([rows for steps, rows in lineage.walk(children, row) if steps])
        found.append(
            Ancestor(row, len(litter), int(kept[line].sum()), _mean(fitness[litter]), _mean(printable[litter]))
        )
    return found


def _judged(
    lineage: Lineage, gap: float
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Of each row: whether it is published, its fitness, whether it is printable."""
    kept = np.asarray(pc.equal(lineage.table.column("kind"), KINDS[0]).to_numpy(), bool)
    gaps = lineage.table.column("gap").to_numpy()
    return kept, lineage.table.column("fitness").to_numpy(), gaps <= gap


def _gains(lineage: Lineage, fitness: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Fitness less that of the fitter parent, nan without one."""
    children = np.repeat(np.arange(len(lineage)), np.diff(lineage.parents.starts))
    known = lineage.parents.targets >= 0
    best = np.full(len(lineage), -np.inf)
    np.maximum.at(best, children[known], fitness[lineage.parents.targets[known]])
    return np.where(np.isfinite(best), fitness - best, np.nan)


def _mean(values: npt.NDArray[np.floating] | npt.NDArray[np.bool_]) -> float:
    return float(values.mean()) if len(values) else float("nan")
