"""`farm certify`: may this mesh go to the shop, and if not, what would pass?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fractal_farm.cli.output import AsJson, check_writable, print_facts, print_json, say, write_file
from fractal_farm.errors import InputError

if TYPE_CHECKING:
    import trimesh

    from fractal_farm.solid.certificate import Certificate


def certify(
    source: Annotated[Path, typer.Argument(metavar="FILE|DIR", help="Mesh file, or directory of a catalogue.")],
    design: Annotated[
        str | None, typer.Argument(metavar="ID", help="With DIR: the design whose solid is made.", show_default=False)
    ] = None,
    material: Annotated[str, typer.Option(help="silver, gold, resin, nylon, steel or filament.")] = "silver",
    size: Annotated[
        float | None,
        typer.Option(min=1, max=1000, help="Of a design: longest side, mm; 30 by default.", show_default=False),
    ] = None,
    wall: Annotated[
        float | None,
        typer.Option(
            min=0.01, max=100, help="Of a design: thinnest wall, mm; the material's by default.", show_default=False
        ),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(help="Of a design: purpose and material, as for farm mesh.", show_default=False),
    ] = None,
    page: Annotated[Path | None, typer.Option(help="HTML page to write, with pictures.", show_default=False)] = None,
    as_json: AsJson = False,
) -> int:
    """Certify a mesh file, or the solid of a design, for a material.

    Exit code 0: it passes. 1: it does not; what is wrong, where, and what would help is printed.
    """
    from fractal_farm.solid.certificate import certify as examine
    from fractal_farm.solid.materials import material as profile_of

    profile = profile_of(material)
    if page is not None:
        check_writable(page)
    if design is None:
        if source.is_dir():
            raise InputError(f"{source}: is a directory; name a mesh file, or a design after it")
        if size is not None or wall is not None or preset is not None:
            raise InputError("--size, --wall and --preset are for designs; a file has its own")
        mesh, title = _read(source), source.name
    else:
        mesh = _made(source, design, preset, size, wall if wall is not None or preset else profile.wall)
        title = f"design {mesh.metadata['design_id'][:8]}"
    found = examine(mesh, profile)
    if page is not None:
        from fractal_farm.picture.certified import certificate_pictures
        from fractal_farm.solid.certificate_page import certificate_page

        write_file(page, certificate_page(found, profile, title, certificate_pictures(mesh, found)).encode())
        say(f"wrote {page}")
    if as_json:
        print_json({"source": str(source), **found.as_dict()})
    else:
        _print(title, found)
    return 0 if found.passes else 1


def _read(path: Path) -> trimesh.Trimesh:
    from fractal_farm.solid.reading import read_mesh

    return read_mesh(path)


def _made(
    directory: Path, design: str, preset: str | None, size_mm: float | None, wall_mm: float | None
) -> trimesh.Trimesh:
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.solid.pipeline import make_solid
    from fractal_farm.solid.presets import parameters_of

    parameters = parameters_of(preset, size_mm=size_mm, wall_mm=wall_mm)
    return make_solid(Catalogue.open(directory).genome(design), parameters)


def _print(title: str, found: Certificate) -> None:
    thickest = found.thickest
    typer.echo(f"{title}: {'passes' if found.passes else 'does not pass'} for {found.material}")
    for finding in found.findings:
        typer.echo(f"  {finding.line}")
    print_facts(
        {
            "wall": None if found.wall_mm is None else f"{found.wall_mm:.2f} mm of {found.wall_limit_mm:.2f} mm",
            "bodies": found.n_bodies,
            "box": " x ".join(f"{side:.4g}" for side in found.box_mm) + " mm",
            "volume": None if found.volume_mm3 is None else f"{found.volume_mm3:.4g} mm3",
            "mass": None if found.grams is None else f"{found.grams:.3g} g, {found.grams_polished:.3g} g polished",
            "thickest": None if thickest is None else f"{thickest.diameter_mm:.2f} mm",
            "overhang": f"{found.overhang_share:.1%}",
            "design": found.design_id,
            "sha256": found.mesh_sha256,
        }
    )
