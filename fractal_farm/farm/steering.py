"""Steering a run: what a request means to its islands (DESIGN section 5, 'Runs').

Each island gets the chosen designs with the inboxes of all epochs of the request, as it gets migrants. In the first of
them they are born, on island 0 like the seeds of a run, in places before those of the candidates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fractal_farm.catalogue.steering import SteeringRequest
from fractal_farm.config import EvolutionConfig
from fractal_farm.errors import InputError
from fractal_farm.evolution.designs import Designs, Operator
from fractal_farm.evolution.epoch import founding_state
from fractal_farm.evolution.offspring import max_maps
from fractal_farm.farm.schedule import Schedule
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.symmetry import symmetry_codes


def take_in(schedule: Schedule, requests: Sequence[SteeringRequest], config: EvolutionConfig) -> None:
    """Let a schedule follow requests, in their order."""
    for request in requests:
        before = sum(len(designs) for first, _, designs in schedule.steering if first == request.first)
        schedule.steer(request.first, request.last, _rows(request, config, before))


def check_steerable(genomes: Sequence[Genome], config: EvolutionConfig, run_id: str) -> None:
    """Refuse designs that a run cannot breed from.

    Raises:
        InputError: a search at random, another phenotype, more maps than the run's rows have room for, or
            probabilities set by hand.
    """
    if config.method == "random":
        raise InputError(f"run {run_id}: evolution.method random breeds from nothing; breed a new run instead")
    for genome in genomes:
        check_breedable(genome)
        if genome.phenotype != config.phenotype.phenotype():
            raise InputError(f"design {genome.design_id}: its phenotype is not that of run {run_id}; breed a new run")
        if genome.n_maps > max_maps(config):
            raise InputError(
                f"design {genome.design_id} has {genome.n_maps} maps; run {run_id} has room for {max_maps(config)}, "
                "breed a new run instead"
            )


def check_breedable(genome: Genome) -> None:
    """Refuse a genome whose probabilities its children could not inherit, with an `InputError`."""
    if genome.probabilities is not None:
        raise InputError(
            f"design {genome.design_id}: its probabilities were set by hand, and children do not inherit them; keep "
            "a variant without them"
        )


def _rows(request: SteeringRequest, config: EvolutionConfig, before: int) -> Designs:
    """The designs of a request without their scores; `before` designs of others are born in the same epoch."""
    rows = np.zeros(len(request.design_ids), founding_state(config).library.dtype)
    rows["symmetry"] = symmetry_codes(request.symmetries)
    for row, identity, genes in zip(rows, request.design_ids, request.genes, strict=True):
        row["design_id"] = identity.encode()
        row["genes"][: len(genes)] = genes
        row["n_maps"] = len(genes)
    rows["operator"] = Operator.SEED
    rows["epoch"] = request.first
    rows["generation"] = request.first * config.generations_per_epoch + 1
    rows["slot"] = -1 - before - np.arange(len(rows))
    return rows
