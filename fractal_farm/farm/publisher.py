"""The writer's side: complete the rows of designs, grow their clouds, and commit both (DESIGN section 5).

Clouds are grown where they are written and travel nowhere: a genome is small and re-grows its points in microseconds.
"""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue import Catalogue, CommitReceipt, RunWriter, design_table, write_snapshot
from fractal_farm.catalogue.compaction import LARGE_ROWS, Compaction, compact
from fractal_farm.catalogue.fence import writing
from fractal_farm.catalogue.parts import list_parts, read_commits
from fractal_farm.config import RunConfig
from fractal_farm.errors import StorageFullError
from fractal_farm.evolution.designs import ESTIMATES, SCORE_FIELDS, Designs, Operator, genomes_of
from fractal_farm.farm.work import MeshOrder, Part, PartReceipt, fitness_formula, sample_candidates
from fractal_farm.fitness import shape_descriptor
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.quantised_cloud import quantised_attractors
from fractal_farm.ifs.random_iteration import attractor_points
from fractal_farm.ifs.similarity_dimension import similarity_dimension
from fractal_farm.solid.estimate import estimates

MERGE_COMMITS = 256
_SMALL_ROWS = LARGE_ROWS // 4


class Publisher:
    """One writer of a run, for the life of one process, as long as the fence lets it write (`catalogue.fence`)."""

    def __init__(self, root: Path, config: RunConfig, node: str, attempt: int, token: str) -> None:
        self._root = root
        self._token = token
        self._last: tuple[tuple[int, int], CommitReceipt] | None = None
        self._run_id = config.run_id
        self._evolution = config.evolution
        self._phenotype = config.evolution.phenotype.phenotype()
        self._points = config.evolution.phenotype.points
        self._durability = config.catalogue.durability
        self._writer = RunWriter(
            root,
            config.run_id,
            node,
            attempt,
            self._points,
            config.catalogue.clouds,
            self._durability,
            fitness_formula(config.evolution).identity,
        )

    def warm(self) -> None:
        """Compile, or load, what `publish` calls."""
        candidates = sample_candidates(self._evolution)
        if not len(candidates.n_maps):
            return
        genome = candidates.genomes(self._phenotype)[0]
        estimates([genome], [gap(genome)])
        similarity_dimension(genome)
        self._descriptor(genome)
        design_table([genome], {})
        quantised_attractors([genome], self._points)

    def publish(self, part: Part) -> PartReceipt:
        """Make a part durable: clouds first, then the manifest part, whose appearance is the commit.

        Raises:
            StorageFullError: no space left; the same call may be repeated once there is.
            FarmError: the file system failed, or a later session has taken over.
        """
        _, first = np.unique(part.rows["design_id"], return_index=True)
        rows = part.rows[np.sort(first)]
        kept = part.kept[np.sort(first)]
        genomes = genomes_of(rows, self._phenotype)
        designs = [genome for genome, is_kept in zip(genomes, kept, strict=True) if is_kept]
        gaps = [
            (gap(genome) if math.isnan(row["gap"]) else float(row["gap"])) if is_kept else None
            for genome, row, is_kept in zip(genomes, rows, kept, strict=True)
        ]
        columns = _columns(rows) | {
            "kind": ["design" if is_kept else "ancestor" for is_kept in kept],
            "gap": gaps,
            **_estimated(rows, genomes, gaps),
            "distinct": [bool(row["distinct"]) if is_kept else None for row, is_kept in zip(rows, kept, strict=True)],
            "similarity_dimension": [similarity_dimension(genome) for genome in genomes],
            "descriptor": [
                (self._descriptor(genome) if np.isnan(row["descriptor"][0]) else row["descriptor"]) if is_kept else None
                for genome, row, is_kept in zip(genomes, rows, kept, strict=True)
            ],
        }
        epochs = (part.first_epoch, part.last_epoch)
        table, clouds = design_table(genomes, columns), quantised_attractors(designs, self._points)
        with writing(self._root, self._run_id, self._token):
            receipt = self._committed(part, epochs) or self._writer.commit(table, clouds, part.records, epochs)
            self._last = epochs, receipt
            if part.snapshot is not None:
                write_snapshot(self._root, self._run_id, part.last_epoch, part.snapshot, self._durability)
            merged = self._merged(receipt.seq)
        known = {genome.design_id: value for genome, value in zip(genomes, gaps, strict=True) if value is not None}
        files, size = receipt.files + merged.after - merged.before, receipt.bytes + merged.bytes
        return PartReceipt(part.first_epoch, part.last_epoch, len(designs), files, size, known)

    def _descriptor(self, genome: Genome) -> npt.NDArray[np.float32]:
        return shape_descriptor(attractor_points(genome, self._points))

    def _merged(self, seq: int) -> Compaction:
        """From time to time: small parts of this writer become large ones. Without room on the disk they stay."""
        if (seq + 1) % MERGE_COMMITS == 0:
            with contextlib.suppress(StorageFullError):
                return compact(self._root, self._run_id, self._durability, self._writer.name, _SMALL_ROWS)
        return Compaction()

    def store_solid(self, order: MeshOrder, files: dict[str, bytes]) -> None:
        """Put a finished solid into the catalogue; see `publish` for what is raised."""
        with writing(self._root, self._run_id, self._token):
            Catalogue.open(self._root).add_solid(order.genome.design_id, order.parameters.hash, files)

    def _committed(self, part: Part, epochs: tuple[int, int]) -> CommitReceipt | None:
        """The receipt of epochs that are durable already: of a snapshot that found no room, or of a dead writer."""
        if self._last is not None and self._last[0] == epochs:
            return self._last[1]
        for name in list_parts(self._root, self._run_id) if part.again else ():
            for commit in read_commits(self._root, name, records=False):
                if commit.epochs == epochs:
                    written = sum(size for size, _ in commit.files.values())
                    return CommitReceipt(commit.seq, commit.rows, len(commit.files) + 1, written)
        return None


def _estimated(rows: Designs, genomes: list[Genome], gaps: list[float | None]) -> dict[str, list[float]]:
    """Estimates of the solids of what is kept: those that are in the rows, or new ones."""
    known = ~np.isnan(rows["grams"])
    asked = [None if is_known else gap for gap, is_known in zip(gaps, known, strict=True)]
    return {
        name: np.where(known, rows[name], np.array(column, np.float64)).tolist()
        for name, column in estimates(genomes, asked).items()
    }


def _columns(rows: Designs) -> dict[str, Any]:
    """The columns of the manifest that evolution decided."""
    names = (*(name for name in SCORE_FIELDS if name not in ESTIMATES), "island", "epoch", "generation", "slot")
    columns: dict[str, Any] = {name: rows[name] for name in names}
    columns["parents"] = [[parent.decode() for parent in pair if parent] for pair in rows["parents"].tolist()]
    columns["operator"] = [Operator(code).name.lower() for code in rows["operator"].tolist()]
    return columns
