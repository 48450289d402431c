"""Genomes as requests and workers hold them: the mapping of a genome file, and beside it the phenotype."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from pydantic import ValidationError

from fractal_farm.errors import InputError
from fractal_farm.genome_file import PhenotypeSection, genome_from
from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.ifs.symmetry import NO_SYMMETRY
from fractal_farm.untrusted import explain, shown


def genome_of_json(value: Any, phenotype: Phenotype) -> Genome:
    """A valid genome from untrusted JSON.

    Args:
        value: {genes, probabilities?, symmetry?, phenotype?}.
        phenotype: where it names none.

    Raises:
        InputError: one line that says what is wrong.
    """
    if not isinstance(value, dict):
        raise InputError(f"genome is {shown(value)}; give an object with genes")
    given = dict(value)
    if (shape := given.pop("phenotype", None)) is not None:
        try:
            phenotype = PhenotypeSection.model_validate(shape).phenotype()
        except ValidationError as error:
            raise InputError(explain(error, PhenotypeSection, lambda _key: "genome: phenotype")) from None
    if given.get("probabilities", False) is None:
        del given["probabilities"]
    return genome_from(given, phenotype, "genome")


def json_of_genome(genome: Genome) -> dict[str, Any]:
    """The inverse: everything but its defaults, and the phenotype always."""
    told: dict[str, Any] = {"genes": genome.genes.tolist()}
    if genome.probabilities is not None:
        told["probabilities"] = list(genome.probabilities)
    if genome.symmetry != NO_SYMMETRY:
        told["symmetry"] = genome.symmetry
    return {**told, "phenotype": asdict(genome.phenotype)}
