"""What a run will write, and whether the disk has room for it, before anything is started.

The figures are bounds: what was measured, with room above it. A run that comes near the end of the disk all the same
waits (`farm.room`), so what is promised is kept.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from fractal_farm.config import RunConfig
from fractal_farm.errors import InputError

# Measured: a design takes 4.1 bytes a point, 330 bytes a row and 230 in its island's record, and one to two rows of
# ancestors come with it; a solid of 180 voxels with two formats takes 2 to 8 MB; the picture and the report 2 MB.
_BYTES_A_POINT = 4.4
_BYTES_A_ROW = 600.0
_ROWS_A_DESIGN = 3.0
_BYTES_A_SOLID = 8e6
_BYTES_A_MEMBER = 250.0
_SNAPSHOTS = 3
_BYTES_OF_PAGES = 4e6
_BYTES_OF_LOGS_AN_HOUR = 2e6
# Measured: so many candidates are evaluated on one core in a second, at 5,000 points, at most; niches look at gaps.
_EVALUATIONS_A_CORE = {"niches": 800.0}
_MOST_EVALUATIONS_A_CORE = 2500.0
# Of n candidates at most 7 n^0.75 are distinct. On one island 4,440 of 7,574 and 9,887 of 20,380 were; on eight,
# which hear of each other late, 7,265 of 20,911, and 36,705 of 157,789.
_DISTINCT, _EXPONENT = 7.0, 0.75
_MINUTES = 0.1  # share of the first hour's bound within which a run that begins must find room


@dataclass(frozen=True)
class DiskNeed:
    """What a run writes at most.

    Attributes:
        first_hour: bytes in its first hour.
        whole: bytes in all; None for a run without a limit.
    """

    first_hour: float
    whole: float | None


def check_disk(config: RunConfig, out: Path, written: int = 0) -> None:
    """Refuse a run that may fill the disk within minutes, unless it is told to fill it (`min_free_gb` 0).

    What is foreseen is a bound, and a run waits at `min_free_gb` anyway: one that lasts for a while may begin.

    Raises:
        InputError: too little space, naming what is needed and what would fit.
    """
    place = out.absolute()
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free / 1e9
    kept = config.catalogue.min_free_gb
    need = disk_need(config)
    needed = need.first_hour * _MINUTES
    if need.whole is not None:
        needed = min(needed, max(0.0, need.whole - written))
    if kept > 0.0 and free < kept + needed / 1e9:
        raise InputError(
            f"catalogue.min_free_gb {kept:g}: {place} has {free:.1f} GB free, and this run may write "
            f"{needed / 1e9:.1f} GB beyond that in minutes; free some space, choose another --out, or lower "
            "stop or solids.max"
        )


def disk_need(config: RunConfig, workers: int | None = None) -> DiskNeed:
    """The most that a run will write.

    Args:
        config: the run's configuration.
        workers: cores that work on it; those of this machine if None.
    """
    stop, cores = config.stop, workers or config.execution.workers or os.cpu_count() or 1
    an_hour = _evaluations_an_hour(config, cores)
    limits = [stop.hours * an_hour] if stop.hours is not None else []
    if stop.epochs is not None:
        limits.append(_evaluations_in_epochs(config, stop.epochs))
    if stop.evaluations is not None:
        limits.append(stop.evaluations + _evaluations_in_epochs(config, 1))
    designs = [_designs_of(config, evaluations) for evaluations in limits]
    for wanted in (stop.qualified, stop.distinct):
        if wanted is not None:
            designs.append(wanted + _designs_of(config, _evaluations_in_epochs(config, 1)))
    hours = max(1.0, stop.hours or 0.0)
    first = min([_designs_of(config, an_hour), *designs])
    return DiskNeed(_bytes_of(config, first, 1.0), _bytes_of(config, min(designs), hours) if designs else None)


def _evaluations_an_hour(config: RunConfig, cores: int) -> float:
    rate = _EVALUATIONS_A_CORE.get(config.evolution.method, _MOST_EVALUATIONS_A_CORE)
    return 3600.0 * cores * rate * 5000 / config.evolution.phenotype.points


def _evaluations_in_epochs(config: RunConfig, epochs: int) -> float:
    """Every candidate, and the founders; `accepted` may take some candidates for one."""
    evolution = config.evolution
    generation = evolution.offspring if evolution.offspring is not None else 8 * (evolution.accepted or 1)
    return evolution.islands * (evolution.library.size + epochs * evolution.generations_per_epoch * generation)


def _designs_of(config: RunConfig, evaluations: float) -> float:
    """How many designs are published of so many candidates, at most."""
    if config.evolution.method != "niches" and config.catalogue.keep != "distinct":
        return evaluations
    distinct: float = _DISTINCT * evaluations**_EXPONENT
    return min(evaluations, distinct if config.catalogue.keep == "distinct" else 3 * distinct)


def _bytes_of(config: RunConfig, designs: float, hours: float) -> float:
    evolution = config.evolution
    solids = designs if config.solids.max is None else min(designs, config.solids.max)
    founders = evolution.islands * evolution.library.size
    capacity = evolution.islands * evolution.niches.capacity if evolution.method == "niches" else founders
    members = min(capacity, _ROWS_A_DESIGN * designs + founders)
    return (
        designs * (evolution.phenotype.points * _BYTES_A_POINT + _ROWS_A_DESIGN * _BYTES_A_ROW)
        + solids * _BYTES_A_SOLID
        + _SNAPSHOTS * members * _BYTES_A_MEMBER
        + _BYTES_OF_PAGES
        + hours * _BYTES_OF_LOGS_AN_HOUR
    )
