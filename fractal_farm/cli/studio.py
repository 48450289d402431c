"""`farm studio` and `farm gallery`: a catalogue in a browser, with a server of its own or without any."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument
from fractal_farm.cli.output import AsJson, byte_count, print_json, say

if TYPE_CHECKING:
    from fractal_farm.catalogue import Catalogue


def studio(
    directory: DirectoryArgument,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of 127.0.0.1; 0 picks a free one.")] = 0,
    opened: Annotated[
        bool | None,
        typer.Option("--open/--no-open", help="Open a browser; default: where there is a screen.", show_default=False),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, max=64, help="Processes that make solids; default: half of the cores.", show_default=False),
    ] = None,
) -> None:
    """Look at a catalogue in a browser: gallery, tuning, breeding, solids to take home.

    It listens on 127.0.0.1 only and asks nothing of other machines. Who has the address with its token may write.
    Ctrl-C ends it.
    """
    from fractal_farm.studio.server import serve

    def ready(url: str) -> None:
        typer.echo(f"studio of {directory}: {url}")
        sys.stdout.flush()
        if _has_screen() if opened is None else opened:
            import webbrowser

            webbrowser.open(url)

    if serve(directory, port, workers=workers, ready=ready):
        say(f"breeding goes on; look with: farm status {directory}")


def gallery(
    directory: DirectoryArgument,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="SITE", help="New directory for the pages.")],
    where: Annotated[str | None, typer.Option(help="Only these designs, as for farm list.", show_default=False)] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Only the best so many.", show_default=False)] = None,
    as_json: AsJson = False,
) -> None:
    """Write the studio's pages for any web host: gallery, design pages and lineage, without a server.

    Every file of SITE goes to the host as it is, below any path.
    """
    from dataclasses import asdict

    from fractal_farm.catalogue import Catalogue
    from fractal_farm.studio.static_export import export_gallery

    catalogue = Catalogue.open(directory)
    rows, places = _chosen(catalogue, where)
    site = export_gallery(catalogue, out, rows, places[:limit])
    if as_json:
        print_json({"site": str(out), **asdict(site)})
    else:
        typer.echo(f"{out}: {site.designs:,} designs, {site.files:,} files, {byte_count(site.bytes)}")


def _chosen(catalogue: Catalogue, where: str | None) -> tuple[Any, Any]:
    """The manifest's rows, and the places of the designs that a filter is true of, best first."""
    import ast

    import numpy as np
    import pyarrow as pa

    from fractal_farm.catalogue import with_judgements
    from fractal_farm.catalogue.scan import indices
    from fractal_farm.catalogue.schema import DESIGN_SCHEMA
    from fractal_farm.cli.where import explained_selection, filter_expression, selection_of

    judged = where is not None and ("stars" in where or "favourite" in where)
    if not judged:
        expression, names = selection_of(where)
        with explained_selection(where):
            return catalogue.selection(expression, names)
    assert where is not None
    rows, places = catalogue.selection()
    schema = DESIGN_SCHEMA.append(pa.field("stars", pa.int8())).append(pa.field("favourite", pa.bool_()))
    expression = filter_expression(where, schema)
    named = {node.id for node in ast.walk(ast.parse(where.strip(), mode="eval")) if isinstance(node, ast.Name)}
    read = [name for name in DESIGN_SCHEMA.names if name in named or name == "design_id"]
    table = with_judgements(catalogue.path, rows.take(read, places))
    with explained_selection(where):
        found = table.append_column("place", indices(np.asarray(places))).filter(expression)
    return rows, found.column("place").to_numpy()


def _has_screen() -> bool:
    """Whether somebody would see a browser."""
    shown = sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    return bool(shown) and sys.stdout.isatty()
