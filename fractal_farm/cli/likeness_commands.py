"""`farm similar`, `farm prototypes` and `farm diff`: which designs are alike, and how different they can be."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fractal_farm.cli.catalogue_commands import DesignArgument, DirectoryArgument
from fractal_farm.cli.output import AsJson, check_png, print_facts, print_json, print_table, say, write_png
from fractal_farm.errors import InputError

if TYPE_CHECKING:
    from fractal_farm.catalogue.comparison import Comparison
    from fractal_farm.catalogue.similar import Similar

_SHEET_COLUMNS = 8
_TILE = 224
_LARGE_TILE = 512


def similar(
    directory: DirectoryArgument,
    design: Annotated[
        str | None, typer.Argument(metavar="[ID]", help="Design, or the first digits of its id.", show_default=False)
    ] = None,
    genome: Annotated[
        Path | None, typer.Option(help="Ask with the genomes of a YAML file instead.", show_default=False)
    ] = None,
    count: Annotated[int, typer.Option("--count", "-k", min=1, max=1000, help="How many designs.")] = 10,
    as_json: AsJson = False,
) -> None:
    """Find the designs that look like one, mirror images included.

    apart: of the signatures, from 1 on they are distinct. aligned: mean distance of the clouds laid upon each other, in
    radii of the shape. same shape: apart below 1 and aligned below 0.05.
    """
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.signatures import open_signatures
    from fractal_farm.catalogue.similar import similar_to_design, similar_to_genome
    from fractal_farm.genome_file import load_genomes

    if (design is None) == (genome is None):
        raise InputError("similar: to what? give an ID or --genome FILE, one of them")
    index = open_signatures(Catalogue.open(directory).path)
    if design is not None:
        found = {index.design_id(index.find(design)): similar_to_design(index, design, count)}
    else:
        assert genome is not None
        found = {name: similar_to_genome(index, asked, count) for name, asked in load_genomes(genome)}
    if as_json:
        print_json([{"asked": name, "similar": [_as_dict(hit) for hit in hits]} for name, hits in found.items()])
        return
    for name, hits in found.items():
        print_table(
            ["design_id", "apart", "aligned", "same shape", "fitness", "n_maps", "gap"],
            [[h.design_id, h.distance, h.aligned_distance, h.same_shape, h.fitness, h.n_maps, h.gap] for h in hits],
            title=f"like {name}",
        )


def prototypes(
    directory: DirectoryArgument,
    count: Annotated[int, typer.Option("--count", "-k", min=1, max=1000, help="How many designs.")] = 40,
    sheet: Annotated[Path | None, typer.Option(help="PNG file to draw them into.", show_default=False)] = None,
    as_json: AsJson = False,
) -> None:
    """Show the breadth of a catalogue: designs that stand for all, each with the number of those like it."""
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.prototypes import prototypes as chosen
    from fractal_farm.catalogue.rows import GENOME_COLUMNS, genome_of
    from fractal_farm.catalogue.signatures import open_signatures
    from fractal_farm.picture import design_sheet

    check_png("--sheet", sheet)
    index = open_signatures(Catalogue.open(directory).path)
    groups = chosen(index.marks, count)
    known = int(groups.sizes.sum())
    rows = [
        {
            "design_id": index.design_id(medoid),
            "designs": size,
            "share": size / known,
            "spread": spread,
            "fitness": float(index.fitness[medoid]),
            "n_maps": int(index.n_maps[medoid]),
            "gap": float(index.gap[medoid]),
        }
        for medoid, size, spread in zip(
            groups.medoids.tolist(), groups.sizes.tolist(), groups.spreads.tolist(), strict=True
        )
    ]
    if sheet is not None:
        genomes = [genome_of(row) for row in index.rows(groups.medoids, GENOME_COLUMNS)]
        captions = [f"{row['design_id'][:8]}  x {row['designs']:,}" for row in rows]
        picture = design_sheet(list(zip(genomes, captions, strict=True)), _SHEET_COLUMNS, _TILE)
        write_png(sheet, picture)
    if as_json:
        print_json(rows)
        return
    print_table(list(rows[0]), [list(row.values()) for row in rows])
    without = len(index) - known
    say(f"{len(rows)} prototypes of {known:,} designs" + (f"; {without:,} have no descriptor" if without else ""))


def diff(
    directory: DirectoryArgument,
    first: DesignArgument,
    second: Annotated[str, typer.Argument(metavar="ID", help="Another design.")],
    picture: Annotated[Path | None, typer.Option(help="PNG file to draw both into.", show_default=False)] = None,
    as_json: AsJson = False,
) -> None:
    """Compare two designs: genes, scores, shapes, descent."""
    from dataclasses import asdict

    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.comparison import compared
    from fractal_farm.catalogue.rows import genome_of
    from fractal_farm.picture import design_sheet

    check_png("--picture", picture)
    comparison = compared(Catalogue.open(directory), first, second)
    if picture is not None:
        designs = [(genome_of(row), f"{row['design_id'][:8]}  {row['fitness']:.3f}") for row in comparison.rows]
        write_png(picture, design_sheet(designs, 2, _LARGE_TILE))
    if as_json:
        facts = asdict(comparison)
        scores = [{**asdict(score), "deviations": score.deviations} for score in comparison.scores]
        print_json({**facts, "scores": scores, "rows": [row["design_id"] for row in comparison.rows]})
        return
    _print_comparison(comparison)


def _print_comparison(comparison: Comparison) -> None:
    from fractal_farm.catalogue.comparison import CLOUDS
    from fractal_farm.distinctness import DISTINCT
    from fractal_farm.ifs.symmetry import NO_SYMMETRY
    from fractal_farm.likeness import SAME_SHAPE

    ids = [row["design_id"] for row in comparison.rows]
    table: list[list[Any]] = []
    for number, (one, two) in enumerate(comparison.maps, start=1):
        table += [[f"{number} {ids[0][:8]}", *one]] if one is not None else []
        table += [[f"{number} {ids[1][:8]}", *two]] if two is not None else []
        if one is not None and two is not None:
            table.append([f"{number} differs by", *(b - a if a != b else None for a, b in zip(one, two, strict=True))])
    print_table(["map", "P", *comparison.numbers], table)
    typer.echo()
    print_table(
        ["score", *(f"{identity[:8]}" for identity in ids), f"mean of {CLOUDS}", "±", "mean ", "± ", "deviations"],
        [
            [s.name, *s.recorded, s.means[0], s.errors[0], s.means[1], s.errors[1], s.deviations]
            for s in comparison.scores
        ],
    )
    typer.echo()
    same = "they cover each other" if comparison.aligned_distance < SAME_SHAPE else "they do not meet"
    distinct = "distinct" if comparison.distance >= DISTINCT else "not distinct"
    ancestor = comparison.common_ancestor
    print_facts(
        {
            "symmetries": " and ".join(row["symmetry"] or NO_SYMMETRY for row in comparison.rows),
            "signatures apart": f"{comparison.distance:.4f} ({distinct})",
            "clouds apart": f"{comparison.aligned_distance:.4f} radii when laid upon each other ({same})",
            "common ancestor": "none on record"
            if ancestor is None
            else f"{ancestor[0]}, generations back from each: {ancestor[1]} and {ancestor[2]}",
        }
    )


def _as_dict(hit: Similar) -> dict[str, Any]:
    from dataclasses import asdict

    return {**asdict(hit), "same_shape": hit.same_shape}
