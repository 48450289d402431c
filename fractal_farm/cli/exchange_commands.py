"""`farm compact`, `farm export` and `farm merge`: whole catalogues, tidied, published and put together."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument
from fractal_farm.cli.licence import LicenceOption, check_licence
from fractal_farm.cli.output import AsJson, byte_count, print_json, say


def compact(directory: DirectoryArgument, as_json: AsJson = False) -> None:
    """Merge small files of the manifest into large ones: a large catalogue is read many times faster.

    Nothing that a catalogue tells is changed. Runs do this themselves as they grow.
    """
    from fractal_farm.catalogue.compaction import compact_all
    from fractal_farm.catalogue.signatures import open_signatures

    done = compact_all(directory)
    open_signatures(directory)  # written now, so that nobody waits for it later
    if as_json:
        print_json(asdict(done))
    elif done.before:
        saved = f"{byte_count(abs(done.bytes))} {'more' if done.bytes > 0 else 'less'}"
        say(f"merged {done.before:,} files of the manifest into {done.after:,}, {saved}")
    else:
        say("nothing to merge")


def export(
    directory: DirectoryArgument,
    to: Annotated[Path, typer.Option("--to", metavar="OUT", help="New directory.")],
    where: Annotated[
        str | None, typer.Option(help="Filter, such as 'fitness > 0.9 and n_maps == 3'.", show_default=False)
    ] = None,
    licence: LicenceOption = None,
    clouds: Annotated[bool, typer.Option(help="Publish the point clouds, too.")] = True,
    as_json: AsJson = False,
) -> None:
    """Publish designs as files that need no farm: one sorted Parquet table, one dense Zarr array of clouds.

    With a STAC-like collection.json and checksums. OUT appears when it is complete.
    """
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.export import NO_LICENCE
    from fractal_farm.catalogue.export import export as publish
    from fractal_farm.cli.where import explained_selection, selection_of

    check_licence(licence)
    expression, names = selection_of(where)
    told = {} if where is None else {"farm:where": where}
    with explained_selection(where):
        done = publish(
            Catalogue.open(directory), to, expression, names, clouds=clouds, licence=licence or NO_LICENCE, told=told
        )
    if licence is None:
        say("no licence is given, so others may not use it; --licence CC-BY-4.0 would let them, naming you")
    if as_json:
        print_json(asdict(done))
    else:
        which = f" and {done.clouds:,} clouds" if done.clouds else ""
        say(f"{to}: {done.designs:,} designs{which}, {byte_count(done.bytes)}")


def merge(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="New directory for the catalogue.")],
    directories: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Catalogues.")],
    as_json: AsJson = False,
) -> None:
    """Put several catalogues together in a new one; they stay as they are.

    Each design counts once. The column distinct marks the best of each shape. Runs keep their records: farm resume
    OUT --run ID goes on with one of them.
    """
    from fractal_farm.farm.merging import merge as put_together

    done = put_together(out, directories)
    if as_json:
        print_json(asdict(done))
    else:
        runs = "1 run" if len(done.runs) == 1 else f"{len(done.runs)} runs"
        say(f"{out}: {done.designs:,} designs of {runs}, {done.distinct:,} of them distinct")
