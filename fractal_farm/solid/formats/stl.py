"""STL: triangles without unit, colour or metadata; its header of 80 bytes names the design. Written Z up, in mm."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import trimesh

from fractal_farm.solid.formats.parsed import MalformedError, Parsed, check_count

_HEADER = 80
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_IDENTITY = re.compile(rb"fractal_farm ([0-9a-f]{32})")


def write(mesh: trimesh.Trimesh, facts: Mapping[str, Any]) -> bytes:
    """Binary STL."""
    content = cast(bytes, mesh.export(file_type="stl"))
    header = f"fractal_farm {facts.get('design_id', '')} {facts.get('design_code', '')} mm z-up".encode()[:_HEADER]
    return header.ljust(_HEADER) + content[_HEADER:]


def read(content: bytes) -> Parsed:
    """STL, binary or ASCII; its unit is not in the file and taken to be mm."""
    count = int.from_bytes(content[_HEADER : _HEADER + 4], "little")
    told = _HEADER + 4 + count * _TRIANGLE.itemsize
    if len(content) >= _HEADER + 4 and told == len(content):
        check_count(count)
        corners = np.frombuffer(content, _TRIANGLE, count, _HEADER + 4)["corners"]
    elif content.lstrip()[:5].lower() == b"solid" and b"facet" in content[:4096].lower():
        mesh = trimesh.load_mesh(io.BytesIO(content), file_type="stl_ascii", process=False)
        corners = np.asarray(mesh.triangles)
    elif len(content) < _HEADER + 4:
        raise MalformedError("it is cut short")
    else:
        raise MalformedError(f"its header tells of {count} faces, {told} bytes, and it has {len(content)}")
    found = _IDENTITY.search(content[:_HEADER])
    facts = {"design_id": found[1].decode()} if found else {}
    faces = np.arange(3 * len(corners), dtype=np.int64).reshape(-1, 3)
    return Parsed(corners.reshape(-1, 3).astype(np.float64), faces, facts=facts, shared=False)
