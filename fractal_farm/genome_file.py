"""Genomes written by hand: YAML files of named genomes, such as `configs/table1.yaml`.

A file holds `genomes:`, a mapping of names to rows of seven numbers, or to
`{genes: rows, probabilities: [...], symmetry: rotation:6}`, and optionally `phenotype:` with the fields of `Phenotype`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError
from pydantic_core import PydanticCustomError

from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome, Phenotype, as_genome
from fractal_farm.ifs.symmetry import NO_SYMMETRY
from fractal_farm.untrusted import Section, explain, read_yaml, shown

_GENOME_KEYS = ("genes", "probabilities", "symmetry")


def _whole(value: Any) -> Any:
    """Literal 1 also equals 1.0 and true; only a whole number passes."""
    if type(value) is not int:
        raise PydanticCustomError("not_whole", "not a whole number")
    return value


class PhenotypeSection(Section):
    """`Phenotype` as somebody writes it."""

    family: Literal["similarity", "affine"] = Field("similarity", description="eq 3.2, or affine: eq 2.1")
    influence: float = Field(
        4.0, ge=1, le=1000, description="alpha of eq 3.4: no map is drawn less often than 1/(alpha N)"
    )
    map_form: Literal["rho R (x + d)", "rho R x + d"] = Field(
        "rho R (x + d)", description="our reading of eq 3.2, and the other one"
    )
    rotation_sign: Annotated[Literal[1, -1], BeforeValidator(_whole)] = Field(
        1, description="our reading of the angles, and the other one"
    )

    def phenotype(self) -> Phenotype:
        """What shapes a genome."""
        return Phenotype(self.family, self.influence, self.map_form, self.rotation_sign)


class GenomesFile(Section):
    """A file of genomes; what stands behind a name is judged by `genome_from`."""

    phenotype: PhenotypeSection | None = None
    genomes: Annotated[dict[str, Any], Field(min_length=1, max_length=10_000)] = Field(
        json_schema_extra={
            "keys": "names in quotes",
            "wording": "a mapping of 1 to 10000 names to rows of numbers",
        }
    )


def load_genomes(path: Path | str, phenotype: Phenotype | None = None) -> list[tuple[str, Genome]]:
    """The named genomes of a file, in its order.

    Args:
        path: YAML file.
        phenotype: how rows become maps where the file does not say; default `Phenotype()`.

    Returns:
        (name, genome) pairs with validated genomes.

    Raises:
        InputError: one line that names the file, the genome and what is wrong with it.
    """
    path = Path(path)
    try:
        file = GenomesFile.model_validate(read_yaml(path))
    except ValidationError as error:
        raise InputError(explain(error, GenomesFile, lambda _key: str(path))) from None
    shape = file.phenotype.phenotype() if file.phenotype else phenotype or Phenotype()
    return [
        (name, genome_from(value, shape, f"{path}: genome {' '.join(name.split())}"))
        for name, value in file.genomes.items()
    ]


def seed_genomes(path: Path, phenotype: Phenotype) -> list[Genome]:
    """The genomes of a file, to found libraries of a run with this phenotype.

    Raises:
        InputError: as `load_genomes`; also for another phenotype, or probabilities set by hand.
    """
    seeds = load_genomes(path, phenotype)
    for name, genome in seeds:
        if genome.phenotype != phenotype:
            raise InputError(f"{path}: its phenotype differs from that of the run; make them equal")
        if genome.probabilities is not None:
            raise InputError(f"{path}: genome {name} has probabilities set by hand; a seed has none, remove them")
    return [genome for _name, genome in seeds]


def genome_from(value: Any, phenotype: Phenotype, name: str) -> Genome:
    """A validated genome from what YAML or JSON holds: rows of numbers, or a mapping with `genes`.

    Raises:
        InputError: its message begins with `name`.
    """
    genes, probabilities, symmetry = value, None, NO_SYMMETRY
    if isinstance(value, Mapping):
        if unknown := [key for key in value if key not in _GENOME_KEYS]:
            raise InputError(f"{name}: unknown key {unknown[0]}; allowed here: {', '.join(_GENOME_KEYS)}")
        genes, probabilities = value.get("genes"), value.get("probabilities")
        symmetry = value.get("symmetry", NO_SYMMETRY)
    rows = _rows(genes, name)
    if probabilities is not None:
        probabilities = tuple(_numbers(probabilities, f"{name}: probabilities"))
    return as_genome(Genome(rows, phenotype, probabilities, symmetry), name)


def _rows(genes: Any, name: str) -> Any:
    if not isinstance(genes, (list, tuple)) or not genes:
        raise InputError(f"{name}: genes are {shown(genes)}; allowed: a list of rows of numbers")
    rows = [_numbers(row, f"{name} map {index}") for index, row in enumerate(genes, start=1)]
    lengths = {len(row) for row in rows}
    if len(lengths) > 1:
        raise InputError(f"{name}: rows of {', '.join(map(str, sorted(lengths)))} numbers; give rows of equal length")
    return rows


def _numbers(row: Any, name: str) -> list[float]:
    if not isinstance(row, (list, tuple)):
        raise InputError(f"{name}: {shown(row)}; allowed: a list of numbers")
    for allele in row:
        if isinstance(allele, bool) or not isinstance(allele, (int, float)):
            raise InputError(f"{name}: {shown(allele)} is not a number; allowed: a list of numbers")
    try:
        return [float(allele) for allele in row]
    except OverflowError:
        raise InputError(f"{name}: a number is too large; every gene must be a finite number") from None
