"""A scene as files for other programs: GLB with coloured points or low meshes, and a page that shows it turning.

GLB has y up and, as everywhere in glTF, metres: a unit of the scene is one. Copies share what they consist of. The page
is one HTML file that asks for nothing else; points are stored in 16 bits a coordinate.
"""

from __future__ import annotations

import base64
import html
import importlib.resources
import json
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from fractal_farm.picture.scene import Scene, Thing

_Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
_MESH_RESOLUTION = 96  # voxels
_MESH_SIZE_MM = 30.0
_MESH_WALL_MM = 1.0
_METALLIC = {"metallicFactor": 1.0, "roughnessFactor": 0.3}
_STEPS = 65_535


def scene_glb(scene: Scene, *, meshes: bool = False) -> bytes:
    """A scene as GLB.

    Args:
        scene: what `compose` returns.
        meshes: the objects as coarse solids instead of points.

    Raises:
        FarmError: an object has no solid.
    """
    import trimesh

    whole = trimesh.Scene()
    for number, thing in enumerate(scene.things):
        geometry = _solid(thing) if meshes else trimesh.PointCloud(thing.points, colors=_bytes(thing.colours))
        for copy, matrix in enumerate(thing.places):
            node = f"{thing.name} {copy + 1}" if len(thing.places) > 1 else thing.name
            name = f"{number} {thing.name}"
            if copy == 0:
                whole.add_geometry(geometry, node_name=node, geom_name=name, transform=_Y_UP @ matrix)
            else:
                whole.graph.update(node, matrix=_Y_UP @ matrix, geometry=name)
    return cast(bytes, whole.export(file_type="glb"))


def scene_page(scene: Scene) -> str:
    """A scene as one HTML page: drag to turn, wheel to come nearer."""
    copies = [(thing, copy) for thing in scene.things for copy in range(len(thing.places))]
    points = np.concatenate([thing.placed(copy) for thing, copy in copies])
    low, high = scene.box()
    extent = float((high - low).max()) or 1.0
    steps = np.round((points - low) / extent * _STEPS).astype("<u2")
    colours = np.concatenate([thing.colours for thing, _ in copies])
    radii = [thing.radius * float(np.cbrt(abs(np.linalg.det(thing.places[copy, :3, :3])))) for thing, copy in copies]
    facts = {
        "middle": (0.5 * (high - low) / extent).tolist(),
        "turn": scene.camera.turn,
        "tilt": scene.camera.tilt,
        "groups": [[len(thing.points), radius / extent] for (thing, _), radius in zip(copies, radii, strict=True)],
        "ground": scene.ground,
    }
    page = importlib.resources.files("fractal_farm.picture").joinpath("scene_page.html").read_text()
    replacements = {
        "TITLE": html.escape(scene.title or "Scene"),
        "FACTS": json.dumps(facts).replace("<", "\\u003c"),
        "POINTS": base64.b64encode(steps.tobytes()).decode(),
        "COLOURS": base64.b64encode(_bytes(colours)[:, :3].tobytes()).decode(),
    }
    for name, text in replacements.items():
        page = page.replace(f"@{name}@", text)
    return page


def _bytes(colours: npt.NDArray[np.float64]) -> npt.NDArray[np.uint8]:
    opaque = np.concatenate([np.clip(colours, 0.0, 1.0), np.ones((len(colours), 1))], axis=1)
    return np.round(255.0 * opaque).astype(np.uint8)


def _solid(thing: Thing) -> Any:
    """The coarse solid of a thing in its box, in its colours or metal."""
    import trimesh
    from scipy.spatial import cKDTree

    from fractal_farm.solid import solidify

    mesh = solidify(thing.genome, _MESH_SIZE_MM, _MESH_WALL_MM, resolution=_MESH_RESOLUTION)
    vertices = np.asarray(mesh.vertices) @ thing.turn.T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    vertices = (vertices - 0.5 * (low + high)) / float((high - low).max())
    if thing.metal is not None:
        material = trimesh.visual.material.PBRMaterial(
            name=thing.metal, baseColorFactor=[*thing.colours[0].tolist(), 1.0], **_METALLIC
        )
        return trimesh.Trimesh(
            vertices, mesh.faces, process=False, visual=trimesh.visual.TextureVisuals(material=material)
        )
    nearest = cKDTree(thing.points).query(vertices)[1]
    return trimesh.Trimesh(vertices, mesh.faces, process=False, vertex_colors=_bytes(thing.colours[nearest]))
