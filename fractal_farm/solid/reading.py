"""Mesh files that anybody may have written, read with suspicion: GLB, 3MF, PLY, OBJ, STL (DESIGN section 6, point 6).

Sizes are checked before anything is parsed, counts before anything is allocated; no other file is opened. Whatever is
wrong becomes an `InputError` of one line.
"""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from pydantic import ValidationError

from fractal_farm.errors import InputError
from fractal_farm.genome_file import PhenotypeSection, genome_from
from fractal_farm.ifs.genome import Genome
from fractal_farm.solid.formats import glb, obj, ply, stl, three_mf
from fractal_farm.solid.formats.parsed import (
    MAX_FACTS_BYTES,
    MalformedError,
    Parsed,
    check_count,
    check_facts,
    parsed_json,
)
from fractal_farm.untrusted import explain, shown

MAX_BYTES = 512 << 20
READERS = {"glb": glb.read, "3mf": three_mf.read, "ply": ply.read, "obj": obj.read, "stl": stl.read}

_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def read_mesh(path: Path | str) -> trimesh.Trimesh:
    """The mesh in a file, in mm and Z up whatever the file has.

    Args:
        path: a file whose name ends in .glb, .3mf, .ply, .obj or .stl. STL, PLY and OBJ have no unit: mm are assumed.

    Returns:
        A mesh with at least one face and finite vertices; nothing is repaired, it may be open, inside out or in many
        bodies. Vertices at the same place are one where the file's own faces do not close. `metadata` holds what the
        file says about the solid ("design_id", "genome", ..., see `solidify`; not to be trusted), with "units" "mm"
        and "up" "z", and under "file" what the file is: "format", "bytes", "unit", "unit_mm", "up", and "size", (3,)
        lengths of its box in its own unit and axes.

    Raises:
        InputError: missing, no regular file, of another format, above 512 MiB, or malformed; one line.
    """
    path = Path(path)
    form = path.suffix.lower().removeprefix(".")
    if form not in READERS:
        raise InputError(f"{path}: not a mesh file by its name; its name must end in .{', .'.join(READERS)}")
    content = read_content(path, MAX_BYTES)
    try:
        with _quiet():
            parsed = READERS[form](content)
            check_facts(parsed.facts)
            _check(parsed)
            return _mesh(parsed, form, len(content))
    except MalformedError as error:
        raise InputError(f"{path}: cannot be read as {form.upper()}: {error}; export it again") from None
    except Exception:
        # Parsers stumble over damaged files in every way that Python knows.
        raise InputError(f"{path}: cannot be read as {form.upper()}: damaged or cut short; export it again") from None


def read_facts(path: Path | str) -> dict[str, Any]:
    """The facts in the sidecar of a solid (solid.json).

    Raises:
        InputError: as `read_mesh`, for a JSON object up to 1 MiB.
    """
    path = Path(path)
    content = read_content(path, MAX_FACTS_BYTES)
    try:
        facts = parsed_json(content, "JSON")
        check_facts(facts)
    except MalformedError as error:
        raise InputError(f"{path}: cannot be read as facts of a solid: {error}; give a solid.json") from None
    return facts


def read_content(path: Path, limit: int) -> bytes:
    """The bytes of a regular file.

    Raises:
        InputError: missing, not a regular file, not readable, empty, or longer than `limit` bytes.
    """
    try:
        if not path.exists():
            raise InputError(f"{path}: no such file; check the path")
        if not path.is_file():
            raise InputError(f"{path}: is not a regular file; name one")
        large = path.stat().st_size > limit
        with path.open("rb") as file:
            content = b"" if large else file.read(limit + 1)
    except OSError as error:
        raise InputError(f"{path}: {(error.strerror or 'not readable').lower()}; give a readable file") from None
    if large or len(content) > limit:
        raise InputError(f"{path}: larger than {limit >> 20} MiB; give a smaller file")
    if not content:
        raise InputError(f"{path}: is empty; export it again")
    return content


def genome_of_facts(facts: Mapping[str, Any], name: str = "file") -> Genome | None:
    """The genome that a file carries; None if it carries none.

    Args:
        facts: `metadata` of `read_mesh`, or the content of solid.json.
        name: how messages call the file.

    Raises:
        InputError: the genome is invalid, or not the design that the file names.
    """
    if facts.get("genome") is None:
        return None
    try:
        section = PhenotypeSection.model_validate(facts.get("phenotype") or {})
    except ValidationError as error:
        raise InputError(explain(error, PhenotypeSection, lambda _key: f"{name}: phenotype")) from None
    written = {"genes": facts["genome"], "probabilities": facts.get("probabilities")}
    if facts.get("symmetry") is not None:
        written["symmetry"] = facts["symmetry"]
    genome = genome_from(written, section.phenotype(), f"{name}: genome")
    if facts.get("design_id") not in (None, genome.design_id):
        raise InputError(
            f"{name}: its design_id is {shown(facts['design_id'])}, but its genome is {genome.design_id}: altered"
        )
    return genome


def _check(parsed: Parsed) -> None:
    vertices, faces = parsed.vertices, parsed.faces
    if vertices.ndim != 2 or faces.ndim != 2 or vertices.shape[1] != 3 or faces.shape[1] != 3 or not len(faces):
        raise MalformedError("it has no faces")
    check_count(len(faces))
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise MalformedError("a face names a vertex that is not there")
    if not np.isfinite(vertices[np.unique(faces)]).all():
        raise MalformedError("a vertex is not finite")


def _mesh(parsed: Parsed, form: str, length: int) -> trimesh.Trimesh:
    """The mesh in mm, Z up, without vertices that no face has."""
    mesh = trimesh.Trimesh(parsed.vertices, parsed.faces, process=False)
    mesh.remove_unreferenced_vertices()
    size = mesh.extents.tolist()
    turned = mesh.vertices @ _FROM_Y_UP.T if parsed.up == "y" else mesh.vertices
    mesh.vertices = turned * parsed.unit_mm
    if not np.isfinite(mesh.vertices).all() or not np.isfinite(mesh.extents).all():
        raise MalformedError("it is larger than numbers can tell")
    if not parsed.shared or not mesh.is_watertight:
        # Exactly: vertices that lie close are not welded, an open seam stays open.
        unique, index = np.unique(mesh.vertices + 0.0, axis=0, return_inverse=True)
        mesh = trimesh.Trimesh(unique, index.reshape(-1)[mesh.faces], process=False)
    mesh.metadata.update(
        {
            **parsed.facts,
            "units": "mm",
            "up": "z",
            "file": {
                "format": form,
                "bytes": length,
                "unit": parsed.unit,
                "unit_mm": parsed.unit_mm,
                "up": parsed.up,
                "size": size,
            },
        }
    )
    return mesh


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Libraries say nothing about files that we refuse ourselves."""
    logger = logging.getLogger("trimesh")
    before = logger.disabled
    logger.disabled = True
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.disabled = before
