"""`farm score` and `farm render`: what can be told and seen of a genome."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument, IdsArgument
from fractal_farm.cli.output import AsJson, check_png, print_json, print_table, say, write_file, write_png
from fractal_farm.errors import InputError

if TYPE_CHECKING:
    from PIL import Image

    from fractal_farm.ifs.genome import Genome

_TURN_MS = 3_000
_QUALITY = 85  # of WebP


class Colours(enum.StrEnum):
    """The paper's colourings."""

    GRADIENT = "gradient"
    DUAL = "dual"


class Metals(enum.StrEnum):
    """What solids are drawn in."""

    GOLD = "gold"
    SILVER = "silver"
    COPPER = "copper"
    STEEL = "steel"


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
    output: Annotated[Path, typer.Option("--output", "-o", help="PNG file; a turntable is WebP or GIF.")],
    size: Annotated[int, typer.Option(min=16, max=4096, help="Pixels of a design's side.")] = 512,
    colours: Annotated[Colours, typer.Option(help="Colouring.")] = Colours.GRADIENT,
    metal: Annotated[Metals | None, typer.Option(help="Draw the solid in this metal.", show_default=False)] = None,
    turntable: Annotated[
        int | None, typer.Option(min=2, max=360, help="Pictures of a whole turn of the solid.", show_default=False)
    ] = None,
) -> None:
    """Draw designs: a picture, a sheet of several, or a turntable of one in metal."""
    import math

    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.rows import genome_of
    from fractal_farm.picture import captioned_sheet, design_sheet, render_genome

    if turntable is None:
        check_png("--output", output)
    elif output.suffix.lower() not in (".webp", ".gif"):
        raise InputError(f"--output {output}: a turntable moves; give a name that ends in .webp or .gif")
    elif len(ids) > 1:
        raise InputError(f"--turntable: {len(ids)} designs were given; give one")
    catalogue = Catalogue.open(directory)
    rows = [catalogue.design(identity) for identity in ids]
    designs = [(genome_of(row), f"{row['design_id'][:8]}  {row['fitness']:.3f}") for row in rows]
    columns = math.ceil(math.sqrt(len(rows)))
    if turntable is not None:
        write_file(output, _turning(designs[0][0], size, metal or Metals.GOLD, turntable, output.suffix[1:]))
        say(f"wrote {output}")
    elif metal is not None:
        pictures = [(_in_metal(genome, size, metal), caption) for genome, caption in designs]
        write_png(output, pictures[0][0] if len(rows) == 1 else captioned_sheet(pictures, columns))
    elif len(rows) == 1:
        write_png(output, render_genome(designs[0][0], size, colouring=colours.value))
    else:
        write_png(output, design_sheet(designs, columns, size, colouring=colours.value))


def _in_metal(genome: Genome, size: int, metal: Metals) -> Image.Image:
    """The solid of a design, 30 mm long with a wall of 0.8 mm."""
    from PIL import Image

    from fractal_farm.picture import mesh_picture
    from fractal_farm.solid import solidify

    return Image.fromarray(mesh_picture(solidify(genome), size, metal.value))


def _turning(genome: Genome, size: int, metal: Metals, frames: int, form: str) -> bytes:
    """The same, turning once in three seconds, as a WebP or GIF that repeats."""
    import io

    from PIL import Image

    from fractal_farm.picture import turntable
    from fractal_farm.solid import solidify

    first, *others = (Image.fromarray(frame) for frame in turntable(solidify(genome), size, metal.value, frames))
    content = io.BytesIO()
    duration = max(20, round(_TURN_MS / frames))
    first.save(content, form, save_all=True, append_images=others, duration=duration, loop=0, quality=_QUALITY)
    return content.getvalue()


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
