"""Whether the disk has room for what a run declares, before anything is started."""

from __future__ import annotations

import math
import os
import shutil
from pathlib import Path

from fractal_farm.config import RunConfig
from fractal_farm.errors import InputError

# Measured: a design of 5,000 points takes 24 kB with its row; a solid of 180 voxels with two formats about 8 MB; one
# core evaluates 2,500 genomes of 5,000 points a second, half of which qualify in an evolved library.
_BYTES_A_POINT = 4.8
_BYTES_A_SOLID = 8e6
_EVALUATIONS_A_CORE = 2500.0
_QUALIFIED_SHARE = 0.5


def check_disk(config: RunConfig, out: Path, written: int = 0) -> None:
    """Refuse a run whose declared budget, less what it has written already, does not fit the disk.

    Raises:
        InputError: too little space, naming what is needed and what would fit.
    """
    place = out.absolute()
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free / 1e9
    kept = config.catalogue.min_free_gb
    needed = max(0.0, expected_gigabytes(config) - written / 1e9)
    if free < kept + needed:
        raise InputError(
            f"catalogue.min_free_gb {kept:g}: {place} has {free:.1f} GB free, and this run needs about {needed:.1f} GB "
            "beyond that; free some space, choose another --out, or lower stop or solids.max"
        )


def expected_gigabytes(config: RunConfig) -> float:
    """A cautious estimate of what the run will write."""
    evolution = config.evolution
    designs = _expected_designs(config)
    solids = designs if config.solids.max is None else min(designs, config.solids.max)
    return (designs * evolution.phenotype.points * _BYTES_A_POINT + solids * _BYTES_A_SOLID) / 1e9


def _expected_designs(config: RunConfig) -> float:
    evolution, stop = config.evolution, config.stop
    generation = evolution.offspring if evolution.offspring is not None else 2 * (evolution.accepted or 1)
    limits: list[float] = []
    if stop.epochs is not None:
        generations = stop.epochs * evolution.generations_per_epoch
        limits.append(evolution.islands * (evolution.library.size + generations * generation))
    if stop.evaluations is not None:
        limits.append(stop.evaluations)
    if stop.hours is not None:
        cores = config.execution.workers or os.cpu_count() or 1
        limits.append(3600.0 * stop.hours * cores * _EVALUATIONS_A_CORE * 5000 / evolution.phenotype.points)
    evaluations = min(limits, default=0.0)
    if evolution.library.growth == "append":
        return evaluations * _QUALIFIED_SHARE
    # Only what is among the best of its island is kept: record values of n draws come ln n times.
    libraries = evolution.islands * evolution.library.size
    best = libraries * (1.0 + 10.0 * math.log1p(evaluations / libraries))
    return min(evaluations * _QUALIFIED_SHARE, best)
