"""From genomes and their scores to the table that a commit takes, and from a row back to its genome.

Compiled code is imported where it is needed: most of those who read a catalogue do without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from fractal_farm.catalogue.schema import GIVEN_SCHEMA, KINDS
from fractal_farm.errors import FarmError
from fractal_farm.ifs.genome import ROW_LENGTH, Genome, Phenotype
from fractal_farm.ifs.symmetry import NO_SYMMETRY


def design_table(genomes: Sequence[Genome], columns: Mapping[str, Sequence[Any] | npt.NDArray[Any]]) -> Any:
    """A table in `schema.GIVEN_SCHEMA` for `RunWriter.commit`.

    Args:
        genomes: m valid genomes; they give the columns from design_id to probabilities.
        columns: column name -> m values, for those that a genome does not give: island, epoch, generation,
            slot, d0, d2, lle, fitness, d0_error, d2_error, descriptor (m, 14), similarity_dimension, gap,
            niche, parents, operator; kind is "design" unless it is given. What is missing becomes null.

    Raises:
        FarmError: an unknown column, or one with other than m values.
    """
    from fractal_farm.ifs.maps import resolved
    from fractal_farm.ifs.random_iteration import GENERATOR_VERSION

    resolutions = [resolved(genome) for genome in genomes]
    phenotypes = [genome.phenotype for genome in genomes]
    known: dict[str, Any] = {
        "design_id": [genome.design_id for genome in genomes],
        "kind": [KINDS[0]] * len(genomes),
        "n_maps": [genome.n_maps for genome in genomes],
        "family": [phenotype.family for phenotype in phenotypes],
        "influence": [phenotype.influence for phenotype in phenotypes],
        "map_form": [phenotype.map_form for phenotype in phenotypes],
        "rotation_sign": [phenotype.rotation_sign for phenotype in phenotypes],
        "genes": [genome.genes.ravel() for genome in genomes],
        "maps": [maps.ravel() for maps, _ in resolutions],
        "probabilities": [probabilities for _, probabilities in resolutions],
        "probabilities_by_hand": [genome.probabilities is not None for genome in genomes],
        "generator_version": [GENERATOR_VERSION] * len(genomes),
        "symmetry": [genome.symmetry for genome in genomes],
        **columns,
    }
    for name, values in known.items():
        if name not in GIVEN_SCHEMA.names:
            raise FarmError(f"designs: column {name!r} does not exist; the columns are {GIVEN_SCHEMA.names}")
        if len(values) != len(genomes):
            raise FarmError(f"designs: column {name!r} has {len(values)} values for {len(genomes)} genomes")
    arrays = [
        _array(known[field.name], field.type) if field.name in known else pa.nulls(len(genomes), field.type)
        for field in GIVEN_SCHEMA
    ]
    return pa.Table.from_arrays(arrays, schema=GIVEN_SCHEMA)


GENOME_COLUMNS = (
    "design_id",
    "n_maps",
    "family",
    "influence",
    "map_form",
    "rotation_sign",
    "genes",
    "probabilities",
    "probabilities_by_hand",
    "symmetry",
)
"""What `genome_of` needs of a row."""


def genome_of(row: Mapping[str, Any]) -> Genome:
    """The genome of one manifest row.

    Raises:
        FarmError: the genome does not have the design_id of its row.
    """
    phenotype = Phenotype(
        family=row["family"],
        influence=row["influence"],
        map_form=row["map_form"],
        rotation_sign=row["rotation_sign"],
    )
    genes = np.array(row["genes"]).reshape(row["n_maps"], ROW_LENGTH[row["family"]])
    by_hand = tuple(row["probabilities"]) if row["probabilities_by_hand"] else None
    genome = Genome(genes, phenotype, by_hand, row["symmetry"] or NO_SYMMETRY)
    if genome.design_id != row["design_id"]:
        raise FarmError(
            f"design {row['design_id']}: damaged, its genes are those of {genome.design_id}; "
            "restore its manifest part from a copy"
        )
    return genome


def _array(values: Sequence[Any] | npt.NDArray[Any], kind: Any) -> Any:
    if isinstance(values, np.ndarray) and values.ndim == 2:
        values = list(values)
    return pa.array(values, kind)
