"""GLB (binary glTF 2.0): by its rules Y up and in metres, with all facts in the extras of the mesh.

Read are the triangles of the default scene; images, materials and animations are left alone, no other file is opened.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import trimesh

from fractal_farm.solid.formats.parsed import FloatArray, IntArray, MalformedError, Parsed, check_count, parsed_json

_METRES_Y_UP = np.array([[1e-3, 0.0, 0.0, 0.0], [0.0, 0.0, 1e-3, 0.0], [0.0, -1e-3, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_SILVER = {"name": "silver", "baseColorFactor": [0.86, 0.87, 0.89, 1.0], "metallicFactor": 1.0, "roughnessFactor": 0.3}
_MAX_JSON = 16 << 20
_MAX_NODES = 10_000
_JSON, _BIN = b"JSON", b"BIN\0"
_COMPONENTS = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_TRIANGLES = 4


def write(mesh: trimesh.Trimesh, facts: Mapping[str, Any]) -> bytes:
    """GLB with normals and a silver material."""
    copy = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    copy.apply_transform(_METRES_Y_UP)
    copy.metadata.update({**facts, "units": "m", "up": "y"})
    copy.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(**_SILVER))
    return cast(bytes, copy.export(file_type="glb", include_normals=True))


def read(content: bytes) -> Parsed:
    """All triangles of the default scene, as one mesh."""
    tree, binary = _chunks(content)
    if tree.get("extensionsRequired"):
        raise MalformedError(
            f"it needs the extension {str(tree['extensionsRequired'][0])[:60]}; export without compression"
        )
    vertices: list[FloatArray] = []
    faces: list[IntArray] = []
    corners = triangles = 0
    for mesh, transform in _instances(tree):
        for primitive in mesh["primitives"]:
            if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                continue
            points = _accessor(tree, binary, primitive["attributes"]["POSITION"], 3).astype(np.float64)
            if "indices" in primitive:
                indices = _accessor(tree, binary, primitive["indices"], 1).ravel().astype(np.int64)
            else:
                indices = np.arange(len(points), dtype=np.int64)
            triangles += len(indices) // 3
            check_count(triangles)
            check_count(corners // 3)
            vertices.append(points @ transform[:3, :3].T + transform[:3, 3])
            faces.append(indices.reshape(-1, 3) + corners)
            corners += len(points)
    if not faces:
        raise MalformedError("its scene has no triangles")
    return Parsed(np.concatenate(vertices), np.concatenate(faces), "m", 1000.0, "y", _facts(tree))


def _chunks(content: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary chunk."""
    if len(content) < 20 or content[:4] != b"glTF":
        raise MalformedError(
            "it does not begin like GLB" if content[:4] != b"glTF"[: len(content)] else "it is cut short"
        )
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2:
        raise MalformedError(f"it is glTF {version}, and 2 is read")
    if length > len(content):
        raise MalformedError(f"its header tells of {length} bytes, and it has {len(content)}")
    found: dict[bytes, bytes] = {}
    place = 12
    while place + 8 <= length:
        size = int.from_bytes(content[place : place + 4], "little")
        kind = content[place + 4 : place + 8]
        if place + 8 + size > length:
            raise MalformedError("a chunk is longer than the file")
        if kind == _JSON and size > _MAX_JSON:
            raise MalformedError("its JSON is longer than 16 MiB")
        if kind in (_JSON, _BIN):
            found.setdefault(kind, content[place + 8 : place + 8 + size])
        place += 8 + size
    if _JSON not in found:
        raise MalformedError("it has no JSON")
    return parsed_json(found[_JSON], "JSON"), found.get(_BIN, b"")


def _instances(tree: dict[str, Any]) -> Iterator[tuple[dict[str, Any], FloatArray]]:
    """The meshes of the default scene, each where it stands; a node that is met twice is refused."""
    nodes = tree["nodes"]
    scene = tree["scenes"][tree.get("scene", 0)]
    waiting = [(root, np.eye(4)) for root in scene["nodes"]]
    met: set[int] = set()
    while waiting:
        index, above = waiting.pop()
        if index in met or len(met) >= _MAX_NODES:
            raise MalformedError("its nodes are no tree, or too many")
        met.add(index)
        node = nodes[_place(index)]
        here = above @ _transform(node)
        if "mesh" in node:
            yield tree["meshes"][_place(node["mesh"])], here
        waiting += [(child, here) for child in node.get("children", [])]


def _transform(node: dict[str, Any]) -> FloatArray:
    if "matrix" in node:
        matrix: FloatArray = np.array(node["matrix"], np.float64).reshape(4, 4).T
        return matrix
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    matrix = np.asarray(trimesh.transformations.quaternion_matrix([w, x, y, z]), np.float64)
    matrix[:3, :3] *= np.array(node.get("scale", (1.0, 1.0, 1.0)), np.float64)
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _accessor(tree: dict[str, Any], binary: bytes, index: Any, width: int) -> npt.NDArray[Any]:
    """(n, width) numbers of an accessor, a view of the binary chunk."""
    accessor = tree["accessors"][_place(index)]
    if "bufferView" not in accessor or "sparse" in accessor:
        raise MalformedError("an accessor has no bytes of its own")
    if accessor["type"] != {1: "SCALAR", 3: "VEC3"}[width]:
        raise MalformedError(f"an accessor is a {str(accessor['type'])[:20]}")
    view = tree["bufferViews"][_place(accessor["bufferView"])]
    if view.get("buffer", 0) != 0 or "uri" in tree["buffers"][0]:
        raise MalformedError("its numbers lie in another file")
    kind = np.dtype(_COMPONENTS[accessor["componentType"]])
    count = _place(accessor["count"])
    start = _place(view.get("byteOffset", 0))
    inside = _place(accessor.get("byteOffset", 0))
    stride = _place(view.get("byteStride", kind.itemsize * width))
    length = _place(view["byteLength"])
    needed = inside + (count - 1) * stride + kind.itemsize * width if count else 0
    if stride < kind.itemsize * width or needed > length or start + length > len(binary):
        raise MalformedError("an accessor is longer than its bytes")
    return np.ndarray((count, width), kind, binary, start + inside, (stride, kind.itemsize))


def _facts(tree: dict[str, Any]) -> dict[str, Any]:
    """The extras that tell of a design, or the first that there are."""
    holders = [*tree.get("meshes", []), *tree.get("nodes", []), *tree.get("scenes", []), tree.get("asset", {}), tree]
    extras = [holder["extras"] for holder in holders if isinstance(holder.get("extras"), dict)]
    ours = [each for each in extras if "design_id" in each]
    return dict((ours or extras or [{}])[0])


def _place(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise MalformedError("a number in its JSON is out of range")
    return value
