"""The configuration of a run: one frozen pydantic model (DESIGN section 2).

`evolution` is the identity of a run: its canonical hash is `run_id`, and a run resumes only with the same.
Every field has a default, a description and a range; unknown keys and values that are not offered yet are
refused in one line. `RunConfig.from_yaml` reads a file and `section.field=value` overrides.
"""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, Strict, ValidationError, model_validator

from fractal_farm.errors import InputError
from fractal_farm.genome_file import PhenotypeSection, genome_from, load_genomes, seed_genomes
from fractal_farm.ifs.genome import MAX_MAPS
from fractal_farm.ifs.symmetry import ALLOWED, NO_SYMMETRY, symmetry_code
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.presets import presets, solid_values
from fractal_farm.untrusted import Section, explain, override_value, read_yaml, shown

__all__ = ["RunConfig", "load_genomes"]

IDENTITY_VERSION = 4
MIRROR_URL = r"s3://[a-z0-9][a-z0-9.-]{1,61}[a-z0-9](/[A-Za-z0-9_][A-Za-z0-9_.~=+-]*)*/?"

Probability = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
Centre = Annotated[tuple[float, Positive], Strict(False)]
Dimension = Annotated[float, Field(ge=0, le=10)]
Rows = Annotated[tuple[Annotated[tuple[float, ...], Strict(False)], ...], Strict(False)]


def _integer_keys(value: Any) -> Any:
    """JSON has no integer keys: digits count as the number."""
    if not isinstance(value, Mapping):
        return value
    return {int(key) if isinstance(key, str) and key.isdecimal() else key: share for key, share in value.items()}


class LibraryConfig(Section):
    """The library of parents of an island."""

    size: int = Field(100, ge=2, le=1_000_000, description="designs in the library of an island")
    growth: Literal["keep_best", "append"] = Field(
        "keep_best",
        description="keep_best: the best `size` stay; append: accepted offspring join, none leaves",
    )
    seeds: Annotated[tuple[Rows, ...], Strict(False)] = Field(
        (),
        description="first members: path of a genomes file beside the configuration, or a list of genomes",
        json_schema_extra={"wording": "the path of a genomes file, or a list of genomes"},
    )
    map_counts: Annotated[
        dict[Annotated[int, Field(ge=2, le=MAX_MAPS)], Probability], BeforeValidator(_integer_keys)
    ] = Field(
        {2: 0.5, 3: 0.5},
        description="share of random genomes for each number of maps; the sum is 1",
        json_schema_extra={"keys": f"numbers of maps from 2 to {MAX_MAPS}"},
    )

    seed_symmetries: Annotated[tuple[str, ...], Strict(False)] = Field(
        (), description="the symmetry of each seed, in order; empty: none has any"
    )

    @model_validator(mode="after")
    def _shares_sum_to_one(self) -> LibraryConfig:
        for name in self.seed_symmetries:
            symmetry_code(name, "seed_symmetries")
        if self.seed_symmetries and len(self.seed_symmetries) != len(self.seeds):
            raise ValueError(f"{len(self.seed_symmetries)} seed_symmetries for {len(self.seeds)} seeds; give one each")
        if abs(sum(self.map_counts.values()) - 1.0) > 1e-9:
            raise ValueError(f"map_counts is {shown(self.map_counts)}; allowed: shares whose sum is 1")
        if len(self.seeds) > self.size:
            raise ValueError(f"{len(self.seeds)} seeds do not fit a library of size {self.size}; raise size")
        return self


class CrossoverConfig(Section):
    """Crossover of two parents (eq 3.5)."""

    probability: Probability = Field(0.75, description="share of offspring that are crossed")
    kind: Literal["block", "sequence"] = Field(
        "block",
        description="block: the first rows and columns change places; sequence: all numbers before a point, row by row",
    )


class MutationConfig(Section):
    """Mutation (eq 3.6)."""

    probability: Probability = Field(0.5, description="of each allele")
    sigma: float = Field(1.0, gt=0, le=10, description="standard deviation of what is added to an allele")
    repair: Literal["reflect", "clip", "refuse"] = Field(
        "reflect",
        description="of what left its range: rho is reflected and angles wrap, or both are clipped; refuse: a rho "
        "that does not contract gets no score",
    )


class MigrationConfig(Section):
    """Exchange between islands, by epoch numbers."""

    topology: Literal["ring", "full", "random", "isolated"] = Field("ring", description="who receives from whom")
    degree: int = Field(2, ge=1, le=1024, description="sources of an island in ring and random")
    lag: int = Field(1, ge=1, le=100, description="epochs between departure and arrival")
    emigrants: int = Field(5, ge=0, le=100_000, description="designs that leave an island after each epoch")
    selection: Literal["best", "random"] = Field("best", description="which designs leave")
    replacement: Literal["worst_if_better", "worst", "random"] = Field(
        "worst_if_better", description="which member makes room for an arrival"
    )


class PhenotypeConfig(PhenotypeSection):
    """How a genome becomes points."""

    points: int = Field(5000, ge=500, le=200_000, description="points of a cloud for the fitness")


class NichesConfig(Section):
    """The archive of distinct designs that `method: niches` breeds from."""

    capacity: int = Field(20_000, ge=2, le=1_000_000, description="designs in the archive of an island")
    gap: float = Field(
        0.8 / 30, gt=0, lt=1, description="gap up to which a design prints in one piece: its wall over its size"
    )
    gap_attempts: int = Field(
        3, ge=0, le=16, description="candidates of a slot that are tried for a gap that prints; 0: any gap will do"
    )
    expected_fitness: Probability | None = Field(
        0.85, description="fitness that the closed forms must promise for a candidate of similarities; null: any"
    )
    foreseen_distance: float | None = Field(
        1.0, gt=0, le=10, description="how far from all members a candidate's shape must be foreseen; null: anywhere"
    )
    fullness: float | None = Field(
        1.35,
        gt=0,
        le=4,
        description="D0 + thickness / 2 from which on a design is more than a bare line, thickness being the smallest "
        "over the largest principal standard deviation; null: lines, too",
    )
    crossover: Probability = Field(0.3, description="share of offspring that are crossed")
    probabilities: Annotated[tuple[Probability, ...], Strict(False), Field(min_length=1, max_length=16)] = Field(
        (0.05, 0.15, 0.5), description="probabilities of an allele's mutation; each offspring draws one"
    )
    sigmas: Annotated[
        tuple[Annotated[float, Field(gt=0, le=10)], ...], Strict(False), Field(min_length=1, max_length=16)
    ] = Field((0.1, 0.3, 1.0), description="standard deviations of mutations; each offspring draws one")


class FitnessConfig(Section):
    """The constants of eq 3.7; pairs are (centre, width) of a Gaussian term."""

    amplitude: Positive = Field(1.493, description="height of the Gaussian")
    baseline: float = Field(-0.5, description="added to the Gaussian; the sum is clipped to [0, 1]")
    d0: Centre = Field((0.334, 0.840), description="of D0 / 3")
    d2: Centre = Field((0.5, 0.698), description="of D2 / 3; the centre is calibrated, not read")
    lle: Centre = Field((-0.057, 1.092), description="of the largest Lyapunov exponent, nats an iteration")


class EvolutionConfig(Section):
    """What decides the designs: the identity of a run."""

    seed: int = Field(20261123, ge=0, le=2**63 - 1, description="of all random streams")
    method: Literal["niches", "best", "paper", "random"] = Field(
        "niches",
        description="niches: an archive of distinct designs; best: a library of the best; paper: the paper's "
        "algorithm; random: no evolution",
    )
    islands: int = Field(8, ge=1, le=1024, description="populations that evolve side by side")
    generations_per_epoch: int = Field(5, ge=1, le=1000, description="generations between two exchanges")
    library: LibraryConfig = LibraryConfig()
    offspring: Annotated[int, Field(ge=1, le=1_000_000)] | None = Field(
        128, description="candidates a generation; null if `accepted` is given"
    )
    accepted: Annotated[int, Field(ge=1, le=10_000)] | None = Field(
        None, description="accepted offspring a generation, instead of `offspring` (the paper: 10)"
    )
    crossover: CrossoverConfig = CrossoverConfig()
    mutation: MutationConfig = MutationConfig()
    elimination: Probability = Field(0.6, description="offspring below this fitness are discarded")
    qualified: Probability = Field(0.85, description="designs above this fitness qualify")
    similarity_dimension: Annotated[tuple[Dimension, Dimension], Strict(False)] | None = Field(
        (1.0, 3.0), description="range of the Moran dimension of candidates; null: any"
    )
    migration: MigrationConfig = MigrationConfig()
    niches: NichesConfig = NichesConfig()
    symmetries: dict[str, Probability] = Field(
        {NO_SYMMETRY: 1.0},
        description="share of random genomes for each symmetry; the sum is 1. Offspring inherit theirs, and one in ten "
        f"draws anew. Symmetries: {ALLOWED}",
        json_schema_extra={"keys": "names of symmetries"},
    )
    phenotype: PhenotypeConfig = PhenotypeConfig()
    fitness: FitnessConfig = FitnessConfig()

    @property
    def foreseeable(self) -> bool:
        """Whether closed forms tell of a genome what it will come out as."""
        return self.phenotype.family == "similarity"

    @model_validator(mode="before")
    @classmethod
    def _accepted_stands_instead_of_offspring(cls, data: Any) -> Any:
        if isinstance(data, Mapping) and data.get("accepted") is not None and "offspring" not in data:
            return {**data, "offspring": None}
        return data

    @model_validator(mode="after")
    def _fields_agree(self) -> EvolutionConfig:
        if (self.offspring is None) == (self.accepted is None):
            both = "are both null" if self.offspring is None else f"are {self.offspring} and {self.accepted}"
            raise ValueError(f"offspring and accepted {both}; give one of them and leave the other null")
        for name in self.symmetries:
            symmetry_code(name, "evolution.symmetries")
        if abs(sum(self.symmetries.values()) - 1.0) > 1e-9:
            raise ValueError(f"symmetries is {shown(self.symmetries)}; allowed: shares whose sum is 1")
        if self.mutation.repair == "refuse" and (self.method == "niches" or self.similarity_dimension is not None):
            raise ValueError(
                "mutation.repair refuse foresees nothing: set similarity_dimension null, and a method but niches"
            )
        if self.elimination > self.qualified:
            raise ValueError(f"elimination {self.elimination} is above qualified {self.qualified}; lower it")
        bounds = self.similarity_dimension
        if bounds is not None and bounds[0] >= bounds[1]:
            raise ValueError(f"similarity_dimension is {shown(bounds)}; allowed: [low, high] with low below high")
        if self.migration.emigrants > self.library.size:
            raise ValueError(
                f"migration.emigrants is {self.migration.emigrants}; allowed: up to library.size {self.library.size}"
            )
        for index, rows in enumerate(self.library.seeds, start=1):
            genome_from(rows, self.phenotype.phenotype(), f"evolution.library.seeds: genome {index}")
        return self


class StopConfig(Section):
    """When a run ends: whichever comes first; all null means when it is interrupted."""

    epochs: Count | None = Field(None, description="epochs of every island")
    hours: Annotated[float, Field(gt=0, le=10_000)] | None = Field(None, description="hours of wall-clock time")
    evaluations: Count | None = Field(None, description="candidates evaluated")
    qualified: Count | None = Field(None, description="qualified designs in the catalogue")
    distinct: Count | None = Field(None, description="designs of different shapes")


class ExecutionConfig(Section):
    """Who works; it never changes the result."""

    executor: Literal["ray", "serial"] = Field("ray", description="ray, or serial: in this process alone")
    address: Annotated[str, Field(min_length=1)] | None = Field(
        None, description="of a running Ray cluster; null: start Ray on this machine"
    )
    workers: Annotated[int, Field(ge=1, le=100_000)] | None = Field(None, description="cores; null: all")
    batch_size: Annotated[int, Field(ge=1, le=1_000_000)] | None = Field(
        None, description="candidates in a task; null: a generation of an island"
    )
    metrics: Annotated[int, Field(ge=1024, le=65535)] | None = Field(
        None,
        description="port on loopback at which Prometheus finds the run's figures; a running cluster has its own, and "
        "any number turns them on; null: no figures",
    )

    @model_validator(mode="after")
    def _serial_has_no_ray(self) -> ExecutionConfig:
        for name, value in (("address", self.address), ("metrics", self.metrics)):
            if self.executor == "serial" and value is not None:
                raise ValueError(f"{name} {value!r} needs executor ray; executor is serial")
        return self


class CatalogueConfig(Section):
    """What is kept."""

    keep: Literal["distinct", "qualified", "accepted"] = Field(
        "distinct",
        description="which designs are published: the qualified of a new shape, all qualified, or all accepted ones; "
        "fixed when the catalogue is made",
    )
    clouds: Literal["kept"] = Field("kept", description="which point clouds are stored")
    durability: Literal["full", "process"] = Field(
        "full", description="full: survives a power cut; process: survives a killed process"
    )
    min_free_gb: float = Field(
        2.0, ge=0, le=1e6, description="nothing new begins while less disk than this is free; 0: fill it"
    )
    mirror: Annotated[str, Field(pattern=f"^{MIRROR_URL}$")] | None = Field(
        None,
        description="where a copy of the catalogue grows along, in an object store; null: nowhere",
        json_schema_extra={"wording": "s3://bucket/prefix or null"},
    )


class SolidsConfig(Section):
    """Which designs become meshes, and how."""

    mesh: Literal["qualified"] = Field("qualified", description="which designs are meshed")
    max: Annotated[int, Field(ge=0)] | None = Field(200, description="meshes a run makes; null: every qualified design")
    preset: str | None = Field(
        None, description="purpose and material, such as pendant-silver; the fields below go before it; null: none"
    )
    size_mm: Annotated[float, Field(ge=1, le=1000)] | None = Field(
        None, description="longest side without base, bail and sprue, millimetres; null: the preset's, or 30"
    )
    wall_mm: Annotated[float, Field(gt=0, le=100)] | None = Field(
        None, description="thinnest wall, millimetres; null: the preset's, or 0.8"
    )
    thicken: bool | None = Field(None, description="let the wall grow until all pieces meet; null: yes")
    bridges: bool | None = Field(None, description="join pieces that lie apart by struts; null: the preset's, or no")
    closing_mm: Annotated[float, Field(ge=0, le=250)] | None = Field(
        None, description="radius below which creases are filled, millimetres; null: the preset's, or 0"
    )
    shell_mm: Annotated[float, Field(ge=0, le=250)] | None = Field(
        None, description="shell that stays where a solid is hollowed, millimetres; null: the preset's, or 0, solid"
    )
    shell_above_mm: Annotated[float, Field(gt=0, le=1000)] | None = Field(
        None, description="thickness above which it is hollowed, millimetres; null: the material's, or 4"
    )
    drain_mm: Annotated[float, Field(gt=0, le=100)] | None = Field(
        None, description="diameter of the holes into hollows, millimetres; null: the preset's, or 2"
    )
    base: Literal["none", "plate", "stand"] | None = Field(
        None, description="what it stands on; null: the preset's, or none"
    )
    bail: Literal["none", "ring"] | None = Field(None, description="what it hangs by; null: the preset's, or none")
    bail_hole_mm: Annotated[float, Field(ge=0.5, le=20)] | None = Field(
        None, description="inner diameter of the ring, millimetres; null: the preset's, or 3"
    )
    engrave: bool | None = Field(None, description="the design code on the underside of the base; null: no")
    sprue: bool | None = Field(None, description="a cone for casting, below; null: the preset's, or no")
    formats: Annotated[tuple[Literal["glb", "3mf", "stl", "ply", "obj"], ...], Strict(False), Field(min_length=1)] = (
        Field(("glb", "stl"), description="files for each mesh")
    )

    @model_validator(mode="after")
    def _wall_fits(self) -> SolidsConfig:
        try:
            values = solid_values(self.preset, **self._given)
            # A solid has up to 400 voxels along its longest side and at least 3 in a wall.
            size = values.get("size_mm", SolidParameters.size_mm)
            wall = values.get("wall_mm", SolidParameters.wall_mm)
            low, high = size * 3 / 400, size / 3
            if not low <= wall < high:
                raise ValueError(f"wall_mm is {wall}; allowed at this size_mm: from {low:.3g} to below {high:.3g}")
            SolidParameters(**values)
        except InputError as error:
            raise ValueError(str(error)) from None
        if len(set(self.formats)) < len(self.formats):
            raise ValueError(f"formats is {shown(self.formats)}; name each format once")
        return self

    @property
    def parameters(self) -> SolidParameters:
        """What the solids of the run shall be: the preset's, and what is given before it."""
        return SolidParameters(**solid_values(self.preset, **self._given))

    @property
    def material(self) -> str:
        """What the certificates of the solids are for: the preset's material, or silver."""
        return "silver" if self.preset is None else presets()[self.preset].material.name

    @property
    def _given(self) -> dict[str, Any]:
        return self.model_dump(exclude={"mesh", "max", "preset", "formats"})


class RunConfig(Section):
    """The configuration of a run."""

    name: str = Field(
        "run",
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$",
        description="of the run; names its directory",
        json_schema_extra={"wording": "1 to 64 letters, digits, dots, dashes and underscores"},
    )
    evolution: EvolutionConfig = EvolutionConfig()
    stop: StopConfig = StopConfig()
    execution: ExecutionConfig = ExecutionConfig()
    catalogue: CatalogueConfig = CatalogueConfig()
    solids: SolidsConfig = SolidsConfig()

    @classmethod
    def from_yaml(cls, path: Path | str, overrides: Sequence[str] = ()) -> RunConfig:
        """The configuration in a YAML file.

        Args:
            path: the file; paths in it are relative to its directory.
            overrides: `section.field=value` with a YAML value; paths in them are relative to the
                working directory.

        Raises:
            InputError: one line that names file (or override), key, value and what is allowed.
        """
        path = Path(path)
        return cls._from(read_yaml(path), str(path), path.parent, overrides)

    @classmethod
    def from_dict(
        cls, values: Mapping[str, Any], source: str = "configuration", overrides: Sequence[str] = ()
    ) -> RunConfig:
        """The configuration in a mapping, such as `to_dict` gives, also after a journey through JSON.

        Raises:
            InputError: as `from_yaml`, with `source` in place of the file.
        """
        return cls._from(values, source, Path(), overrides)

    def to_dict(self) -> dict[str, Any]:
        """Every field, as JSON has it; `from_dict` restores an equal configuration."""
        return self.model_dump(mode="json")

    @property
    def run_id(self) -> str:
        """16 hex digits: blake2b of the evolution section in canonical JSON (sorted keys, floats by repr)."""
        evolution = self.evolution.model_dump(mode="json")
        # What a run without symmetries is has not changed since there are any.
        if evolution["symmetries"] == {NO_SYMMETRY: 1.0}:
            del evolution["symmetries"]
        if not evolution["library"]["seed_symmetries"]:
            del evolution["library"]["seed_symmetries"]
        if evolution["mutation"]["repair"] == "reflect":  # nor since there are other repairs
            del evolution["mutation"]["repair"]
        identity = {"version": IDENTITY_VERSION, "evolution": evolution}
        text = json.dumps(identity, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.blake2b(text.encode(), digest_size=8, person=b"farm-run").hexdigest()

    @classmethod
    def _from(cls, values: Mapping[str, Any], source: str, directory: Path, overrides: Sequence[str]) -> RunConfig:
        tree = copy.deepcopy(dict(values))
        changed = [override_value(tree, override) for override in overrides]
        _load_seeds(tree, Path() if "evolution.library.seeds" in changed else directory)

        def source_of(key: str) -> str:
            if any(key == path or key.startswith(f"{path}.") for path in changed):
                return "--set"
            return f"{source} with --set" if any(path.startswith(f"{key}.") for path in changed) else source

        try:
            return cls.model_validate(tree)
        except ValidationError as error:
            raise InputError(explain(error, cls, source_of)) from None
        except InputError as error:
            raise InputError(f"{source}: {error}") from None


def _load_seeds(tree: Mapping[Any, Any], directory: Path) -> None:
    """Replace the path of a genomes file by its rows, so that identity depends on content alone."""
    evolution = tree.get("evolution")
    library = evolution.get("library") if isinstance(evolution, Mapping) else None
    if not isinstance(evolution, Mapping) or not isinstance(library, dict):
        return
    if isinstance(library.get("seeds"), str):
        try:
            phenotype = PhenotypeConfig.model_validate(evolution.get("phenotype", {})).phenotype()
        except ValidationError:
            return
        seeds = seed_genomes(directory / library["seeds"], phenotype)
        library["seeds"] = [seed.genes.tolist() for seed in seeds]
        if any(seed.symmetry != NO_SYMMETRY for seed in seeds):
            library["seed_symmetries"] = [seed.symmetry for seed in seeds]
    elif "seeds" in library and library["seeds"] is None:
        library["seeds"] = []
