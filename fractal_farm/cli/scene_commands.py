"""`farm scene`, `farm sweep`, `farm morph` and `farm find`: several designs, or one that changes, in one picture."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument
from fractal_farm.cli.design_commands import Colours
from fractal_farm.cli.output import (
    AsJson,
    check_png,
    check_writable,
    print_json,
    print_table,
    say,
    write_file,
    write_png,
)
from fractal_farm.errors import InputError

if TYPE_CHECKING:
    from fractal_farm.ifs.genome import Genome
    from fractal_farm.picture.scene import Asked

_TURN_MS = 6_000
_SWEEP_MS = 120
_MORPH_MS = 60
_TILE = 224
_SHEET_COLUMNS = 8

SourceArgument = Annotated[
    list[str], typer.Argument(metavar="DIR ID | GENOMES.yaml", help="A design of a catalogue, or a file of genomes.")
]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="File to write.")]
ColoursOption = Annotated[Colours, typer.Option(help="Colouring.")]
PointsOption = Annotated[int, typer.Option(min=100, max=1_000_000, help="Points of each picture, at most.")]


def scene(
    file: Annotated[Path, typer.Argument(metavar="SCENE", help="YAML file of a scene.")],
    output: Annotated[Path, typer.Option("--out", "-o", help="PNG, GLB or HTML; a turntable is WebP, GIF or MP4.")],
    catalogue: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Catalogue for objects with design or like.", show_default=False)
    ] = None,
    width: Annotated[int, typer.Option(min=16, max=8192, help="Pixels.")] = 900,
    height: Annotated[int, typer.Option(min=16, max=8192, help="Pixels.")] = 1200,
    turntable: Annotated[
        int | None, typer.Option(min=2, max=360, help="Pictures of a whole turn.", show_default=False)
    ] = None,
    meshes: Annotated[bool, typer.Option("--meshes", help="Coarse solids in the GLB instead of points.")] = False,
) -> None:
    """Draw designs together: placed, turned, coloured, hung on each other."""
    from PIL import Image

    from fractal_farm.picture.animation import SUFFIXES, animated, check_video
    from fractal_farm.picture.scene import compose
    from fractal_farm.picture.scene_file import load_scene
    from fractal_farm.picture.scene_files import scene_glb, scene_page
    from fractal_farm.picture.scene_picture import scene_picture, scene_turntable

    suffix = output.suffix.lower()
    allowed = SUFFIXES if turntable else (".png", ".glb", ".html")
    if suffix not in allowed:
        what = "a turntable moves" if turntable else "a scene is a picture, a model or a page"
        raise InputError(f"--out {output}: {what}; give a name that ends in {', '.join(allowed)}")
    if meshes and suffix != ".glb":
        raise InputError("--meshes: only a GLB has them; give a name that ends in .glb")
    check_video(suffix)
    check_writable(output)
    composed = compose(load_scene(file), _asked(catalogue, file), str(file))
    if suffix == ".glb":
        write_file(output, scene_glb(composed, meshes=meshes))
    elif suffix == ".html":
        write_file(output, scene_page(composed).encode())
    elif turntable:
        frames = [Image.fromarray(each) for each in scene_turntable(composed, width, height, turntable)]
        write_file(output, animated(frames, suffix, max(20, round(_TURN_MS / turntable))))
    else:
        write_png(output, Image.fromarray(scene_picture(composed, width, height)))
        return
    say(f"wrote {output}")


def sweep(
    source: SourceArgument,
    output: OutOption,
    map_number: Annotated[int, typer.Option("--map", min=1, help="Which map, from 1 on.")] = 1,
    gene: Annotated[str, typer.Option(help="pitch, yaw, roll, rho, d1, d2 or d3.")] = "pitch",
    step: Annotated[str, typer.Option(help="A number, a share such as 3%, or an angle such as pi/60.")] = "pi/60",
    steps: Annotated[int, typer.Option(help="Number of pictures, odd: the original is in the middle.")] = 9,
    paper: Annotated[bool, typer.Option("--paper", help="The paper's five rows as one sheet (figure 10).")] = False,
    size: Annotated[int, typer.Option(min=16, max=2048, help="Pixels of a picture's side.")] = 224,
    colours: ColoursOption = Colours.GRADIENT,
    points: PointsOption = 10_000,
) -> None:
    """Draw what one gene does: a row of pictures, or an animation, with the design in the middle."""
    from fractal_farm.picture.animation import SUFFIXES, animated, check_video
    from fractal_farm.picture.sweep import paper_sweeps, step_of, sweep_pictures, sweep_sheet, swept

    suffix = _checked(output, ".png" if paper else None)
    check_video(suffix)
    genome = _one_genome(source, "sweep")
    rows = paper_sweeps(genome, steps) if paper else [swept(genome, map_number, gene, step_of(step), steps)]
    if suffix in SUFFIXES:
        pictures = sweep_pictures(rows[0], size, colours.value, points)
        write_file(output, animated(pictures, suffix, _SWEEP_MS, back=True))
        say(f"wrote {output}")
    else:
        write_png(output, sweep_sheet(rows, size, colours.value, points))


def morph(
    directory: DirectoryArgument,
    first: Annotated[str, typer.Argument(metavar="ID", help="Design to begin with.")],
    second: Annotated[str, typer.Argument(metavar="ID", help="Design to end with.")],
    output: OutOption,
    frames: Annotated[int, typer.Option(min=2, max=1000, help="Number of pictures.")] = 36,
    size: Annotated[int, typer.Option(min=16, max=2048, help="Pixels of a picture's side.")] = 320,
    colours: ColoursOption = Colours.GRADIENT,
    points: PointsOption = 20_000,
    as_json: AsJson = False,
) -> None:
    """Change one design into another, by way of designs: an animation there and back, or a PNG with all pictures.

    With --json, the genome, D0, D2, LLE and fitness of each.
    """
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.fitness import evaluate
    from fractal_farm.picture import captioned_sheet
    from fractal_farm.picture.animation import animated, check_video
    from fractal_farm.picture.morph import morph_genomes, morph_pictures

    suffix = _checked(output, None)
    check_video(suffix)
    catalogue = Catalogue.open(directory)
    ends = catalogue.genome(first), catalogue.genome(second)
    genomes = morph_genomes(*ends, frames)
    told = [ends[0], *genomes[1:-1], ends[1]]
    scores = evaluate(told) if as_json or suffix == ".png" else None
    pictures = morph_pictures(genomes, size, colours.value, points)
    if suffix == ".png":
        captions = [f"{value:.3f}" for value in scores.fitness] if scores else []
        write_png(output, captioned_sheet(list(zip(pictures, captions, strict=True)), _SHEET_COLUMNS))
    else:
        write_file(output, animated(pictures, suffix, _MORPH_MS, back=True))
        say(f"wrote {output}")
    if as_json:
        print_json([_scored(genome, scores, index, frames) for index, genome in enumerate(told)])


def find(
    directory: DirectoryArgument,
    description: Annotated[
        str, typer.Argument(metavar="WORD", help="star, snowflake, ribbon, conch, ball, disc or needle.")
    ],
    count: Annotated[int, typer.Option("--count", "-k", min=1, max=1000, help="How many designs.")] = 10,
    among: Annotated[int, typer.Option(min=1, max=1_000_000, help="Look at the fittest so many, 30 ms each.")] = 1_000,
    where: Annotated[
        str | None, typer.Option(help="Filter, such as 'gap < 0.02'; see farm list.", show_default=False)
    ] = None,
    sheet: Annotated[Path | None, typer.Option(help="PNG file to draw them into.", show_default=False)] = None,
    as_json: AsJson = False,
) -> None:
    """Find designs by what they look like: a star, a ribbon, a conch; star-like means the same."""
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.finding import find_designs
    from fractal_farm.cli.where import explained_selection, selection_of
    from fractal_farm.picture import design_sheet

    check_png("--sheet", sheet)
    condition, names = selection_of(where)
    with explained_selection(where):
        found = find_designs(Catalogue.open(directory), description, count, among, condition, names)
    if sheet is not None and found:
        designs = [(each.genome, f"{each.design_id[:8]}  {each.likeness.score:.2f}") for each in found]
        write_png(sheet, design_sheet(designs, _SHEET_COLUMNS, _TILE))
    if as_json:
        print_json(
            [
                {
                    "design_id": each.design_id,
                    "score": each.likeness.score,
                    "parts": each.likeness.parts,
                    "fitness": each.fitness,
                }
                for each in found
            ]
        )
        return
    print_table(
        ["design_id", "score", "fitness", "because of"],
        [[each.design_id, each.likeness.score, each.fitness, each.likeness.explained()] for each in found],
    )


def _asked(directory: Path | None, file: Path) -> Asked | None:
    """Who finds the designs of a scene in a catalogue; nobody without one."""
    if directory is None:
        return None
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.finding import best_of, measured_designs
    from fractal_farm.description import checked_description
    from fractal_farm.picture.scene_file import ObjectSection

    catalogue = Catalogue.open(directory)
    measured = functools.cache(lambda: measured_designs(catalogue))

    def asked(each: ObjectSection) -> Genome:
        if each.design is not None:
            return catalogue.genome(each.design)
        assert each.like is not None
        checked_description(each.like)
        found = best_of(measured(), each.like, each.rank)
        if len(found) < each.rank:
            raise InputError(f"{file}: object {each.name}: rank is {each.rank}; {directory} has {len(found)} designs")
        say(f"{each.name}: {found[-1].design_id}  {found[-1].likeness.explained()}")
        return found[-1].genome

    return asked


def _one_genome(source: list[str], command: str) -> Genome:
    """The genome of a design in a catalogue, or the first or the named one of a file."""
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.genome_file import load_genomes

    place = Path(source[0])
    if len(source) > 2:
        raise InputError(f"{command}: {len(source)} arguments; give DIR ID, or GENOMES.yaml and the name of one")
    if place.is_dir():
        if len(source) == 1:
            raise InputError(f"{command} {place}: which design? give its id after the directory")
        return Catalogue.open(place).genome(source[1])
    named = load_genomes(place)
    if len(source) == 1:
        return named[0][1]
    for name, genome in named:
        if name == source[1]:
            return genome
    raise InputError(f"{place}: no genome {source[1]}; it has {', '.join(name for name, _ in named)}")


def _checked(output: Path, only: str | None) -> str:
    """The suffix of a picture or an animation, and whether it can be written."""
    from fractal_farm.picture.animation import SUFFIXES

    suffix = output.suffix.lower()
    allowed = (only,) if only else (".png", *SUFFIXES)
    if suffix not in allowed:
        raise InputError(f"--out {output}: give a name that ends in {', '.join(allowed)}")
    check_writable(output)
    return suffix


def _scored(genome: Genome, scores: Any, index: int, frames: int) -> dict[str, Any]:
    from fractal_farm.picture.morph import morph_shares

    return {
        "share": morph_shares(frames)[index],
        "design_id": genome.design_id,
        "genes": genome.genes,
        **{name: float(getattr(scores, name)[index]) for name in ("d0", "d2", "lle", "fitness")},
    }
