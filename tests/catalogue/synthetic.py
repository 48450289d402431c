"""Large catalogues of one made-up run: `python -m tests.catalogue.synthetic DIR DESIGNS [WITH_CLOUDS]`.

Everything in them is as a run writes it, through the writer of the farm: genomes with their ids, maps and
probabilities, parts of 256 designs and 64 ancestors, ledgers of a run's usual size, an event log, an end with its
digest, clouds of the first designs if they are wanted. Scores and descriptors are random numbers.
"""

from __future__ import annotations

import io
import json
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path

import numpy as np
from PIL import Image

from fractal_farm.catalogue import Catalogue, RunWriter, create_run, design_table, record_end
from fractal_farm.config import RunConfig
from fractal_farm.evolution.epoch import EpochRecord, GenerationStatistics, founding_state
from fractal_farm.farm.event_log import log_path
from fractal_farm.farm.events import Progress, RunEnded
from fractal_farm.farm.records import Ledger, pack_ledger
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.quantised_cloud import quantised_attractors

CONFIG = RunConfig.from_dict(
    {
        "name": "synthetic",
        "evolution": {"islands": 1, "phenotype": {"points": 500}},
        "catalogue": {"keep": "accepted", "min_free_gb": 0.1},
    }
)
PART_DESIGNS = 256
PART_ANCESTORS = 64
PART_SECONDS = 10.0
RECORD_NUMBERS = 16_000  # 64 kB, which do not compress


def write(root: Path, designs: int, with_clouds: int = 0, processes: int = 2, seed: int = 0) -> Path:
    """Write a catalogue.

    Args:
        root: its directory, new.
        designs: rows of kind "design"; a quarter as many ancestors are added.
        with_clouds: of them, about so many have their clouds stored; those of the others grow when they are read.
        processes: processes, each with writers of its own.
        seed: another one, other designs.
    """
    Catalogue.create(root)
    create_run(root, CONFIG.run_id, {"config": CONFIG.to_dict()}, "process")
    parts = -(-designs // PART_DESIGNS)
    tasks = [(root, range(k, parts, processes), designs, with_clouds, seed) for k in range(processes)]
    if processes == 1:
        _write_parts(*tasks[0])
    else:
        with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
            list(pool.map(_write_parts, *zip(*tasks, strict=True)))
    _write_log(root, designs)
    end = RunEnded(
        f"{parts} epochs", False, _progress(parts, designs), parts * PART_SECONDS, Catalogue(root).digest(), 0, 0
    )
    record_end(root, CONFIG.run_id, asdict(end), "process")
    picture = io.BytesIO()
    Image.new("RGB", (8, 8)).save(picture, "PNG")
    (root / "catalogue.png").write_bytes(picture.getvalue())
    return root


def _write_parts(root: Path, epochs: range, designs: int, with_clouds: int, seed: int) -> None:
    writers: dict[str, RunWriter] = {}
    for epoch in epochs:
        clouds = "kept" if epoch * PART_DESIGNS < with_clouds else "none"
        if clouds not in writers:
            writers[clouds] = RunWriter(root, CONFIG.run_id, "node", 0, 500, clouds, "process")
        count = min(PART_DESIGNS, designs - epoch * PART_DESIGNS)
        rng = np.random.default_rng([seed, epoch])
        genomes, table = _rows(rng, epoch, count, PART_ANCESTORS)
        grown = quantised_attractors(genomes[:count], 500) if clouds == "kept" else None
        writers[clouds].commit(table, grown, _records(rng, epoch, designs), (epoch, epoch))


def _rows(rng: np.random.Generator, epoch: int, designs: int, ancestors: int):
    count = designs + ancestors
    genes = np.concatenate(
        [
            rng.uniform(-np.pi, np.pi, (count, 3, 3)),
            rng.uniform(0.2, 0.7, (count, 3, 1)),
            rng.uniform(-1, 1, (count, 3, 3)),
        ],
        axis=2,
    )
    genomes = [Genome(rows[: 2 + k % 2]) for k, rows in enumerate(genes)]
    ids = [genome.design_id for genome in genomes]
    fitness = np.concatenate([rng.uniform(0.85, 0.97, designs), rng.uniform(0.6, 0.85, ancestors)])
    design = np.arange(count) < designs
    d0 = rng.uniform(0.8, 1.6, count)
    columns = {
        "kind": np.where(design, "design", "ancestor").tolist(),
        "island": np.zeros(count, np.int16),
        "epoch": np.full(count, epoch),
        "generation": np.full(count, epoch),
        "slot": np.arange(count),
        "d0": d0,
        "d2": d0 * rng.uniform(0.8, 1.0, count),
        "lle": -rng.random(count),
        "fitness": fitness,
        "d0_error": 0.01 * rng.random(count),
        "d2_error": 0.01 * rng.random(count),
        "descriptor": [row if kept else None for row, kept in zip(_descriptors(rng, count), design, strict=True)],
        "similarity_dimension": rng.uniform(1, 3, count),
        "gap": [gap if kept else None for gap, kept in zip(rng.uniform(0, 0.05, count), design, strict=True)],
        "parents": [[ids[designs + k % ancestors]] if k < designs else [] for k in range(count)],
        "operator": ["mutation" if kept else "random" for kept in design],
    }
    return genomes, design_table(genomes, columns)


def _descriptors(rng: np.random.Generator, count: int):
    return np.sort(rng.random((count, 14)), axis=1).astype(np.float32)


def _records(rng: np.random.Generator, epoch: int, designs: int) -> bytes:
    empty = np.zeros(0, np.int32)
    statistics = tuple(GenerationStatistics(epoch, 2000, 1, 900, 600, 320, 0.8, 0.97) for _ in range(5))
    record = EpochRecord(
        0,
        epoch,
        empty,
        founding_state(CONFIG.evolution).library,
        empty,
        empty,
        empty,
        statistics,
        hits=rng.integers(-(1 << 31), 1 << 31, RECORD_NUMBERS, np.int32),
    )
    return pack_ledger(Ledger([record], _progress(epoch + 1, designs), (epoch + 1) * PART_SECONDS))


def _progress(epochs: int, designs: int) -> Progress:
    kept = min(epochs * PART_DESIGNS, designs)
    return Progress(epochs, 10_000 * epochs, 4_500 * epochs, 3_000 * epochs, kept, kept, 0.97, 0.8, 0, kept, 5 * epochs)


def _write_log(root: Path, designs: int) -> None:
    """What `EventLog` would have written: a line for each commit, and samples of the epochs."""
    lines = []
    for epoch in range(-(-designs // PART_DESIGNS)):
        elapsed_s, progress = (epoch + 1) * PART_SECONDS, _progress(epoch + 1, designs)
        at = 1.7e9 + elapsed_s
        told = {"epoch": epoch, "progress": asdict(progress), "elapsed_s": elapsed_s, "rate": 1000.0}
        lines.append({"at": at, "event": "EpochCompleted", **told})
        sizes = {
            "rows": PART_DESIGNS,
            "files": 1,
            "bytes": 200_000,
            "total_files": epoch,
            "total_bytes": 200_000 * epoch,
        }
        told = {"first_epoch": epoch, "last_epoch": epoch, **sizes, "total_designs": progress.designs}
        lines.append({"at": at, "event": "PartCommitted", **told, "epochs": epoch + 1, "elapsed_s": elapsed_s})
    path = log_path(root, CONFIG.run_id)
    path.parent.mkdir(exist_ok=True)
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


if __name__ == "__main__":
    write(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 0)
