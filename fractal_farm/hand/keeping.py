"""Keeping what was made by hand: genomes become designs of the pseudo-run `hand` (DESIGN section 5, 'Runs').

They have cloud, scores and lineage like any other design; the content digest leaves them out.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fractal_farm.catalogue import Catalogue, RunWriter, design_table, last_epoch, remove_orphans, run_lock
from fractal_farm.catalogue.layout import HAND
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.errors import InputError
from fractal_farm.fitness import Evaluation, FitnessFormula, evaluate
from fractal_farm.hand.breeding import chosen_rows, origin_of
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.quantised_cloud import quantised_attractors
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from fractal_farm.ifs.symmetry import symmetry_code
from fractal_farm.solid.estimate import estimates

OPERATOR = "hand"
SYMMETRY_OPERATOR = "symmetry"
_PATIENCE_SECONDS = 60.0


def keep_symmetric(root: Path, design_id: str, symmetry: str) -> list[dict[str, Any]]:
    """Store a design with another symmetry, as a child of it.

    Args:
        root: the catalogue.
        design_id: of the design, or its first digits.
        symmetry: name of the symmetry; `none` takes one away.

    Returns:
        Its manifest row.

    Raises:
        InputError: no such design or symmetry, or the result is there already.
        StorageFullError: as `keep`.
        FarmError: as `keep`.
    """
    symmetry_code(symmetry, "--symmetry")
    row = Catalogue.open(root).design(design_id)
    return keep(root, [replace(genome_of(row), symmetry=symmetry)], [row["design_id"]], SYMMETRY_OPERATOR)


def keep(
    root: Path, genomes: Sequence[Genome], parents: Sequence[str] = (), operator: str = OPERATOR
) -> list[dict[str, Any]]:
    """Store genomes as designs that somebody made, durably.

    They are scored as the run of the first parent scores, or the latest begun run of the catalogue.

    Args:
        root: the catalogue.
        genomes: valid genomes.
        parents: designs that they were made from, or the first digits of their ids.
        operator: how they were made, for the record.

    Returns:
        Their manifest rows, in order.

    Raises:
        InputError: no such parent, no run in the catalogue, or one of the genomes is there already.
        StorageFullError: no space left; nothing was stored.
        FarmError: the file system failed, or the catalogue is damaged.
    """
    made_from = chosen_rows(root, parents)
    config = origin_of(root, made_from)
    genomes = list(dict.fromkeys(genomes))
    points = config.evolution.phenotype.points
    constants = config.evolution.fitness.model_dump(mode="json")
    scores = evaluate(genomes, points, FitnessFormula(**config.evolution.fitness.model_dump()))
    table = design_table(genomes, _columns(genomes, scores, [row["design_id"] for row in made_from], operator))
    clouds = quantised_attractors(genomes, points)
    with run_lock(root, HAND, _PATIENCE_SECONDS):
        _refuse_known(root, genomes)
        remove_orphans(root, HAND)
        number = last_epoch(root, HAND) + 1
        writer = RunWriter(root, HAND, socket.gethostname(), number, points, config.catalogue.clouds)
        writer.commit(table, clouds, json.dumps({"fitness": constants}).encode(), (number, number))
    catalogue = Catalogue.open(root)
    return [catalogue.design(genome.design_id) for genome in genomes]


def _refuse_known(root: Path, genomes: Sequence[Genome]) -> None:
    known = set(Catalogue.open(root).designs(["design_id"]).column("design_id").to_pylist())
    for genome in genomes:
        if genome.design_id in known:
            raise InputError(f"{root}: design {genome.design_id} is there already; `farm show` it, or change a gene")


def _columns(genomes: Sequence[Genome], scores: Evaluation, parents: list[str], operator: str) -> dict[str, Any]:
    names = ("d0", "d2", "lle", "fitness", "d0_error", "d2_error", "descriptor")
    gaps = [gap(genome) for genome in genomes]
    return {name: getattr(scores, name) for name in names} | {
        "similarity_dimension": [similarity_dimension(genome) for genome in genomes],
        "gap": gaps,
        **estimates(genomes, gaps),
        "parents": [parents] * len(genomes),
        "operator": [operator] * len(genomes),
    }
