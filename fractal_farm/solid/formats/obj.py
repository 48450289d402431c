"""OBJ: vertices and faces as text, with all facts in comments. Written Z up, in mm."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import trimesh

from fractal_farm.solid.formats.comments import comment_lines, facts_of_comments
from fractal_farm.solid.formats.parsed import MalformedError, Parsed, check_count

_GEOMETRY = re.compile(rb"^[ \t]*([vf][ \t][^\r\n]*)", re.MULTILINE)
_COMMENT = re.compile(rb"^#[ \t]*([^\r\n]*)", re.MULTILINE)
_TEXTURE_AND_NORMAL = re.compile(rb"/[^ \t]*")


def write(mesh: trimesh.Trimesh, facts: Mapping[str, Any]) -> bytes:
    """OBJ with vertices to all digits of float32."""
    lines = [f"# {line}" for line in comment_lines(facts)]
    lines += map("v %.9g %.9g %.9g".__mod__, map(tuple, np.asarray(mesh.vertices, np.float32).tolist()))
    lines += map("f %d %d %d".__mod__, map(tuple, (mesh.faces + 1).tolist()))
    return ("\n".join(lines) + "\n").encode()


def read(content: bytes) -> Parsed:
    """OBJ: its vertices and faces alone, no other file; the unit is not in the format and taken to be mm."""
    comments = [found.decode("ascii", "replace") for found in _COMMENT.findall(content, 0)]
    geometry = [_TEXTURE_AND_NORMAL.sub(b"", line) for line in _GEOMETRY.findall(content)]
    faces = sum(line.startswith(b"f") for line in geometry)
    if not faces:
        raise MalformedError("it has no faces")
    check_count(faces)
    plain = b"\n".join(geometry) + b"\n"
    mesh = trimesh.load_mesh(io.BytesIO(plain), file_type="obj", process=False, maintain_order=True)
    facts = facts_of_comments(comments)
    return Parsed(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64), facts=facts)
