"""PLY: vertices and faces, with all facts in comments of its header. Written Z up, in mm."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import trimesh

from fractal_farm.solid.formats.comments import comment_lines, facts_of_comments
from fractal_farm.solid.formats.parsed import MAX_VERTICES, MalformedError, Parsed, check_count

_OWN_COMMENT = b"comment https://github.com/mikedh/trimesh\n"
_END = b"end_header"
_MAX_HEADER = 2 << 20
_SIZES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64", "int64", "uint64"), 8),
}


def write(mesh: trimesh.Trimesh, facts: Mapping[str, Any]) -> bytes:
    """Binary PLY, little-endian."""
    content = cast(bytes, mesh.export(file_type="ply", encoding="binary", vertex_normal=False))
    comments = "".join(f"comment {line}\n" for line in comment_lines(facts)).encode()
    if content.count(_OWN_COMMENT, 0, 4096) != 1:
        raise AssertionError("the PLY header of trimesh is not as we know it")
    return content.replace(_OWN_COMMENT, comments, 1)


def read(content: bytes) -> Parsed:
    """PLY, binary or ASCII; its unit is not in the format and taken to be mm."""
    head, end, rest = content[:_MAX_HEADER].partition(_END)
    if not head.startswith(b"ply") or not end:
        raise MalformedError("it has no PLY header")
    lines = [line.strip() for line in head.decode("ascii", "replace").splitlines()]
    _check_counts(lines, len(content) - len(head) - len(_END))
    facts = facts_of_comments([line.removeprefix("comment ") for line in lines if line.startswith("comment ")])
    # Without comments: texture files are not looked for.
    plain = "".join(f"{line}\n" for line in lines if line and not line.startswith("comment")).encode()
    newline = b"\r\n" if rest.startswith(b"\r\n") else b"\n"
    body = memoryview(content)[len(head) + len(_END) + len(newline) :]
    mesh = trimesh.load_mesh(io.BytesIO(plain + _END + b"\n" + body), file_type="ply", process=False)
    return Parsed(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64), facts=facts)


def _check_counts(lines: list[str], length: int) -> None:
    """Refuse counts that the bytes after the header cannot hold, before anything is allocated."""
    text = any(line.startswith("format ascii") for line in lines)
    counts: dict[str, int] = {}
    sizes: dict[str, int] = {}
    name = ""
    for words in (line.split() for line in lines):
        if words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isdecimal() or len(words[2]) > 18 or words[1] in counts:
                raise MalformedError("an element of its header cannot be read")
            name = words[1]
            counts[name], sizes[name] = int(words[2]), 0
        elif words[:1] == ["property"]:
            kind = words[2] if words[1:2] == ["list"] and len(words) == 5 else words[1] if len(words) == 3 else ""
            if kind not in _SIZES or not name:
                raise MalformedError("a property of its header cannot be read")
            sizes[name] += 2 if text else _SIZES[kind]
    if counts.get("vertex", 0) > MAX_VERTICES:
        raise MalformedError(f"its header tells of {counts['vertex']} vertices, more than {MAX_VERTICES}")
    check_count(counts.get("face", 0))
    least = sum(count * sizes[element] for element, count in counts.items())
    if least > length + 1 or any(count and not sizes[element] for element, count in counts.items()):
        raise MalformedError(f"its header tells of at least {least} bytes, and {length} follow")
