"""What is drawn and made solid: table 1 with fig 6, the scene of fig 7, the jewellery of figs 8 and 9, fig 10.

Each function makes its files in a directory of its own and returns what is worth telling, fit for JSON.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from fractal_farm.bench.genomes import TABLE1
from fractal_farm.catalogue import Catalogue
from fractal_farm.catalogue.documents import encoded_document
from fractal_farm.catalogue.durable import put
from fractal_farm.errors import InputError
from fractal_farm.experiments.paper.cases import OURS, Scale
from fractal_farm.experiments.paper.findings import table1_scores
from fractal_farm.experiments.paper.trial import catalogue_of
from fractal_farm.ifs.genome import as_genome
from fractal_farm.ifs.random_iteration import attractor_points
from fractal_farm.picture import captioned_sheet, cloud_picture, encoded, mesh_picture, render_genome, turntable
from fractal_farm.picture.metal import Metal
from fractal_farm.solid.certificate import certify
from fractal_farm.solid.files import mesh_files
from fractal_farm.solid.materials import material
from fractal_farm.solid.paper_grids import PAPER_GRIDS, paper_resolution
from fractal_farm.solid.pipeline import solidify

_FIG6_POINTS = 5_000
_TILE = 320
_VIEWS = 5
_METALS: dict[str, Metal] = {"J0698": "silver", "J0619": "gold"}
_PENDANT_MM, _WALL_MM = 30.0, 0.8
_CRISP = (1.5, 2.2)
_CONSIDERED = 2_000
SCENE = Path("configs/christmas_tree.yaml")
Facts = dict[str, Any]


def table1(directory: Path, scale: Scale) -> Facts:
    """The four genomes: scores, both colourings of fig 6, and solids as fine as the paper's grids."""
    pictures, rows, solids = [], [], {}
    for (name, genes), score in zip(TABLE1.items(), table1_scores(OURS, scale), strict=True):
        genome = as_genome(np.array(genes))
        solids[name] = mesh = solidify(genome, _PENDANT_MM, _WALL_MM, paper_resolution("J0619"))
        box = np.ptp(mesh.vertices, axis=0) / mesh.metadata["voxel_mm"]
        rows.append({"name": name, **score, "grid": np.ceil(box).astype(int).tolist(), **_solid(mesh)})
        _keep_solid(directory, name, mesh)
    for colours in ("gradient", "dual"):
        for name, genes in TABLE1.items():
            points = attractor_points(np.array(genes), _FIG6_POINTS)
            pictures.append((Image.fromarray(cloud_picture(points, _TILE, colours)), f"{name}, {colours}"))
    pictures += [(render_genome(np.array(genes), _TILE), f"{name}, even points") for name, genes in TABLE1.items()]
    pictures += [(Image.fromarray(mesh_picture(solids[name], _TILE)), f"{name}, solid") for name in TABLE1]
    put(directory / "fig6.png", encoded(captioned_sheet(pictures, len(TABLE1))))
    return {"rows": rows}


def fig7(directory: Path, scene_file: Path) -> Facts:
    """The Christmas tree, as picture, GLB and page."""
    from fractal_farm.picture.scene import compose
    from fractal_farm.picture.scene_file import load_scene
    from fractal_farm.picture.scene_files import scene_glb, scene_page
    from fractal_farm.picture.scene_picture import scene_picture

    if not scene_file.exists():
        raise InputError(f"{scene_file}: no such file; run in a clone of the repository, or name a scene with --scene")
    scene = compose(load_scene(scene_file), source=str(scene_file))
    put(directory / "fig7.glb", scene_glb(scene))
    put(directory / "fig7.html", scene_page(scene).encode())
    put(directory / "fig7.png", encoded(scene_picture(scene)))
    return {"things": [[thing.name, len(thing.points), len(thing.places)] for thing in scene.things]}


def jewellery(directory: Path, root: Path, scale: Scale) -> Facts:
    """Two pieces out of the catalogue of case 3, as near to the paper's boxes as there are, in silver and gold."""
    catalogue = Catalogue.open(catalogue_of(root, OURS.config("case3", scale)))
    columns = ["design_id", "fitness", "gap", "similarity_dimension", "width_mm", "depth_mm"]
    found = catalogue.designs(columns).slice(0, _CONSIDERED).to_pylist()
    pieces: list[Facts] = []
    sheets = []
    for jewel, metal in _METALS.items():
        taken = {piece["design_id"] for piece in pieces}
        row = min((row for row in found if row["design_id"] not in taken), key=lambda row: _unlike(row, jewel))
        genome, wall = catalogue.genome(row["design_id"]), material(metal).wall
        mesh = solidify(genome, _PENDANT_MM, wall, paper_resolution(jewel))
        _keep_solid(directory, jewel, mesh)
        views = turntable(mesh, _TILE, metal, 2 * _VIEWS)[:_VIEWS][::-1]  # rotated clockwise from left to right
        sheets += [(Image.fromarray(view), f"{jewel}, {metal}, view {k}") for k, view in enumerate(views, 1)]
        certificates = {}
        for name in ("silver", "gold"):
            made = certify(mesh, material(name))
            findings = [each.line for each in made.findings]
            certificates[name] = {"passes": made.passes, "grams": made.grams, "findings": findings}
        box = np.ptp(mesh.vertices, axis=0) / mesh.metadata["voxel_mm"]
        pieces.append(
            {
                "jewel": jewel,
                "metal": metal,
                "design_id": row["design_id"],
                "fitness": row["fitness"],
                "paper_grid": list(PAPER_GRIDS[jewel]),
                "grid": np.ceil(box).astype(int).tolist(),
                "certificates": certificates,
                **_solid(mesh),
            }
        )
    put(directory / "fig8.png", encoded(captioned_sheet(sheets, _VIEWS)))
    return {"pieces": pieces, "catalogue": str(catalogue.path)}


def fig10(directory: Path) -> Facts:
    """Sweeps of pitch, yaw, roll, d1 and rho, 10,000 points each, the original in the middle."""
    from fractal_farm.picture.sweep import paper_sweeps, sweep_sheet

    name = "06425"
    sweeps = paper_sweeps(np.array(TABLE1[name]))
    put(directory / "fig10.png", encoded(sweep_sheet(sweeps, 160)))
    return {"design": name, "rows": [sweep.label for sweep in sweeps]}


def _unlike(row: Facts, jewel: str) -> float:
    """How far a design is from being such a piece: from the proportions of the box; much if it does not suit at all."""
    long, middle, short = sorted(PAPER_GRIDS[jewel], reverse=True)
    width, depth = max(row["width_mm"] or 0.0, 0.1), max(row["depth_mm"] or 0.0, 0.1)
    unlike = abs(math.log(width / _PENDANT_MM * long / middle)) + abs(math.log(depth / _PENDANT_MM * long / short))
    suits = row["gap"] * _PENDANT_MM <= _WALL_MM and _CRISP[0] <= row["similarity_dimension"] <= _CRISP[1]
    return unlike + (0.0 if suits else 100.0)


def _solid(mesh: Any) -> Facts:
    return {name: mesh.metadata[name] for name in ("wall_used_mm", "thickened", "genus")} | {
        "watertight": bool(mesh.is_watertight),
        "bodies": len(mesh.split(only_watertight=False)),
        "faces": len(mesh.faces),
    }


def _keep_solid(directory: Path, name: str, mesh: Any) -> None:
    for file, content in mesh_files(mesh, ("stl", "glb")).items():
        put(directory / f"{name}{Path(file).suffix}", content)


def shape_figure(root: Path, name: str, scale: Scale, scene_file: Path) -> None:
    """Make one of them, unless its facts are there already."""
    if (root / name / "facts.json").exists():
        return
    makers = {
        "table1": lambda place: table1(place, scale),
        "fig7": lambda place: fig7(place, scene_file),
        "fig8": lambda place: jewellery(place, root, scale),
        "fig10": fig10,
    }
    facts = makers[name](root / name)
    put(root / name / "facts.json", encoded_document(facts))
