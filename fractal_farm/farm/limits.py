"""What a run counts, and when that ends it (DESIGN section 4): pure functions of the configuration and the totals."""

from __future__ import annotations

from fractal_farm.config import RunConfig
from fractal_farm.evolution.designs import Designs
from fractal_farm.evolution.epoch import EpochRecord
from fractal_farm.farm.events import Progress

STALL_SECONDS = 600.0
_SECONDS_A_POINT = 4e-7  # a slow evaluation: 2 ms for 5,000 points
_SLOTS_FOR_ONE = 4  # slots that one accepted offspring costs, at most, as a rule


def kept(config: RunConfig, rows: Designs) -> Designs:
    """(rows,) bool: which designs are published."""
    if config.catalogue.keep == "accepted":
        return rows["fitness"] >= config.evolution.elimination
    if config.catalogue.keep == "distinct":
        return rows["distinct"]
    return rows["fitness"] > config.evolution.qualified


def totals_after(config: RunConfig, before: Progress, records: list[EpochRecord]) -> Progress:
    """The totals after one more epoch of all islands."""
    entries = [entry for record in records for entry in record.statistics]
    last = [record.statistics[-1] for record in records]
    accepted = sum(entry.accepted for entry in last)
    return Progress(
        epochs=before.epochs + 1,
        evaluated=before.evaluated + sum(entry.evaluated for entry in entries),
        accepted=before.accepted + sum(entry.accepted for entry in entries),
        qualified=before.qualified + sum(entry.qualified for entry in entries),
        designs=before.designs + sum(int(kept(config, record.born).sum()) for record in records),
        kept_qualified=before.kept_qualified
        + sum(
            int((kept(config, record.born) & (record.born["fitness"] > config.evolution.qualified)).sum())
            for record in records
        ),
        best_fitness=max(entry.best for entry in last),
        mean_accepted=sum(entry.mean_accepted * entry.accepted for entry in last) / max(accepted, 1),
        settled=before.settled + sum(record.settled for record in records),
        distinct=before.distinct + sum(int(record.born["distinct"].sum()) for record in records),
        refused=before.refused + sum(entry.refused for entry in entries),
    )


def reached(config: RunConfig, progress: Progress) -> str | None:
    """Which counting limit is reached; tested on complete epochs alone: the same epoch for any order of work."""
    stop = config.stop
    limits = (
        ("epochs", stop.epochs, progress.epochs),
        ("evaluations", stop.evaluations, progress.evaluated),
        ("qualified designs", stop.qualified, progress.kept_qualified),
        ("distinct designs", stop.distinct, progress.distinct),
    )
    for name, limit, value in limits:
        if limit is not None and value >= limit:
            return f"{value} {name}"
    return None


def fraction_done(config: RunConfig, progress: Progress, elapsed_s: float) -> float:
    """How far the run is on its way to the nearest limit; 1 if there is none."""
    stop = config.stop
    shares = [
        value / limit
        for limit, value in (
            (stop.epochs, progress.epochs),
            (stop.evaluations, progress.evaluated),
            (stop.qualified, progress.kept_qualified),
            (stop.distinct, progress.distinct),
            (stop.hours, elapsed_s / 3600.0),
        )
        if limit is not None
    ]
    return max(shares) if shares else 1.0


def patience_s(config: RunConfig, workers: int) -> float:
    """How long nothing may finish: many times what an epoch of all islands can take."""
    evolution = config.evolution
    generation = evolution.offspring or _SLOTS_FOR_ONE * (evolution.accepted or 1)
    genomes = evolution.islands * (evolution.library.size + evolution.generations_per_epoch * generation)
    return max(STALL_SECONDS, 10.0 * genomes * _SECONDS_A_POINT * evolution.phenotype.points / workers)
