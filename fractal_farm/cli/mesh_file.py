"""`farm show FILE`: what a mesh file, or the sidecar of one, is and what it carries. The file is not trusted."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from fractal_farm.cli.output import byte_count, print_facts, print_json, print_table
from fractal_farm.errors import InputError
from fractal_farm.ifs.design_code import design_code

if TYPE_CHECKING:
    from fractal_farm.ifs.genome import Genome

_SIDECAR = ".json"
_LONGEST = 200


def show_file(path: Path, as_json: bool) -> None:
    """Print what a file is and carries.

    Raises:
        InputError: a directory, or a file that cannot be read.
    """
    from fractal_farm.solid.reading import genome_of_facts, read_facts, read_mesh

    if path.is_dir():
        raise InputError(f"{path}: is a directory; name a design in it too, or a file")
    if path.suffix.lower() == _SIDECAR:
        facts: dict[str, Any] = read_facts(path)
        measured = {}
    else:
        mesh = read_mesh(path)
        facts = dict(mesh.metadata)
        measured = {
            "file": facts.pop("file"),
            "box_mm": mesh.extents.tolist(),
            "faces": len(mesh.faces),
            "vertices": len(mesh.vertices),
            "bodies": int(mesh.body_count),
            "watertight": bool(mesh.is_watertight and mesh.is_winding_consistent),
            "volume_mm3": float(mesh.volume),
        }
    genome = genome_of_facts(facts, str(path))
    identity = genome.design_id if genome is not None else facts.get("design_id")
    known = isinstance(identity, str) and re.fullmatch("[0-9a-f]{32}", identity)
    code = design_code(str(identity)) if known else None
    if as_json:
        print_json({"design_id": identity, "design_code": code, **measured, "carries": facts})
        return
    print_facts({**_of_the_file(measured), **_of_the_design(facts, genome, identity, code)})
    if genome is not None:
        typer.echo()
        _print_genes(genome)


def _of_the_file(measured: dict[str, Any]) -> dict[str, Any]:
    if not measured:
        return {}
    file = measured["file"]
    sides = " x ".join(f"{length:.4g}" for length in file["size"])
    told = "" if file["format"] in ("glb", "3mf") else ", which the format does not say"
    return {
        "format": f"{file['format'].upper()}, {byte_count(file['bytes'])}",
        "units": f"{file['unit']}{told}, {file['up']} up",
        "size": f"{sides} {file['unit']}",
        "in mm": " x ".join(f"{length:.2f}" for length in measured["box_mm"]) + ", z up",
        "faces": measured["faces"],
        "bodies": measured["bodies"],
        "closed": measured["watertight"],
        "volume": f"{measured['volume_mm3']:.4g} mm3",
    }


def _of_the_design(facts: dict[str, Any], genome: Genome | None, identity: Any, code: str | None) -> dict[str, Any]:
    parameters = facts.get("parameters")
    if isinstance(parameters, dict):
        parameters = ", ".join(f"{key} {value}" for key, value in parameters.items() if value is not None)
    software = " ".join(str(facts[key]) for key in ("software", "software_version") if facts.get(key))
    words = {
        "design": identity or "none is named",
        "code": code,
        "parameters": parameters,
        "software": software or facts.get("Application"),
        "licence": facts.get("licence") or facts.get("LicenseTerms") or "none is stated",
    }
    told = {name: _printable(value) for name, value in words.items() if value is not None}
    if genome is None:
        return {**told, "genome": "none"}
    shape = genome.phenotype
    return {
        **told,
        "phenotype": f"{shape.family}, {shape.map_form}, rotation sign {shape.rotation_sign}, "
        f"influence {shape.influence:g}",
        "symmetry": genome.symmetry,
        "genome": f"{genome.n_maps} maps",
    }


def _print_genes(genome: Genome) -> None:
    from fractal_farm.ifs.genome import GENE_NAMES

    names = GENE_NAMES if genome.phenotype.family == "similarity" else [f"a{k}" for k in range(1, 13)]
    rows = [[number, *map(repr, row)] for number, row in enumerate(genome.genes.tolist(), start=1)]
    if genome.probabilities is not None:
        rows = [[*row, repr(share)] for row, share in zip(rows, genome.probabilities, strict=True)]
        names = [*names, "P"]
    print_table(["map", *names], rows)


def _printable(value: Any) -> str:
    """What somebody else wrote, without anything that a terminal would obey."""
    text = "".join(character if character.isprintable() else "?" for character in str(value))
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
