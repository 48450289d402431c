"""Designs of a catalogue found by description: the best of those that are looked at, each with its reasons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fractal_farm.catalogue.reader import Catalogue
from fractal_farm.catalogue.rows import GENOME_COLUMNS, genome_of
from fractal_farm.description import Features, Likeness, checked_description, features_of, likeness
from fractal_farm.ifs.genome import Genome

AMONG = 1_000


@dataclass(frozen=True)
class Found:
    """A design and how well the description fits it."""

    design_id: str
    genome: Genome
    fitness: float
    likeness: Likeness


@dataclass(frozen=True)
class Measured:
    """A design and what was measured of its shape."""

    design_id: str
    genome: Genome
    fitness: float
    features: Features


def find_designs(
    catalogue: Catalogue, description: str, count: int = 10, among: int = AMONG, where: Any = None, names: Any = ()
) -> list[Found]:
    """The designs that a description fits best, best first; see `measured_designs` and `best_of`.

    Raises:
        InputError: a description that is not understood.
        FarmError: a manifest part is missing or damaged.
    """
    checked_description(description)
    return best_of(measured_designs(catalogue, among, where, names), description, count)


def measured_designs(catalogue: Catalogue, among: int = AMONG, where: Any = None, names: Any = ()) -> list[Measured]:
    """The shapes of designs, measured; some ten milliseconds each.

    Args:
        catalogue: where to look.
        among: only the fittest so many.
        where: pyarrow expression that is true of the designs that count; all if None.
        names: columns that the expression refers to.

    Raises:
        FarmError: a manifest part is missing or damaged.
    """
    table, _ = catalogue.select([*GENOME_COLUMNS, "fitness"], where, names, limit=among)
    designs = [(row["design_id"], genome_of(row), float(row["fitness"])) for row in table.to_pylist()]
    return [Measured(identity, genome, fitness, features_of(genome)) for identity, genome, fitness in designs]


def best_of(measured: Sequence[Measured], description: str, count: int) -> list[Found]:
    """The measured designs that a description fits best, best first.

    Raises:
        InputError: a description that is not understood.
    """
    word = checked_description(description)
    found = [Found(each.design_id, each.genome, each.fitness, likeness(each.features, word)) for each in measured]
    return sorted(found, key=lambda each: (-each.likeness.score, each.design_id))[:count]
