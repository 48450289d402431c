"""3MF (core specification 1.3): a zip of XML, in millimetres, with all facts as metadata.

The facts stand under a namespace of our own, which is declared: names without one are reserved. Archives are read
with Python's expat as a stream, so that a document that grows out of a small archive fills no memory.
"""

from __future__ import annotations

import io
import json
import zipfile
from array import array
from collections.abc import Iterator, Mapping
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

import numpy as np
import trimesh

from fractal_farm.solid.formats.parsed import (
    MAX_FACTS_BYTES,
    MAX_VERTICES,
    FloatArray,
    IntArray,
    MalformedError,
    Parsed,
    check_count,
    parsed_json,
)

NAMESPACE = "urn:fractal-farm:solid:1"
FACTS = "facts"

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_MODEL = "3D/3dmodel.model"
_EARLIEST = (1980, 1, 1, 0, 0, 0)
_MAX_XML = 1 << 29
_MAX_PARTS = 1_000
_MAX_COMPONENTS = 10_000
_CHUNK = 1 << 20
_UNITS_MM = {"micron": 1e-3, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8, "meter": 1000.0}
_CONTENT_TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
    "</Types>\n"
)
_RELATIONSHIPS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Target="/{_MODEL}" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
    "</Relationships>\n"
)


def write(mesh: trimesh.Trimesh, facts: Mapping[str, Any]) -> bytes:
    """3MF of one object; the same bytes whenever it is written."""
    name = f"Fractal Farm {facts.get('design_code') or facts.get('design_id', 'solid')}"
    told = {
        "Title": name,
        "Designer": facts.get("designer", "Fractal Farm"),
        "Description": f"Attractor of an iterated function system, design {facts.get('design_id', 'unknown')}",
        "Application": f"Fractal Farm {facts.get('software_version', '')}".rstrip(),
        "LicenseTerms": facts.get("licence"),
        f"farm:{FACTS}": json.dumps(facts, sort_keys=True, separators=(",", ":")),
    }
    corners = np.asarray(mesh.vertices, np.float32).tolist()
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<model unit="millimeter" xml:lang="en-GB" xmlns="{_CORE}" xmlns:farm="{NAMESPACE}">',
        *(f'<metadata name="{key}">{escape(str(value))}</metadata>' for key, value in told.items() if value),
        "<resources>",
        '<basematerials id="1"><base name="silver" displaycolor="#DBDEE3"/></basematerials>',
        f'<object id="2" type="model" name={quoteattr(name)} pid="1" pindex="0"><mesh><vertices>',
        *map('<vertex x="%.9g" y="%.9g" z="%.9g"/>'.__mod__, map(tuple, corners)),
        "</vertices><triangles>",
        *map('<triangle v1="%d" v2="%d" v3="%d"/>'.__mod__, map(tuple, mesh.faces.tolist())),
        "</triangles></mesh></object>",
        "</resources>",
        '<build><item objectid="2"/></build>',
        "</model>\n",
    ]
    parts = {"[Content_Types].xml": _CONTENT_TYPES, "_rels/.rels": _RELATIONSHIPS, _MODEL: "\n".join(lines)}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for part, text in parts.items():
            info = zipfile.ZipInfo(part, _EARLIEST)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system, info.external_attr = 3, 0o644 << 16
            archive.writestr(info, text.encode())
    return buffer.getvalue()


def read(content: bytes) -> Parsed:
    """All objects that the model is to be built of, as one mesh."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if len(archive.infolist()) > _MAX_PARTS:
                raise MalformedError(f"it has more than {_MAX_PARTS} parts")
            model = _Model(archive)
    except zipfile.BadZipFile:
        raise MalformedError("it is no 3MF package, or cut short") from None
    except expat.ExpatError as error:
        raise MalformedError(f"its model is not XML: {expat.ErrorString(error.code)}") from None
    vertices: list[FloatArray] = []
    faces: list[IntArray] = []
    corners = triangles = 0
    for mesh, transform in model.placed():
        points, indices = mesh
        triangles += len(indices)
        check_count(triangles)
        vertices.append(points @ transform[:3] + transform[3])
        faces.append(indices + corners)
        corners += len(points)
    if not triangles:
        raise MalformedError("nothing in it is to be built")
    return Parsed(
        np.concatenate(vertices), np.concatenate(faces), model.unit, _UNITS_MM[model.unit], facts=model.facts()
    )


class _Model:
    """The 3D model part of a package, as the parser walks over it."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self.unit = "millimeter"
        self._meshes: dict[str, tuple[FloatArray, IntArray]] = {}
        self._components: dict[str, list[tuple[str, FloatArray]]] = {}
        self._items: list[tuple[str, FloatArray]] = []
        self._metadata: dict[str, str] = {}
        self._object = ""
        self._named: str | None = None
        self._corners = array("d")
        self._indices = array("q")
        self._parser = parser = expat.ParserCreate(namespace_separator="}")
        parser.buffer_text = True
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text
        parser.StartDoctypeDeclHandler = self._doctype
        self._prefixes: dict[str, str] = {}
        parser.StartNamespaceDeclHandler = lambda prefix, uri: self._prefixes.setdefault(prefix or "", uri or "")
        self._walk(archive)

    def facts(self) -> dict[str, Any]:
        """Our own facts; of other programs' files, the metadata with plain names."""
        for name, value in self._metadata.items():
            prefix, _, local = name.rpartition(":")
            if local == FACTS and self._prefixes.get(prefix) == NAMESPACE:
                return parsed_json(value, "metadata of Fractal Farm")
        return {name: value for name, value in self._metadata.items() if ":" not in name}

    def placed(self) -> Iterator[tuple[tuple[FloatArray, IntArray], FloatArray]]:
        """The meshes that the build names, each with its (4, 3) transform."""
        waiting = list(self._items)
        for _ in range(_MAX_COMPONENTS):
            if not waiting:
                return
            name, transform = waiting.pop()
            if name in self._meshes:
                yield self._meshes[name], transform
            elif name not in self._components:
                raise MalformedError("it builds an object that it does not have")
            for child, inner in self._components.get(name, []):
                waiting.append((child, np.vstack([inner[:3] @ transform[:3], inner[3] @ transform[:3] + transform[3]])))
        raise MalformedError(f"it builds more than {_MAX_COMPONENTS} objects")

    def _walk(self, archive: zipfile.ZipFile) -> None:
        names = [name for name in archive.namelist() if name.lower().endswith(".model")]
        if not names:
            raise MalformedError("it has no 3D model")
        name = _MODEL if _MODEL in names else min(names)
        read = 0
        with archive.open(name) as part:
            while chunk := part.read(_CHUNK):
                read += len(chunk)
                if read > _MAX_XML:
                    raise MalformedError("its model unpacks to more than 512 MiB")
                self._parser.Parse(chunk, False)
        self._parser.Parse(b"", True)

    def _start(self, name: str, has: dict[str, str]) -> None:
        tag = name.rpartition("}")[2]
        if tag == "vertex":
            self._corners.extend((float(has["x"]), float(has["y"]), float(has["z"])))
            if len(self._corners) > 3 * MAX_VERTICES:
                raise MalformedError(f"it has more than {MAX_VERTICES} vertices")
        elif tag == "triangle":
            self._indices.extend((int(has["v1"]), int(has["v2"]), int(has["v3"])))
        elif tag == "object":
            self._object = has["id"]
            self._components[self._object] = []
        elif tag == "component":
            self._components[self._object].append((has["objectid"], _transform(has)))
        elif tag == "item":
            self._items.append((has["objectid"], _transform(has)))
        elif tag == "model":
            self.unit = has.get("unit", self.unit)
            if self.unit not in _UNITS_MM:
                raise MalformedError(f"its unit is {self.unit[:20]!r}")
        elif tag == "metadata" and not self._object:
            self._named = has["name"]
            self._metadata[self._named] = ""

    def _end(self, name: str) -> None:
        tag = name.rpartition("}")[2]
        self._named = None
        if tag == "mesh":
            corners = np.array(self._corners, np.float64).reshape(-1, 3)
            indices = np.array(self._indices, np.int64).reshape(-1, 3)
            check_count(len(indices))
            if len(indices) and not (indices.min() >= 0 and indices.max() < len(corners)):
                raise MalformedError("a face names a vertex that is not there")
            self._meshes[self._object] = corners, indices
            self._corners, self._indices = array("d"), array("q")
        elif tag == "object":
            self._object = ""

    def _text(self, text: str) -> None:
        if self._named is not None:
            self._metadata[self._named] += text
            if len(self._metadata[self._named]) > MAX_FACTS_BYTES or len(self._metadata) > _MAX_PARTS:
                raise MalformedError("its metadata are longer than 1 MiB")

    def _doctype(self, *_: Any) -> None:
        raise MalformedError("its model declares a document type")


def _transform(has: dict[str, str]) -> FloatArray:
    """(4, 3): three rows of the linear part and the offset, for row vectors, as 3MF writes them."""
    if any(name.rpartition("}")[2] == "path" for name in has):
        raise MalformedError("its objects lie in several models; export one")
    numbers = [float(word) for word in has.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split()]
    return np.array(numbers, np.float64).reshape(4, 3)
