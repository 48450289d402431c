"""A solid as files: GLB, 3MF, STL, PLY, OBJ, and the sidecar `solid.json` that says what they are.

GLB carries the genome and all facts in its extras; by the format's rules it is Y up and in metres. The others are Z up
and in mm; 3MF carries the facts as metadata, PLY and OBJ as comments, STL names the design in its header.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy.typing as npt
import trimesh

from fractal_farm import __version__
from fractal_farm.errors import InputError
from fractal_farm.ifs.design_code import design_code
from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.solid.certificate import certificate
from fractal_farm.solid.formats import glb, obj, ply, stl, three_mf
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.pipeline import make_solid

FORMATS = ("glb", "3mf", "stl", "ply", "obj")
SIDECAR = "solid.json"


def solid_files(
    genome: Genome | npt.ArrayLike,
    parameters: SolidParameters | None = None,
    formats: Sequence[str] = ("glb", "stl"),
    metadata: Mapping[str, Any] | None = None,
) -> dict[str, bytes]:
    """Make a solid and write it in several formats.

    Args:
        genome: a `Genome` or an (N, 7) array.
        parameters: of the solid; the defaults of `SolidParameters` if None.
        formats: any of `FORMATS`.
        metadata: further facts, fit for JSON, that go into the sidecar and all files but STL; "licence" (an SPDX
            identifier) and "designer" have their own place in 3MF. They do not replace measured ones.

    Returns:
        File name -> content: "solid.<format>" for each format, and "solid.json".

    Raises:
        InputError: an unknown format, invalid genome or parameters.
        FarmError: see `solidify`.
    """
    chosen = check_formats(formats)
    mesh = make_solid(as_genome(genome), parameters if parameters is not None else SolidParameters())
    return mesh_files(mesh, chosen, metadata)


def mesh_files(
    mesh: trimesh.Trimesh, formats: Sequence[str] = ("glb", "stl"), metadata: Mapping[str, Any] | None = None
) -> dict[str, bytes]:
    """`solid_files` for a mesh that `solidify` has made."""
    facts = {**(metadata or {}), **_made_of(mesh), **certificate(mesh)}
    files = {f"solid.{name}": _WRITERS[name](mesh, facts) for name in check_formats(formats)}
    files[SIDECAR] = json.dumps(facts, indent=1, sort_keys=True).encode()
    return files


def check_formats(formats: Sequence[str]) -> tuple[str, ...]:
    """The formats in lower case; raises InputError for an unknown one."""
    chosen = tuple(dict.fromkeys(name.lower().removeprefix(".") for name in formats))
    for name in chosen:
        if name not in FORMATS:
            raise InputError(f"format is {name!r}; choose from {', '.join(FORMATS)}")
    return chosen


def _made_of(mesh: trimesh.Trimesh) -> dict[str, Any]:
    """What is known of the making of a mesh, fit for JSON."""
    facts = {key: value for key, value in mesh.metadata.items() if not key.startswith("_")}
    if "design_id" in facts:
        facts["design_code"] = design_code(facts["design_id"])
    return {**facts, "software": "Fractal Farm", "software_version": __version__}


_WRITERS = {"glb": glb.write, "3mf": three_mf.write, "stl": stl.write, "ply": ply.write, "obj": obj.write}
