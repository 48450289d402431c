"""Two designs side by side: their maps in pairs, their scores with the chance in them, and how far apart they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue.formula import formula_of_row
from fractal_farm.catalogue.lineage import read_lineage
from fractal_farm.catalogue.reader import Catalogue
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.distinctness import DESCRIPTOR_LENGTH, signatures
from fractal_farm.fitness import evaluate
from fractal_farm.fitness.evaluation import POINTS
from fractal_farm.ifs.genome import GENE_NAMES, Genome
from fractal_farm.ifs.maps import resolved_maps, selection_probabilities
from fractal_farm.ifs.random_iteration import attractor_points
from fractal_farm.likeness import aligned_distance

CLOUDS = 20  # of each design, to tell a difference from chance

SCORES = ("fitness", "d0", "d2", "lle")
_MAP_NAMES = ("a11", "a12", "a13", "b1", "a21", "a22", "a23", "b2", "a31", "a32", "a33", "b3")


@dataclass(frozen=True)
class Score:
    """A score of two designs.

    Attributes:
        name: fitness, d0, d2 or lle.
        recorded: as the manifest has them.
        means: over `CLOUDS` clouds each.
        errors: standard errors of the means.
    """

    name: str
    recorded: tuple[float, float]
    means: tuple[float, float]
    errors: tuple[float, float]

    @property
    def deviations(self) -> float:
        """Difference of the means, second less first, in its standard errors; nan if both have none."""
        error = float(np.hypot(*self.errors))
        return (self.means[1] - self.means[0]) / error if error > 0.0 else float("nan")


@dataclass(frozen=True)
class Comparison:
    """What two designs have in common, and what not.

    Attributes:
        rows: of the manifest.
        numbers: names of a map's numbers: genes, or the entries of [A | b] where the families differ.
        maps: pairs of maps, (P and numbers) each; None where a design has no map to match.
        scores: with the chance in them.
        distance: of the signatures, in units of what makes two designs distinct; nan without descriptors.
        aligned_distance: of the clouds, see `likeness.aligned_distance`.
        common_ancestor: its design_id and the steps to it from both; None if there is none on record.
    """

    rows: tuple[dict[str, Any], dict[str, Any]]
    numbers: tuple[str, ...]
    maps: list[tuple[list[float] | None, list[float] | None]]
    scores: list[Score]
    distance: float
    aligned_distance: float
    common_ancestor: tuple[str, int, int] | None


def compared(catalogue: Catalogue, first: str, second: str) -> Comparison:
    """Compare two designs.

    Args:
        catalogue: that holds them.
        first: design id, or its first digits.
        second: the same.

    Raises:
        InputError: no such design, or several.
        FarmError: a manifest part is missing or damaged.
    """
    rows = catalogue.design(first), catalogue.design(second)
    one, two = (genome_of(row) for row in rows)
    lineage = read_lineage(catalogue)
    found = lineage.common_ancestor(*(lineage.find(row["design_id"]) for row in rows))
    ancestor = None
    if found is not None:
        (facts,) = lineage.facts([found[0]])
        ancestor = facts["design_id"], found[1], found[2]
    marks = [_signature(row) for row in rows]
    clouds = [attractor_points(genome, POINTS) for genome in (one, two)]
    alike = one.phenotype.family == two.phenotype.family == "similarity"
    return Comparison(
        rows,
        GENE_NAMES if alike else _MAP_NAMES,
        _paired(one, two, alike),
        _scores(catalogue, rows, (one, two)),
        float(np.sqrt(np.square(marks[0] - marks[1]).sum())),
        aligned_distance(*clouds),
        ancestor,
    )


def _signature(row: Mapping[str, Any]) -> npt.NDArray[np.float64]:
    descriptor = row["descriptor"] if row["descriptor"] is not None else np.full(DESCRIPTOR_LENGTH, np.nan)
    marks = signatures([descriptor], [row["d0"]], [row["d2"]])
    return marks.ravel()


def _scores(catalogue: Catalogue, rows: tuple[dict[str, Any], ...], genomes: tuple[Genome, Genome]) -> list[Score]:
    results = []
    for row, genome in zip(rows, genomes, strict=True):
        formula = formula_of_row(catalogue.path, row)
        results.append(evaluate([genome], row["n_points"] or POINTS, formula, repeats=CLOUDS))

    def pair(name: str) -> tuple[float, float]:
        one, two = (float(getattr(result, name)[0]) for result in results)
        return one, two

    return [Score(name, (rows[0][name], rows[1][name]), pair(name), pair(f"{name}_error")) for name in SCORES]


def _paired(one: Genome, two: Genome, genes: bool) -> list[tuple[list[float] | None, list[float] | None]]:
    """The maps of the first genome in canonical order, each with the map of the second that it resembles most."""
    from scipy.optimize import linear_sum_assignment

    tables = [_numbers(genome, genes) for genome in (one, two)]
    maps = [
        resolved_maps(genome).reshape(genome.n_maps, -1)[order]
        for genome, (order, _) in zip((one, two), tables, strict=True)
    ]
    costs = np.square(maps[0][:, None] - maps[1][None]).sum(axis=2)
    partner = dict(zip(*(side.tolist() for side in linear_sum_assignment(costs)), strict=True))
    pairs: list[tuple[list[float] | None, list[float] | None]] = []
    for row, numbers in enumerate(tables[0][1]):
        pairs.append((numbers, tables[1][1][partner[row]] if row in partner else None))
    matched = set(partner.values())
    return pairs + [(None, numbers) for row, numbers in enumerate(tables[1][1]) if row not in matched]


def _numbers(genome: Genome, genes: bool) -> tuple[list[int], list[list[float]]]:
    """Canonical order of a genome's rows, and P and the numbers of each map in that order."""
    order = sorted(range(genome.n_maps), key=lambda row: genome.genes[row].tolist())
    table = genome.genes if genes else resolved_maps(genome).reshape(genome.n_maps, -1)
    probabilities = selection_probabilities(genome)
    return order, [[float(probabilities[row]), *table[row].tolist()] for row in order]
