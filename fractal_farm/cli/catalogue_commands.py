"""`farm list` and `farm show`: the designs of a catalogue as tables, files and facts."""

from __future__ import annotations

import enum
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fractal_farm.cli.output import AsJson, plain, print_facts, print_json, print_table, say, write_file
from fractal_farm.errors import InputError
from fractal_farm.ifs.design_code import design_code
from fractal_farm.ifs.symmetry import NO_SYMMETRY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from fractal_farm.catalogue import Catalogue, SolidInfo

DirectoryArgument = Annotated[Path, typer.Argument(metavar="DIR", help="Directory of the catalogue.")]

IdsArgument = Annotated[list[str], typer.Argument(metavar="ID...", help="Designs: ids, their first digits, or codes.")]
DesignArgument = Annotated[str, typer.Argument(metavar="ID", help="Design: its id, first digits of it, or its code.")]

_SHORT_COLUMNS = ("design_id", "fitness", "d0", "d2", "lle", "n_maps", "gap", "grams", "island", "generation")
_SYMMETRY = "symmetry"
_JUDGED_COLUMNS = ("stars", "favourite")
_PREFERENCE = "preference"
_TABLE_ROWS = 20


class Format(enum.StrEnum):
    """How a list of designs is written."""

    TABLE = "table"
    CSV = "csv"
    JSON = "json"
    PARQUET = "parquet"


def list_designs(
    directory: DirectoryArgument,
    where: Annotated[
        str | None, typer.Option(help="Filter, such as 'fitness > 0.9 and n_maps == 3'.", show_default=False)
    ] = None,
    sort: Annotated[str, typer.Option(help="Column, with desc for the largest first.")] = "fitness desc",
    limit: Annotated[
        int | None,
        typer.Option(min=1, help="Number of designs; default: 20 in a table, all in a file.", show_default=False),
    ] = None,
    columns: Annotated[
        str | None,
        typer.Option(help="Columns, with commas between; 'all' for every column.", show_default=False),
    ] = None,
    ancestors: Annotated[
        bool, typer.Option("--ancestors", help="Also parents that were not kept themselves (kind: ancestor).")
    ] = False,
    form: Annotated[Format, typer.Option("--format", help="How to write them.")] = Format.TABLE,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File to write; default: stdout.", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List designs, filtered and sorted.

    Beside the columns of the manifest there are stars and favourite, and preference, the stars that farm preference
    expects: --where "stars >= 4 or favourite", --sort preference.
    """
    from fractal_farm.catalogue import Catalogue

    form = Format.JSON if as_json else form
    if form is Format.PARQUET and output is None and sys.stdout.isatty():
        raise InputError("--format parquet: not for a terminal; give a file with --output")
    if form is Format.TABLE and limit is None:
        limit = _TABLE_ROWS
    catalogue = Catalogue.open(directory)
    table, total = _listed(catalogue, where, sort, limit, columns, form, ancestors=ancestors)
    if form is Format.TABLE and output is None:
        print_table(table.column_names, [list(row.values()) for row in table.to_pylist()])
        typer.echo(f"{table.num_rows} of {total} designs", err=True)
    elif form is Format.JSON and output is None:
        print_json(table.to_pylist())
    else:
        _deliver(_encoded(table, form), output)


def show(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR|FILE", help="Directory of the catalogue, or a mesh file or solid.json.")
    ],
    design: Annotated[
        str | None,
        typer.Argument(metavar="[ID]", help="Design: its id, first digits of it, or its code.", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Show one design: genome, scores, lineage, files. Of a file: what it is and what it carries."""
    if design is None:
        from fractal_farm.cli.mesh_file import show_file

        show_file(directory, as_json)
        return
    if directory.is_file():
        raise InputError(f"{directory}: is a file; show it without a design, or name a catalogue's directory")
    from fractal_farm.catalogue import Catalogue, judgements
    from fractal_farm.catalogue.layout import HAND
    from fractal_farm.ifs.genome import GENE_NAMES, ROW_LENGTH

    catalogue = Catalogue.open(directory)
    row = catalogue.design(design)
    width = ROW_LENGTH[row["family"]]
    genes = [row["genes"][k : k + width] for k in range(0, len(row["genes"]), width)]
    maps = [row["maps"][k : k + 12] for k in range(0, len(row["maps"]), 12)]
    solids = catalogue.solids(row["design_id"])
    files = _files(catalogue, row, solids)
    certificates = [told for solid in solids if (told := solid.certificate) is not None]
    code = design_code(row["design_id"])
    judgement = judgements(directory).get(row["design_id"])
    if as_json:
        judged = {"stars": judgement and judgement.stars, "favourite": bool(judgement and judgement.favourite)}
        told = {**row, **judged, "design_code": code}
        print_json({**told, "genes": genes, "maps": maps, "files": files, "certificates": certificates})
        return
    print_facts(
        {
            "design": row["design_id"],
            "code": code,
            "judgement": judgement and str(judgement),
            "fitness": row["fitness"],
            "D0": _with_error(row["d0"], row["d0_error"]),
            "D2": _with_error(row["d2"], row["d2_error"]),
            "LLE": f"{row['lle']:.6f} nats an iteration",
            "similarity dimension": row["similarity_dimension"],
            "gap": row["gap"],
            "in silver": _as_a_solid(row),
            "parents": row["parents"] or "none",
            "operator": row["operator"],
            "born": "by hand"
            if row["run_id"] == HAND
            else f"run {row['run_id']}, island {row['island']}, epoch {row['epoch']}, "
            f"generation {row['generation']}, slot {row['slot']}",
            "phenotype": f"{row['family']}, {row['map_form']}, rotation sign {row['rotation_sign']}, "
            f"influence {row['influence']:g}",
            "symmetry": row["symmetry"] or NO_SYMMETRY,
            "points": row["n_points"],
            "files": ", ".join(files) or "no mesh; make one with farm mesh",
            "certificate": "; ".join(map(_certified, certificates)) or None,
        }
    )
    typer.echo()
    names = GENE_NAMES if row["family"] == "similarity" else [f"a{k}" for k in range(1, 13)]
    print_table(
        ["map", "P", *names],
        [[k, p, *gene] for k, (p, gene) in enumerate(zip(row["probabilities"], genes, strict=True), start=1)],
    )


def _listed(
    catalogue: Catalogue,
    where: str | None,
    sort: str,
    limit: int | None,
    columns: str | None,
    form: Format,
    *,
    ancestors: bool,
) -> tuple[Any, int]:
    """The first designs of a selection with their judgements, and how many it has."""
    from fractal_farm.catalogue import with_judgements
    from fractal_farm.catalogue.schema import DESIGN_SCHEMA

    told = [words or "" for words in (where, sort, columns)]
    if not any(name in words for name in (*_JUDGED_COLUMNS, _PREFERENCE) for words in told):
        # Nothing is read but the columns that decide, and the rows that are shown.
        read = (*_SHORT_COLUMNS, _SYMMETRY) if columns is None and form is Format.TABLE else DESIGN_SCHEMA.names
        read = read if columns is None or columns.strip() == "all" else [name.strip() for name in columns.split(",")]
        known = [name for name in ("design_id", *read) if name in DESIGN_SCHEMA.names]
        table, total = _selected(catalogue, [*dict.fromkeys(known)], where, sort, limit, ancestors=ancestors)
        table = with_judgements(catalogue.path, table)
    else:
        table = with_judgements(catalogue.path, catalogue.designs(ancestors=ancestors))
        if any(_PREFERENCE in words for words in told):
            table = _with_preference(catalogue.path, table)
        table = _sorted(table, where, f"{sort} desc" if sort.strip() == _PREFERENCE else sort)
        total = table.num_rows
        table = table.slice(0, limit)
    return table.select(_chosen(columns, form, table)), total


def _with_preference(directory: Path, table: Any) -> Any:
    """The table with the stars that each design would get, and a word about how far that is to be trusted."""
    from fractal_farm.hand.preference import preference_of, with_preference

    model = preference_of(directory)
    if not model.useful:
        say(f"preference: {model.verdict} (farm preference {directory})")
    return with_preference(table, model)


def _selected(
    catalogue: Catalogue, columns: list[str], where: str | None, sort: str, limit: int | None, *, ancestors: bool
) -> tuple[Any, int]:
    """Designs by columns of the manifest alone."""
    from fractal_farm.catalogue.schema import DESIGN_SCHEMA
    from fractal_farm.cli.where import explained_selection, selection_of

    name, descending = _order(sort, DESIGN_SCHEMA)
    expression, names = selection_of(where)
    with explained_selection(where):
        return catalogue.select(columns, expression, names, (name, descending), limit, ancestors=ancestors)


def _sorted(table: Any, where: str | None, sort: str) -> Any:
    """A table of designs, filtered and sorted."""
    from fractal_farm.cli.where import explained_selection, filter_expression

    name, descending = _order(sort, table.schema)
    if where is not None:
        expression = filter_expression(where, table.schema)
        with explained_selection(where):
            table = table.filter(expression)
    keys = [(name, "descending" if descending else "ascending")]
    return table.sort_by(keys if name == "design_id" else [*keys, ("design_id", "ascending")])


def _order(sort: str, schema: Any) -> tuple[str, bool]:
    """The column to sort by, and whether the largest come first."""
    import pyarrow as pa

    name, _, direction = sort.strip().partition(" ")
    direction = direction.strip().lower()
    if name not in schema.names or direction not in ("", "asc", "desc"):
        raise InputError(f"--sort {sort!r}: give a column, with asc or desc; columns: {', '.join(_all_columns())}")
    if pa.types.is_nested(schema.field(name).type):
        raise InputError(f"--sort {sort!r}: a list cannot be sorted; choose a column of single values")
    return name, direction == "desc"


def _all_columns() -> list[str]:
    from fractal_farm.catalogue.schema import DESIGN_SCHEMA

    return [*DESIGN_SCHEMA.names, *_JUDGED_COLUMNS, _PREFERENCE]


def _chosen(columns: str | None, form: Format, table: Any) -> list[str]:
    """The columns to show; a short table has those of symmetry and judgements once there are any."""
    known: list[str] = table.column_names
    if columns is None and form is not Format.TABLE:
        return known
    if columns is None:
        judged = table.column("stars").null_count < len(table) or True in table.column("favourite").to_pylist()
        ranked = [name for name in (_PREFERENCE,) if name in known]
        symmetric = set(table.column(_SYMMETRY).to_pylist()) - {None, NO_SYMMETRY}
        told = [*((_SYMMETRY,) if symmetric else ()), *(_JUDGED_COLUMNS if judged else ())]
        return [*_SHORT_COLUMNS, *told, *ranked]
    chosen = known if columns.strip() == "all" else [name.strip() for name in columns.split(",")]
    for name in chosen:
        if name not in known:
            raise InputError(f"--columns: unknown column {name!r}; the columns are {', '.join(_all_columns())}")
    return list(dict.fromkeys(chosen))


def _encoded(table: Any, form: Format) -> bytes:
    """A table as the bytes of a file; CSV and JSON have lists in JSON's notation."""
    import csv
    import io
    import json

    from pyarrow import parquet

    if form is Format.PARQUET:
        buffer = io.BytesIO()
        parquet.write_table(table, buffer, compression="zstd")
        return buffer.getvalue()
    if form is Format.CSV:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(table.column_names)
        for row in table.to_pylist():
            writer.writerow([json.dumps(cell) if isinstance(cell, list) else cell for cell in row.values()])
        return text.getvalue().encode()
    if form is Format.JSON:
        return json.dumps(plain(table.to_pylist()), indent=2).encode() + b"\n"
    lines = [table.column_names, *(row.values() for row in table.to_pylist())]
    return "".join("\t".join(map(str, line)) + "\n" for line in lines).encode()


def _deliver(content: bytes, output: Path | None) -> None:
    if output is not None:
        write_file(output, content)
        typer.echo(f"wrote {output}", err=True)
    else:
        sys.stdout.buffer.write(content)
        sys.stdout.buffer.flush()


def _with_error(value: float | None, error: float | None) -> str | None:
    if value is None or error is None:
        return None if value is None else f"{value:.4f}"
    return f"{value:.4f} ± {error:.4f}"


def _as_a_solid(row: dict[str, Any]) -> str | None:
    """What the design weighs, at the size that all designs are compared at."""
    if row["grams"] is None:
        return None
    from fractal_farm.solid.parameters import SolidParameters
    from fractal_farm.solid.plan import plan_solid

    standard = SolidParameters(size_mm=30.0, wall_mm=0.8)
    plan = plan_solid(row["gap"], standard, row["design_id"][:8])
    wall = f"{2.0 * plan.radius_mm:.1f} mm, so that its pieces meet" if plan.thickened else "0.8 mm"
    box = f"30 x {row['width_mm']:.0f} x {row['depth_mm']:.0f} mm"
    return f"about {row['grams']:.1f} g, {box} with a wall of {wall}; without struts, and not hollowed"


def _certified(told: dict[str, Any]) -> str:
    """A stored certificate in one line: the verdict, what speaks against the solid, and what would help."""
    failures = [found for found in told["findings"] if found["severity"] == "failure"]
    against = "".join(f"; {found['what']}: {found['how_much']}; {found['remedy']}" for found in failures)
    return f"{'passes' if told['verdict'] == 'pass' else 'does not pass'} for {told['material']}{against}"


def _files(catalogue: Any, row: dict[str, Any], solids: Sequence[SolidInfo]) -> list[str]:
    """Where the design's cloud and solids lie, relative to the catalogue."""
    cloud = []
    if row["cloud_row"] is not None:
        cloud = [f"clouds/{row['writer']}/{row['cloud_array']}[{row['cloud_row']}]"]
    return cloud + [str(path.relative_to(catalogue.path)) for solid in solids for path in solid.files.values()]
