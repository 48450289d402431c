"""The pieces of work that executors run, as plain functions of plain values.

Imports that bring numba, storage or meshing along stay inside the functions: island actors import this module and
need none of them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import numpy.typing as npt

from fractal_farm.config import EvolutionConfig
from fractal_farm.errors import FarmError
from fractal_farm.evolution.designs import SCORE_FIELDS, Designs
from fractal_farm.evolution.epoch import Candidates, Scores, Wanted
from fractal_farm.evolution.offspring import founders
from fractal_farm.ifs.genome import Genome

if TYPE_CHECKING:
    from fractal_farm.fitness import FitnessFormula
    from fractal_farm.solid import SolidParameters

QUICK: frozenset[Wanted] = frozenset({"foreseen", "within", "gap"})
"""What takes about as long as to send it to somebody else."""

PREVIEW = "preview.png"
PREVIEW_PIXELS = 512
"""The picture that lies beside the files of every solid of a run."""

Evaluate = Callable[[Candidates, EvolutionConfig], Scores]


@dataclass(frozen=True)
class Part:
    """Whole epochs of all islands, to be made durable together.

    Attributes:
        rows: designs born in these epochs, in the order (epoch, island, birth).
        kept: (rows,) bool, which are published as designs; the others are recorded as ancestors, without a cloud.
        records: packed epoch records.
        first_epoch: first epoch covered.
        last_epoch: last epoch covered.
        snapshot: packed states after the last epoch, or None.
        again: a writer that died had this part before, and may have made it durable.
    """

    rows: Designs
    kept: npt.NDArray[np.bool_]
    records: bytes
    first_epoch: int
    last_epoch: int
    snapshot: bytes | None
    again: bool = False


@dataclass(frozen=True)
class SetAside:
    """A genome that nobody could evaluate, and why.

    Attributes:
        design_id: of the genome.
        genes: its rows.
        reason: how its evaluation ended each time when it ran alone.
    """

    design_id: str
    genes: tuple[tuple[float, ...], ...]
    reason: str


@dataclass(frozen=True)
class PartReceipt:
    """A durable part: what it covers and what it cost; `candidates` are designs to mesh, best first.

    Attributes:
        first_epoch: first epoch covered.
        last_epoch: last epoch covered.
        designs: designs published.
        files: files written.
        bytes: bytes written.
        gaps: gap of every published design, by design id.
    """

    first_epoch: int
    last_epoch: int
    designs: int
    files: int
    bytes: int
    gaps: dict[str, float]


@dataclass(frozen=True)
class MeshOrder:
    """A solid to be made, and certified for a material."""

    genome: Genome
    parameters: SolidParameters
    formats: tuple[str, ...]
    material: str = "silver"


def evaluate_candidates(candidates: Candidates, config: EvolutionConfig, repeat: int = 0) -> Scores:
    """What was wanted of a block of genomes (compiled; releases the GIL).

    Scores come from the cloud of number 0, unless `repeat` asks for another one of the same genome.
    """
    if candidates.wanted == "foreseen":
        return _foreseen(candidates, config)
    if candidates.wanted == "scores":
        return _fitness(candidates, config, repeat)
    from fractal_farm.ifs.gap import gap, gaps_within
    from fractal_farm.solid.estimate import estimates

    genomes = candidates.genomes(config.phenotype.phenotype())
    scores = Scores.unknown(len(genomes))
    gaps = scores.values[:, SCORE_FIELDS.index("gap")]
    if candidates.wanted in ("gap", "solid"):
        gaps[:] = [gap(genome) for genome in genomes]
        if candidates.wanted == "solid":
            for name, column in estimates(genomes, gaps.tolist()).items():
                scores.values[:, SCORE_FIELDS.index(name)] = np.array(column, np.float64)
        return scores
    limit = config.niches.gap
    gaps[:] = np.where(gaps_within(genomes, limit), limit, np.inf)
    return scores


def _foreseen(candidates: Candidates, config: EvolutionConfig) -> Scores:
    """What closed forms say."""
    from fractal_farm.fitness import foresee

    least = config.niches.expected_fitness or 0.0
    found = foresee(
        candidates.genes,
        candidates.n_maps,
        config.phenotype.phenotype(),
        fitness_formula(config),
        least,
        candidates.symmetries,
    )
    scores = Scores.unknown(len(found.d0))
    for name, column in (("d0", found.d0), ("d2", found.d2), ("fitness", found.fitness)):
        scores.values[:, SCORE_FIELDS.index(name)] = column
    return Scores(scores.values, found.refusal, found.descriptor)


def _fitness(candidates: Candidates, config: EvolutionConfig, repeat: int) -> Scores:
    """Random iteration and fitness; gap and solid stay unknown."""
    from fractal_farm.fitness import evaluate_batch

    result = evaluate_batch(
        candidates.genes,
        candidates.n_maps,
        config.phenotype.phenotype(),
        config.phenotype.points,
        fitness_formula(config),
        repeat=repeat,
        described_from=config.qualified,
        symmetries=candidates.symmetries,
    )
    scores = Scores.unknown(len(result.fitness))
    known = (result.d0, result.d2, result.lle, result.fitness, result.d0_error, result.d2_error)
    scores.values[:, : len(known)] = np.column_stack(known)
    return Scores(scores.values, result.refusal, result.descriptor)


def fitness_formula(config: EvolutionConfig) -> FitnessFormula:
    """Eq 3.7 with the constants of a run."""
    from fractal_farm.fitness import FitnessFormula

    constants = config.fitness
    return FitnessFormula(constants.amplitude, constants.baseline, constants.d0, constants.d2, constants.lle)


def warm_up(evaluate: Evaluate, config: EvolutionConfig) -> None:
    """Compile, or load, whatever the evaluations of a run need."""
    sample = sample_candidates(config)
    for wanted in get_args(Wanted):
        if wanted == "scores" or (config.method == "niches" and (wanted != "foreseen" or config.foreseeable)):
            evaluate(sample._replace(wanted=wanted), config)


def sample_candidates(config: EvolutionConfig) -> Candidates:
    """Two founders of a run of seed 0 without seeds of its own: what it takes to try an evaluation."""
    library = config.library.model_copy(update={"seeds": (), "seed_symmetries": ()})
    brood = founders(config.model_copy(update={"seed": 0, "library": library}), 0)
    return Candidates(brood.genes[:2], brood.n_maps[:2], "scores", brood.symmetries[:2])


def made_solid(order: MeshOrder) -> dict[str, bytes]:
    """The files of a solid, with a picture of it in silver and its certificate.

    Raises:
        FarmError: see `fractal_farm.solid.solidify`.
    """
    from fractal_farm.catalogue.solids import CERTIFICATE
    from fractal_farm.picture import encoded, mesh_picture
    from fractal_farm.solid.certificate import certify
    from fractal_farm.solid.files import mesh_files
    from fractal_farm.solid.materials import material
    from fractal_farm.solid.pipeline import make_solid as solid_of

    mesh = solid_of(order.genome, order.parameters)
    found = certify(mesh, material(order.material))
    told = json.dumps({"source": order.genome.design_id, **found.as_dict()}, indent=2, ensure_ascii=False)
    return {
        **mesh_files(mesh, order.formats),
        PREVIEW: encoded(mesh_picture(mesh, PREVIEW_PIXELS, "silver")),
        CERTIFICATE: f"{told}\n".encode(),
    }


def make_solid(order: MeshOrder) -> tuple[dict[str, bytes], str | None]:
    """As `made_solid`, or why there is none."""
    try:
        return made_solid(order), None
    except Exception as error:  # a library's own error must not end the run either
        text = str(error) if isinstance(error, FarmError) else f"{type(error).__name__}: {error}"
        return {}, " ".join(text.split())


def split(candidates: Candidates, size: int | None) -> list[Candidates]:
    """Cut a block into batches of at most `size` genomes (None: one batch)."""
    count = len(candidates.n_maps)
    step = max(1, count if size is None else size)
    return [candidates.part(slice(k, k + step)) for k in range(0, max(count, 1), step)]


def joined(scores: list[Scores]) -> Scores:
    """The scores of batches, put together again."""
    columns: Any = zip(*scores, strict=True)
    return Scores(*(np.concatenate(parts) for parts in columns))
