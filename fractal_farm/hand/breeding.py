"""Breeding by hand: a run whose founders are designs that somebody chose (the paper's 'until the user is satisfied').

The run takes phenotype and fitness from the run that the designs come from. It has one generation, whose designs are
children of the chosen ones and resemble them: mutations are small, and the gates that candidates pass are as wide as
the parents need. A typical child lies 3.5 units of the signature (`distinctness`) from its nearest founder, where
unrelated designs lie 7 apart. After four generations there is no likeness left: so one chooses among the children, and
breeds again.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fractal_farm.catalogue import Catalogue, judgements
from fractal_farm.catalogue.layout import HAND
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.catalogue.settings import read_settings
from fractal_farm.config import EvolutionConfig, RunConfig
from fractal_farm.errors import InputError
from fractal_farm.farm.steering import check_breedable
from fractal_farm.farm.stopping import chosen_run
from fractal_farm.ifs.genome import MAX_MAPS, ROW_LENGTH, Genome
from fractal_farm.ifs.symmetry import NO_SYMMETRY, symmetry_codes

_SETTING = {
    "method": "niches",
    "islands": 4,
    "generations_per_epoch": 1,
    "offspring": 256,
    "accepted": None,
}
_MUTATION = {"probabilities": (0.15, 0.5), "sigmas": (0.02, 0.05, 0.1)}
_WIDER = 1.05  # a gap that parents have, and their children may have


@dataclass(frozen=True)
class Founders:
    """Chosen designs, in order of their ids.

    Attributes:
        design_ids: 32 hex digits each.
        genomes: theirs, all of one phenotype.
        config: of the run that the first of them comes from.
        fitness: by that run's constants.
        gap: of each.
        expected_fitness: that closed forms foresee of each; empty for affine genomes.
        similarity_dimension: likewise.
    """

    design_ids: tuple[str, ...]
    genomes: tuple[Genome, ...]
    config: RunConfig
    fitness: tuple[float, ...]
    gap: tuple[float, ...]
    expected_fitness: tuple[float, ...]
    similarity_dimension: tuple[float, ...]

    def lowered(self, config: RunConfig) -> list[tuple[str, float, float]]:
        """(name, before, now) of the gates that a bred run has wider than the run that its founders come from."""
        old, new = self.config.evolution, config.evolution
        gates = [("qualified", old.qualified, new.qualified), ("niches.gap", old.niches.gap, new.niches.gap)]
        return [gate for gate in gates if gate[1] != gate[2]]


def favourites(root: Path) -> list[str]:
    """The ids of a catalogue's favourites, in order.

    Raises:
        InputError: there are none.
    """
    found = sorted(identity for identity, judgement in judgements(root).items() if judgement.favourite)
    if not found:
        raise InputError(f"{root}: no favourites; choose some with `farm rate {root} ID --favourite`")
    return found


def chosen_rows(root: Path, ids: Sequence[str]) -> list[dict[str, Any]]:
    """The manifest rows of designs, each once, in order of their ids; see `Catalogue.design` for what is raised."""
    catalogue = Catalogue.open(root)
    rows = {row["design_id"]: row for row in map(catalogue.design, ids)}
    return [rows[identity] for identity in sorted(rows)]


def origin_of(root: Path, rows: Sequence[dict[str, Any]]) -> RunConfig:
    """The configuration of the run that the first of some designs comes from; the latest begun for hand-made ones.

    Raises:
        InputError: no run in the catalogue.
        FarmError: its record is damaged.
    """
    run_id = next((row["run_id"] for row in rows if row["run_id"] != HAND), None) or chosen_run(root, None)
    return RunConfig.from_dict(read_settings(root, run_id), f"{root}: run.json")


def founders_of(root: Path, ids: Sequence[str]) -> Founders:
    """Look at designs that somebody wants to breed from, and score them by the constants of their run.

    Args:
        root: directory of the catalogue.
        ids: designs, or the first digits of their ids.

    Raises:
        InputError: no such design, different phenotypes, or probabilities set by hand.
        FarmError: a part or a record is damaged.
    """
    from fractal_farm.fitness import FitnessFormula, evaluate, foresee
    from fractal_farm.ifs.gap import gap

    rows = chosen_rows(root, ids)
    config = origin_of(root, rows)
    genomes = [genome_of(row) for row in rows]
    phenotype = config.evolution.phenotype.phenotype()
    for genome in genomes:
        check_breedable(genome)
        if genome.phenotype != phenotype:
            raise InputError(
                f"design {genome.design_id}: its phenotype is not that of run {config.run_id}; breed designs of one "
                "phenotype"
            )
    formula = FitnessFormula(**config.evolution.fitness.model_dump())
    scores = evaluate(genomes, config.evolution.phenotype.points, formula)
    foreseen: list[tuple[float, ...]] = [(), ()]
    if config.evolution.foreseeable:
        padded = np.zeros((len(genomes), MAX_MAPS, ROW_LENGTH[phenotype.family]))
        for row, genome in zip(padded, genomes, strict=True):
            row[: genome.n_maps] = genome.genes
        counts = np.array([genome.n_maps for genome in genomes])
        codes = symmetry_codes(genome.symmetry for genome in genomes)
        found = foresee(padded, counts, phenotype, formula, symmetries=codes)
        foreseen = [tuple(found.fitness.tolist()), tuple(found.d0.tolist())]
    return Founders(
        tuple(genome.design_id for genome in genomes),
        tuple(genomes),
        config,
        tuple(scores.fitness.tolist()),
        tuple(map(gap, genomes)),
        *foreseen,
    )


def breeding_config(founders: Founders, overrides: Sequence[str] = ()) -> RunConfig:
    """The configuration of the run that breeds from some designs: a function of them and the overrides alone.

    Args:
        founders: the parents; none of the candidates comes from elsewhere.
        overrides: `section.field=value`.

    Raises:
        InputError: an override that does not fit.
    """
    base = founders.config
    counts = Counter(genome.n_maps for genome in founders.genomes)
    seeds = [genome.genes.tolist() for genome in founders.genomes]
    symmetries = [genome.symmetry for genome in founders.genomes]
    if set(symmetries) == {NO_SYMMETRY}:
        symmetries = []
    if len(seeds) == 1:
        symmetries *= 2
        seeds *= 2  # a library has at least two members; the second is turned away
    evolution = {
        **base.evolution.model_dump(mode="json"),
        **_SETTING,
        "library": {
            "size": len(seeds),
            "seeds": seeds,
            "seed_symmetries": symmetries,
            "map_counts": {maps: number / len(founders.genomes) for maps, number in sorted(counts.items())},
        },
        "migration": {"emigrants": min(5, len(seeds))},
        **_gates(founders, base.evolution),
    }
    values = {
        "name": f"{base.name[:58]}-bred",
        "evolution": evolution,
        "stop": {"epochs": 1},
        "catalogue": {"durability": base.catalogue.durability, "min_free_gb": base.catalogue.min_free_gb},
        "solids": {**base.solids.model_dump(mode="json"), "max": 0},
    }
    return RunConfig.from_dict(values, "the bred run", overrides)


def _gates(founders: Founders, evolution: EvolutionConfig) -> dict[str, Any]:
    """What candidates must reach: as the run had it, or less if a founder would not reach it."""
    least = min(founders.fitness)
    qualified = evolution.qualified if least > evolution.qualified else _just_below(least)
    niches = evolution.niches.model_dump(mode="json") | _MUTATION | {"fullness": None}  # who is chosen is full enough
    niches["gap"] = min(0.999, max(evolution.niches.gap, *(_WIDER * gap for gap in founders.gap)))
    bounds = evolution.similarity_dimension
    if founders.expected_fitness and (asked := evolution.niches.expected_fitness) is not None:
        expected = min(founders.expected_fitness)
        niches["expected_fitness"] = asked if expected > asked else _just_below(expected)
    if founders.similarity_dimension and bounds is not None:
        low = math.floor(10.0 * min(founders.similarity_dimension)) / 10.0
        high = math.ceil(10.0 * max(founders.similarity_dimension)) / 10.0
        bounds = (min(bounds[0], low), max(bounds[1], min(high, 10.0)))
    return {
        "qualified": qualified,
        "elimination": min(evolution.elimination, qualified),
        "niches": niches,
        "similarity_dimension": bounds,
    }


def _just_below(fitness: float) -> float:
    """A threshold of two decimals that this fitness clearly exceeds."""
    return max(0.0, math.floor(100.0 * fitness - 1.0) / 100.0)
