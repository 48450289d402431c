"""A solid as files: GLB, STL, PLY, and the sidecar `solid.json` that says what they are.

GLB carries the genome and all facts in its extras; by the format's rules it is Y up and in metres. STL and PLY are
Z up and in mm, with the design's identity in their header.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import trimesh

from fractal_farm.errors import InputError
from fractal_farm.ifs.genome import Genome, as_genome
from fractal_farm.solid.certificate import certificate
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.solid.pipeline import make_solid

FORMATS = ("glb", "stl", "ply")
SIDECAR = "solid.json"

_METRES_Y_UP = np.array([[1e-3, 0.0, 0.0, 0.0], [0.0, 0.0, 1e-3, 0.0], [0.0, -1e-3, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_SILVER = {"name": "silver", "baseColorFactor": [0.86, 0.87, 0.89, 1.0], "metallicFactor": 1.0, "roughnessFactor": 0.3}
_PLY_COMMENT = b"comment https://github.com/mikedh/trimesh\n"
_STL_HEADER = 80


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
        metadata: further facts, fit for JSON, that go into the sidecar and the GLB; they do not replace measured ones.

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
    return {key: value for key, value in mesh.metadata.items() if not key.startswith("_")}


def _glb(mesh: trimesh.Trimesh, facts: dict[str, Any]) -> bytes:
    copy = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    copy.apply_transform(_METRES_Y_UP)
    copy.metadata.update({**facts, "units": "m", "up": "y"})
    copy.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(**_SILVER))
    return cast(bytes, copy.export(file_type="glb", include_normals=True))


def _stl(mesh: trimesh.Trimesh, facts: dict[str, Any]) -> bytes:
    content = cast(bytes, mesh.export(file_type="stl"))
    header = f"fractal_farm {facts.get('design_id', '')} mm z-up".encode()[:_STL_HEADER]
    return header.ljust(_STL_HEADER) + content[_STL_HEADER:]


def _ply(mesh: trimesh.Trimesh, facts: dict[str, Any]) -> bytes:
    content = cast(bytes, mesh.export(file_type="ply", encoding="binary"))
    comment = f"comment fractal_farm {facts.get('design_id', '')} mm z-up\n".encode()
    return content.replace(_PLY_COMMENT, comment, 1)


_WRITERS = {"glb": _glb, "stl": _stl, "ply": _ply}
