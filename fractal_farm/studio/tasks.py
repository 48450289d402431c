"""What workers do: each task takes and gives what JSON holds, and bytes. Compiled code is loaded in workers alone."""

from __future__ import annotations

import functools
import json
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fractal_farm.ifs.genome import Genome, Phenotype
from fractal_farm.studio.genomes import genome_of_json, json_of_genome

if TYPE_CHECKING:
    from fractal_farm.catalogue.layout import PartName
    from fractal_farm.catalogue.signatures import SignatureIndex

Told = Callable[[str, float], None]
"""Hears of each stage of a task, and of the share of the work that is done by then."""

SEEDS_TRIED = 10_000
_BEGUN = (
    (0.3, 0.2, 0.1, 0.6, 1.0, 0.0, 0.0),
    (-0.4, 0.1, 0.5, 0.7, 0.0, 1.0, 0.2),
    (1.0, -0.3, 0.2, 0.5, 0.1, 0.3, 1.0),
)
_MADE, _JUDGED, _WRITTEN = 0.75, 0.88, 1.0  # shares of a solid's work
_METALS = {"gold": "gold", "steel": "steel"}


def warm(_arguments: Mapping[str, Any], _told: Told) -> tuple[Any, bytes]:
    """Load what scores and grows points, so that the first request does not wait for it."""
    genome = json_of_genome(Genome(np.array(_BEGUN)))
    score({"genome": genome, "points": 500, "fitness": None}, _told)
    for view in ("density", "even"):
        points({"genome": genome, "count": 500, "view": view}, _told)
    return None, b""


def score(arguments: Mapping[str, Any], _told: Told) -> tuple[Any, bytes]:
    """Scores, errors, maps and probabilities of a genome.

    Args:
        arguments: genome; points of its cloud; fitness, the constants of eq 3.7.
    """
    from fractal_farm.fitness import FitnessFormula, evaluate
    from fractal_farm.ifs.gap import gap
    from fractal_farm.ifs.maps import resolved
    from fractal_farm.ifs.similarity_dimension import similarity_dimension
    from fractal_farm.solid.estimate import estimates

    genome = _genome(arguments)
    found = evaluate([genome], arguments["points"], FitnessFormula(**(arguments["fitness"] or {})))
    width = gap(genome)
    similar = genome.phenotype.family == "similarity"
    maps, probabilities = resolved(genome)
    scores = {name: float(getattr(found, name)[0]) for name in ("fitness", "d0", "d2", "lle")} | {
        "gap": width,
        "similarity_dimension": similarity_dimension(genome) if similar else None,
        **{name: values[0] for name, values in estimates([genome], [width]).items()},
    }
    return {
        "design_id": genome.design_id,
        "scores": scores,
        "errors": {"d0": float(found.d0_error[0]), "d2": float(found.d2_error[0])},
        "maps": maps.reshape(-1, 12).tolist(),
        "probabilities": probabilities.tolist(),
    }, b""


def points(arguments: Mapping[str, Any], _told: Told) -> tuple[Any, bytes]:
    """Points of a genome's shape as float32 x, y, z.

    Args:
        arguments: genome; count; view: "density" (random iteration, as the paper draws) or "even" (every place alike).
    """
    genome, count = _genome(arguments), arguments["count"]
    if arguments["view"] == "even":
        from fractal_farm.picture.points import display_points

        found = display_points(genome, count)[0]
    else:
        from fractal_farm.ifs.random_iteration import attractor_points

        found = attractor_points(genome, count)
    return {"count": len(found)}, found.astype("<f4").tobytes()


def keep(arguments: Mapping[str, Any], _told: Told) -> tuple[Any, bytes]:
    """Store a genome as a design that somebody made.

    Args:
        arguments: root of the catalogue; genome; parents, ids of designs.
    """
    from fractal_farm.hand.keeping import keep as store

    (row,) = store(Path(arguments["root"]), [_genome(arguments)], arguments["parents"])
    return {"design_id": row["design_id"]}, b""


def similar(arguments: Mapping[str, Any], _told: Told) -> tuple[Any, bytes]:
    """The designs that look like one.

    Args:
        arguments: root of the catalogue; design_id; limit.
    """
    from dataclasses import asdict

    from fractal_farm.catalogue.parts import list_parts
    from fractal_farm.catalogue.similar import similar_to_design

    root = Path(arguments["root"])
    index = _signatures(root, tuple(list_parts(root)))
    hits = similar_to_design(index, arguments["design_id"], arguments["limit"])
    return [{**asdict(hit), "same_shape": hit.same_shape} for hit in hits], b""


def breeding(arguments: Mapping[str, Any], _told: Told) -> tuple[Any, bytes]:
    """The run that would breed from designs, with the first seed that no run of the catalogue has had.

    Args:
        arguments: root of the catalogue; design_ids; epochs; seed, to begin with, or None.
    """
    from fractal_farm.catalogue import run_ids
    from fractal_farm.errors import InputError
    from fractal_farm.hand.breeding import breeding_config, founders_of

    root = Path(arguments["root"])
    founders = founders_of(root, arguments["design_ids"])
    known = set(run_ids(root))
    first = founders.config.evolution.seed if arguments["seed"] is None else arguments["seed"]
    for seed in range(first, first + SEEDS_TRIED):
        overrides = [f"evolution.seed={seed}", f"stop.epochs={arguments['epochs']}"]
        config = breeding_config(founders, overrides)
        if config.run_id not in known:
            return {"run_id": config.run_id, "overrides": overrides, "design_ids": list(founders.design_ids)}, b""
    raise InputError(f"these designs were bred {SEEDS_TRIED} times already; choose others")


def groups(arguments: Mapping[str, Any], _told: Told) -> tuple[Any, bytes]:
    """For each design of some parts, best first, the row of the first design of its shape, as uint32.

    Args:
        arguments: root of the catalogue; parts, their file names.
    """
    from fractal_farm.catalogue.layout import part_name
    from fractal_farm.studio.gallery import designs_of_parts, marks_of
    from fractal_farm.studio.groups import Groups

    parts = [part for part in map(part_name, arguments["parts"]) if part is not None]
    rows, places = designs_of_parts(Path(arguments["root"]), parts)
    return None, Groups().add(marks_of(rows, places)).astype("<u4").tobytes()


def solid(arguments: Mapping[str, Any], told: Told) -> tuple[Any, bytes]:
    """Make a solid with its certificate, and write it in all formats; all files appear at once.

    Args:
        arguments: genome; parameters, fields of `SolidParameters`; material; directory, which is made.
    """
    from fractal_farm.ifs.design_code import design_code
    from fractal_farm.picture.certified import certificate_pictures
    from fractal_farm.solid.certificate import certify
    from fractal_farm.solid.certificate_page import certificate_page
    from fractal_farm.solid.files import FORMATS, mesh_files
    from fractal_farm.solid.materials import material
    from fractal_farm.solid.parameters import SolidParameters
    from fractal_farm.solid.pipeline import make_solid

    genome, profile = _genome(arguments), material(arguments["material"])
    mesh = make_solid(
        genome, SolidParameters(**arguments["parameters"]), lambda stage, share: told(stage, _MADE * share)
    )
    told("certificate", _MADE)
    found = certify(mesh, profile)
    metal: Any = _METALS.get(profile.name, "silver")
    pictures = certificate_pictures(mesh, found, metal)
    told("files", _JUDGED)
    facts = {**found.as_dict(), "lines": [finding.line for finding in found.findings], "passes": found.passes}
    title = f"design {design_code(genome.design_id)}"
    files = {
        **mesh_files(mesh, FORMATS),
        "certificate.json": json.dumps(facts, indent=1).encode(),
        "certificate.html": certificate_page(found, profile, title, pictures).encode(),
        "preview.png": pictures[0][1],
    }
    _put(Path(arguments["directory"]), files)
    told("files", _WRITTEN)
    return {"files": sorted(files), "certificate": facts}, b""


TASKS: dict[str, Callable[[Mapping[str, Any], Told], tuple[Any, bytes]]] = {
    task.__name__: task for task in (warm, score, points, keep, similar, breeding, groups, solid)
}


@functools.lru_cache(1)
def _signatures(root: Path, _parts: tuple[PartName, ...]) -> SignatureIndex:
    """The signatures of a catalogue, opened once for the same parts."""
    from fractal_farm.catalogue.signatures import open_signatures

    return open_signatures(root)


def _genome(arguments: Mapping[str, Any]) -> Genome:
    return genome_of_json(arguments["genome"], Phenotype())


def _put(directory: Path, files: Mapping[str, bytes]) -> None:
    """Write a directory of files that is there whole or not at all."""
    partial = directory.with_name(f".{directory.name}.{os.getpid()}")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    for name, content in files.items():
        (partial / name).write_bytes(content)
    shutil.rmtree(directory, ignore_errors=True)
    partial.rename(directory)
