"""Known designs for the catalogue's tests: each is a function of its number alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fractal_farm.catalogue import RunWriter, design_table
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.quantised_cloud import QuantisedClouds, quantised_attractors

RUN = "0123456789abcdef"
N_POINTS = 32
BORN_IN_AN_EPOCH = 8
OPERATORS = ["random", "crossover", "mutation", "crossover+mutation"]


def genome(number: int) -> Genome:
    """Two or three similarities, by number."""
    rng = np.random.default_rng(number)
    n_maps = 2 + number % 2
    angles = rng.uniform(-np.pi, np.pi, (n_maps, 3))
    return Genome(np.hstack([angles, rng.uniform(0.3, 0.8, (n_maps, 1)), rng.uniform(-2, 2, (n_maps, 3))]))


def designs(numbers: Sequence[int], **changes: Any) -> tuple[Any, QuantisedClouds]:
    """The table and the clouds of designs, by their numbers; `changes` replaces columns."""
    scores = np.array([np.random.default_rng([7, number]).random(20) for number in numbers]).reshape(-1, 20)
    columns = {
        "island": [number % 3 for number in numbers],
        "epoch": [number // BORN_IN_AN_EPOCH for number in numbers],
        "generation": [number // 4 for number in numbers],
        "slot": [number % 4 for number in numbers],
        "d0": 3 * scores[:, 0],
        "d2": 3 * scores[:, 1],
        "lle": -scores[:, 2],
        "fitness": scores[:, 3],
        "d0_error": scores[:, 4],
        "d2_error": scores[:, 5],
        "descriptor": scores[:, 6:].astype(np.float32),
        "similarity_dimension": 3 * scores[:, 0],
        "gap": scores[:, 1],
        "parents": [[genome(parent).design_id for parent in range(number % 3)] for number in numbers],
        "operator": [OPERATORS[number % 4] for number in numbers],
    }
    genomes = [genome(number) for number in numbers]
    return design_table(genomes, columns | changes), quantised_attractors(genomes, N_POINTS)


def writer(root: Path, attempt: int = 0, **options: Any) -> RunWriter:
    """A writer of the test run, without fsync unless asked for."""
    given = {"run_id": RUN, "node": "node", "n_points": N_POINTS, "durability": "process"} | options
    return RunWriter(root, attempt=attempt, **given)


def records(epoch: int) -> bytes:
    """The islands' records of an epoch."""
    return np.random.default_rng([9, epoch]).bytes(500)


def commit_epochs(root: Path, first: int, last: int, **options: Any) -> RunWriter:
    """Commit the designs of whole epochs, one part each."""
    used = writer(root, **options)
    for epoch in range(first, last + 1):
        numbers = range(epoch * BORN_IN_AN_EPOCH, (epoch + 1) * BORN_IN_AN_EPOCH)
        used.commit(*designs(numbers), records(epoch), (epoch, epoch))
    return used


def files(root: Path) -> dict[str, int]:
    """All files below a directory: relative path -> size."""
    return {path.relative_to(root).as_posix(): path.stat().st_size for path in root.rglob("*") if path.is_file()}
