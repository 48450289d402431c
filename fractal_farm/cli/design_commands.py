"""`farm score`, `farm render` and `farm mesh`: what can be made of a genome."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument, IdsArgument
from fractal_farm.cli.output import AsJson, check_png, print_json, print_table, say, write_file, write_png
from fractal_farm.errors import InputError

if TYPE_CHECKING:
    from fractal_farm.ifs.genome import Genome


class Colours(enum.StrEnum):
    """The paper's colourings."""

    GRADIENT = "gradient"
    DUAL = "dual"


class MeshFormat(enum.StrEnum):
    """File formats of meshes."""

    GLB = "glb"
    STL = "stl"
    PLY = "ply"


def score(
    genomes: Annotated[Path, typer.Argument(metavar="GENOMES", help="YAML file of genomes.")],
    config: Annotated[
        Path | None,
        typer.Option(help="Run configuration whose fitness and number of points to use.", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Score the genomes of a file.

    Selection probabilities, contraction ratios, D0, D2, LLE, fitness and similarity dimension.
    """
    from fractal_farm.config import RunConfig, load_genomes
    from fractal_farm.fitness import FitnessFormula, evaluate
    from fractal_farm.ifs.maps import selection_probabilities
    from fractal_farm.ifs.similarity_dimension import similarity_dimension

    evolution = (RunConfig.from_yaml(config) if config else RunConfig()).evolution
    named = load_genomes(genomes, evolution.phenotype.phenotype())
    formula = FitnessFormula(**evolution.fitness.model_dump())
    evaluation = evaluate([genome for _, genome in named], evolution.phenotype.points, formula)
    reports = [
        {
            "name": name,
            "design_id": genome.design_id,
            "n_maps": genome.n_maps,
            "symmetry": genome.symmetry,
            "probabilities": selection_probabilities(genome).tolist(),
            "ratios": _ratios(genome),
            "d0": float(evaluation.d0[index]),
            "d0_error": float(evaluation.d0_error[index]),
            "d2": float(evaluation.d2[index]),
            "d2_error": float(evaluation.d2_error[index]),
            "lle": float(evaluation.lle[index]),
            "fitness": float(evaluation.fitness[index]),
            "similarity_dimension": similarity_dimension(genome) if _is_similar(genome) else None,
        }
        for index, (name, genome) in enumerate(named)
    ]
    if as_json:
        print_json(reports)
        return
    print_table(
        ["genome", "P", "ratios", "D0", "D2", "LLE", "fitness", "Moran"],
        [
            [
                r["name"],
                r["probabilities"],
                r["ratios"],
                r["d0"],
                r["d2"],
                r["lle"],
                r["fitness"],
                r["similarity_dimension"],
            ]
            for r in reports
        ],
    )


def render(
    directory: DirectoryArgument,
    ids: IdsArgument,
    output: Annotated[Path, typer.Option("--output", "-o", help="PNG file to write.")],
    size: Annotated[int, typer.Option(min=16, max=4096, help="Pixels of a design's side.")] = 512,
    colours: Annotated[Colours, typer.Option(help="Colouring.")] = Colours.GRADIENT,
) -> None:
    """Draw designs as a picture or a sheet."""
    import math

    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.rows import genome_of
    from fractal_farm.picture import design_sheet, render_genome

    check_png("--output", output)
    catalogue = Catalogue.open(directory)
    rows = [catalogue.design(identity) for identity in ids]
    if len(rows) == 1:
        picture = render_genome(genome_of(rows[0]), size, colouring=colours.value)
    else:
        captioned = [(genome_of(row), f"{row['design_id'][:8]}  {row['fitness']:.3f}") for row in rows]
        picture = design_sheet(captioned, math.ceil(math.sqrt(len(rows))), size, colouring=colours.value)
    write_png(output, picture)


def mesh(
    directory: DirectoryArgument,
    ids: IdsArgument,
    output: Annotated[Path, typer.Option("--output", "-o", help="Directory for the files.")],
    size: Annotated[float, typer.Option(min=1, max=1000, help="Longest side of the solid, mm.")] = 30.0,
    wall: Annotated[float, typer.Option(min=0.01, max=100, help="Thinnest wall, mm.")] = 0.8,
    resolution: Annotated[
        int | None,
        typer.Option(
            min=32, max=1000, help="Voxels along the longest side; default: what the wall needs.", show_default=False
        ),
    ] = None,
    form: Annotated[list[MeshFormat] | None, typer.Option("--format", help="File format; may be repeated.")] = None,
    as_json: AsJson = False,
) -> None:
    """Make solids of designs: watertight meshes.

    Each is one piece, with the genome inside the file.
    """
    import json

    from fractal_farm.catalogue import Catalogue
    from fractal_farm.solid import SolidParameters, solid_files

    catalogue = Catalogue.open(directory)
    if output.exists() and not output.is_dir():
        raise InputError(f"{output}: is a file; name a directory")
    formats = tuple(dict.fromkeys(each.value for each in form or (MeshFormat.GLB, MeshFormat.STL)))
    parameters = SolidParameters(size, wall, resolution)
    reports = []
    for identity in [catalogue.design(identity)["design_id"] for identity in ids]:
        files = solid_files(catalogue.genome(identity), parameters, formats)
        paths = []
        for name, content in files.items():
            paths.append(output / f"{identity}{Path(name).suffix}")
            write_file(paths[-1], content)
        facts = json.loads(files["solid.json"])
        say(f"wrote {', '.join(map(str, paths))}")
        if facts["thickened"]:
            say(f"  its wall is {facts['wall_used_mm']:.2f} mm: its pieces lie {facts['gap_mm']:.2f} mm apart")
        reports.append({"design_id": identity, "files": list(map(str, paths)), **facts})
    if as_json:
        print_json(reports)


def _is_similar(genome: Genome) -> bool:
    return genome.phenotype.family == "similarity"


def _ratios(genome: Genome) -> list[float]:
    """Contraction ratio of each map: rho, or the cube root of |det A|."""
    import numpy as np

    from fractal_farm.ifs.genome import RHO
    from fractal_farm.ifs.maps import resolved_maps

    if _is_similar(genome):
        return [float(rho) for rho in genome.genes[:, RHO]]
    return [abs(float(np.linalg.det(linear))) ** (1 / 3) for linear in resolved_maps(genome)[:, :, :3]]
