"""The writer's side: complete the rows of designs, grow their clouds, and commit both (DESIGN section 5).

Clouds are grown where they are written and travel nowhere: a genome is small and re-grows its points in microseconds.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from fractal_farm.catalogue import Catalogue, RunWriter, write_snapshot
from fractal_farm.catalogue.schema import GIVEN_SCHEMA
from fractal_farm.config import RunConfig
from fractal_farm.evolution.designs import SCORE_FIELDS, Designs, Operator
from fractal_farm.farm.work import MeshOrder, Part, PartReceipt
from fractal_farm.fitness import shape_descriptor
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.maps import resolved_maps, selection_probabilities
from fractal_farm.ifs.quantised_cloud import quantised_attractors
from fractal_farm.ifs.random_iteration import GENERATOR_VERSION, attractor_points
from fractal_farm.ifs.similarity_dimension import similarity_dimension


class Publisher:
    """One writer of a run, for the life of one process."""

    def __init__(self, root: Path, config: RunConfig, node: str, attempt: int) -> None:
        self._root = root
        self._run_id = config.run_id
        self._phenotype = config.evolution.phenotype.phenotype()
        self._points = config.evolution.phenotype.points
        self._durability = config.catalogue.durability
        self._writer = RunWriter(
            root, config.run_id, node, attempt, self._points, config.catalogue.clouds, self._durability
        )

    def publish(self, part: Part) -> PartReceipt:
        """Make a part durable: clouds first, then the manifest part, whose appearance is the commit."""
        _, first = np.unique(part.rows["design_id"], return_index=True)
        born_first = np.zeros(len(part.rows), bool)
        born_first[first] = True
        designs = self._genomes(part.rows[part.kept & born_first])
        ancestors = self._genomes(part.rows[~part.kept & born_first])
        rows = [complete_row(row, genome, self._points, kept=True) for row, genome in designs]
        rows += [complete_row(row, genome, self._points, kept=False) for row, genome in ancestors]
        receipt = self._writer.commit(
            pa.Table.from_pylist(rows, schema=GIVEN_SCHEMA),
            quantised_attractors([genome for _, genome in designs], self._points),
            part.records,
            (part.first_epoch, part.last_epoch),
        )
        if part.snapshot is not None:
            write_snapshot(self._root, self._run_id, part.last_epoch, part.snapshot, self._durability)
        gaps = {row["design_id"]: row["gap"] for row in rows[: len(designs)]}
        return PartReceipt(part.first_epoch, part.last_epoch, len(designs), receipt.files, receipt.bytes, gaps)

    def store_solid(self, order: MeshOrder, files: dict[str, bytes]) -> None:
        """Put a finished solid into the catalogue."""
        Catalogue.open(self._root).add_solid(order.genome.design_id, order.parameters.hash, files)

    def _genomes(self, rows: Designs) -> list[tuple[np.void, Genome]]:
        return [(row, Genome(row["genes"][: int(row["n_maps"])], self._phenotype)) for row in rows]


def complete_row(row: np.void, genome: Genome, n_points: int, *, kept: bool) -> dict[str, Any]:
    """A manifest row from a design row: what evolution decided, and what follows from the genome.

    Args:
        row: a row of `design_dtype`.
        genome: its genome.
        n_points: points of the cloud that was scored; the descriptor is computed from the same cloud.
        kept: whether it is published as a design; an ancestor has neither cloud, descriptor nor gap.

    Returns:
        One value for each column of `GIVEN_SCHEMA`.
    """
    phenotype: Phenotype = genome.phenotype
    values = {name: float(row[name]) for name in SCORE_FIELDS}
    return values | {
        "design_id": row["design_id"].decode(),
        "kind": "design" if kept else "ancestor",
        "island": int(row["island"]),
        "epoch": int(row["epoch"]),
        "generation": int(row["generation"]),
        "slot": int(row["slot"]),
        "n_maps": genome.n_maps,
        "family": phenotype.family,
        "influence": phenotype.influence,
        "map_form": phenotype.map_form,
        "rotation_sign": phenotype.rotation_sign,
        "genes": genome.genes.ravel().tolist(),
        "maps": resolved_maps(genome).ravel().tolist(),
        "probabilities": selection_probabilities(genome).tolist(),
        "probabilities_by_hand": False,
        "descriptor": shape_descriptor(attractor_points(genome, n_points)).tolist() if kept else None,
        "similarity_dimension": similarity_dimension(genome),
        "gap": gap(genome) if kept else None,
        "parents": [parent.decode() for parent in row["parents"] if parent],
        "operator": Operator(int(row["operator"])).name.lower(),
        "generator_version": GENERATOR_VERSION,
    }
