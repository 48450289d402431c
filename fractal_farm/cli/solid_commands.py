"""`farm mesh`: solids of designs."""

from __future__ import annotations

import enum
import math
from pathlib import Path
from typing import Annotated, Any

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument, IdsArgument
from fractal_farm.cli.licence import LicenceOption, check_licence
from fractal_farm.cli.output import AsJson, print_json, say, write_file
from fractal_farm.errors import InputError


class MeshFormat(enum.StrEnum):
    """File formats of meshes."""

    GLB = "glb"
    THREE_MF = "3mf"
    STL = "stl"
    PLY = "ply"
    OBJ = "obj"


class Base(enum.StrEnum):
    """What a piece stands on."""

    NONE = "none"
    PLATE = "plate"
    STAND = "stand"


class Bail(enum.StrEnum):
    """What a piece hangs by."""

    NONE = "none"
    RING = "ring"


def mesh(
    directory: DirectoryArgument,
    ids: IdsArgument,
    output: Annotated[Path, typer.Option("--output", "-o", help="Directory for the files.")],
    preset: Annotated[
        str | None,
        typer.Option(
            help="Purpose and material, such as pendant-silver; the options below go before it.", show_default=False
        ),
    ] = None,
    size: Annotated[
        float | None,
        typer.Option(
            min=1, max=1000, help="Longest side, mm, without base, bail and sprue; default: 30.", show_default=False
        ),
    ] = None,
    wall: Annotated[
        float | None, typer.Option(min=0.01, max=100, help="Thinnest wall, mm; default: 0.8.", show_default=False)
    ] = None,
    resolution: Annotated[
        int | None,
        typer.Option(
            min=32, max=1000, help="Voxels along the longest side; default: what the wall needs.", show_default=False
        ),
    ] = None,
    grid: Annotated[
        str | None,
        typer.Option(
            help="Instead: a grid such as 85x199x144, or paper, whose longest side counts.",
            show_default=False,
        ),
    ] = None,
    bridge: Annotated[
        bool | None,
        typer.Option(
            "--bridge/--no-bridge",
            help="Join pieces that lie apart by struts, instead of a thicker wall.",
            show_default=False,
        ),
    ] = None,
    thicken: Annotated[
        bool | None,
        typer.Option(
            "--thicken/--no-thicken", help="Let the wall grow until all pieces meet; default: yes.", show_default=False
        ),
    ] = None,
    closing: Annotated[
        float | None,
        typer.Option(min=0, help="Radius below which creases are filled, mm; 0: none.", show_default=False),
    ] = None,
    shell: Annotated[
        float | None,
        typer.Option(min=0, help="Shell that stays where a piece is hollowed, mm; 0: solid.", show_default=False),
    ] = None,
    shell_above: Annotated[
        float | None,
        typer.Option(min=0, help="Thickness above which it is hollowed, mm; default: 4.", show_default=False),
    ] = None,
    drain: Annotated[
        float | None,
        typer.Option(min=0, help="Diameter of the holes into hollows, mm; default: 2.", show_default=False),
    ] = None,
    base: Annotated[Base | None, typer.Option(help="What it stands on.", show_default=False)] = None,
    bail: Annotated[Bail | None, typer.Option(help="What it hangs by.", show_default=False)] = None,
    bail_hole: Annotated[
        float | None, typer.Option(help="Inner diameter of the ring, mm; default: 3.", show_default=False)
    ] = None,
    engrave: Annotated[
        bool | None,
        typer.Option("--engrave/--no-engrave", help="The design code, under the base.", show_default=False),
    ] = None,
    sprue: Annotated[
        bool | None, typer.Option("--sprue/--no-sprue", help="A cone for casting, below.", show_default=False)
    ] = None,
    form: Annotated[list[MeshFormat] | None, typer.Option("--format", help="File format; may be repeated.")] = None,
    licence: LicenceOption = None,
    as_json: AsJson = False,
) -> None:
    """Make solids of designs: watertight meshes.

    Each is one piece, with the genome inside the file.
    """
    import json

    from fractal_farm.catalogue import Catalogue
    from fractal_farm.cli.stage_line import stage_line
    from fractal_farm.solid import make_solid
    from fractal_farm.solid.files import mesh_files
    from fractal_farm.solid.paper_grids import grid_resolution
    from fractal_farm.solid.presets import parameters_of

    if grid is not None:
        if resolution is not None:
            raise InputError(f"--grid {grid} says how fine, too; leave out --resolution {resolution}")
        resolution = grid_resolution(grid)
    parameters = parameters_of(
        preset,
        size_mm=size,
        wall_mm=wall,
        resolution=resolution,
        thicken=thicken,
        bridges=bridge,
        closing_mm=closing,
        shell_mm=shell,
        shell_above_mm=shell_above,
        drain_mm=drain,
        base=base and base.value,
        bail=bail and bail.value,
        bail_hole_mm=bail_hole,
        engrave=engrave,
        sprue=sprue,
    )
    check_licence(licence)
    catalogue = Catalogue.open(directory)
    if output.exists() and not output.is_dir():
        raise InputError(f"{output}: is a file; name a directory")
    formats = tuple(dict.fromkeys(each.value for each in form or (MeshFormat.GLB, MeshFormat.STL)))
    reports = []
    for identity in [catalogue.design(identity)["design_id"] for identity in ids]:
        with stage_line(identity[:8]) as line:
            mesh = make_solid(catalogue.genome(identity), parameters, line.stage, line.memory)
            files = mesh_files(mesh, formats, {"licence": licence} if licence else None)
        paths = []
        for name, content in files.items():
            paths.append(output / f"{identity}{Path(name).suffix}")
            write_file(paths[-1], content)
        facts = json.loads(files["solid.json"])
        say(f"wrote {', '.join(map(str, paths))}")
        if grid is not None:
            voxels = " x ".join(f"{side / facts['voxel_mm']:.0f}" for side in facts["box_mm"])
            say(f"  its grid is {voxels} voxels of {facts['voxel_mm']:.3g} mm")
        _tell_wall(facts)
        if facts["thickened"]:
            say(f"  its wall is {facts['wall_used_mm']:.2f} mm: its pieces lie {facts['gap_mm']:.2f} mm apart")
        if facts.get("struts"):
            say(f"  struts join its pieces, which lie {facts['gap_mm']:.2f} mm apart: {facts['struts']}")
        if facts.get("hollows"):
            say(f"  {facts['hollowed_share']:.0%} of it is hollow, with a drain each: {facts['hollows']}")
        reports.append({"design_id": identity, "files": list(map(str, paths)), **facts})
    if as_json:
        print_json(reports)


def _tell_wall(facts: dict[str, Any]) -> None:
    """What was done for the wall, and what would help if it is too thin all the same."""
    from fractal_farm.solid.findings import WALL_TOLERANCE

    measured, limit = facts["wall_measured_mm"], WALL_TOLERANCE * facts["wall_mm"]
    if facts.get("pits_filled_mm"):
        say(f"  pits narrower than {2.0 * facts['pits_filled_mm']:.2f} mm are filled: they left no wall")
    if not measured >= limit:
        closing = math.ceil(200.0 * facts["voxel_mm"]) / 100.0
        wall = math.ceil(100.0 * (facts["wall_used_mm"] + limit - measured)) / 100.0
        say(
            f"  its wall is too thin, {measured:.2f} mm of {limit:.2f} mm at the 1 % quantile: "
            f"--closing {closing:g} fills creases, or --wall {wall:g}, or a higher --resolution"
        )
