"""`farm rate`, `farm preference`, `farm breed` and `farm keep`: what a person decides about designs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument
from fractal_farm.cli.output import AsJson, print_json, print_table
from fractal_farm.errors import InputError

if TYPE_CHECKING:
    from fractal_farm.catalogue import Judgement

IdsArgument = Annotated[list[str], typer.Argument(metavar="ID...", help="Designs, or the first digits of their ids.")]


def rate(
    directory: DirectoryArgument,
    ids: IdsArgument,
    stars: Annotated[
        int | None, typer.Option(min=0, max=5, help="How good they are, 0 to 5; 0 rejects.", show_default=False)
    ] = None,
    favourite: Annotated[
        bool | None, typer.Option("--favourite/--unfavourite", help="Whether they are favourites.", show_default=False)
    ] = None,
    reject: Annotated[bool, typer.Option("--reject", help="No stars, and no favourites.")] = False,
    clear: Annotated[bool, typer.Option("--clear", help="Take back what was said of them.")] = False,
    as_json: AsJson = False,
) -> None:
    """Judge designs: stars, favourites. What is said last of a design counts.

    farm list DIR --where "stars >= 4 or favourite" finds them again.
    """
    from fractal_farm.catalogue import Catalogue, judge, withdraw

    ways = [stars is not None or favourite is not None, reject, clear]
    if sum(ways) != 1:
        raise InputError("give --stars, --favourite or --unfavourite (or both), or --reject, or --clear")
    catalogue = Catalogue.open(directory)
    designs = [catalogue.design(identity)["design_id"] for identity in ids]
    if clear:
        judged = withdraw(directory, designs)
    elif reject:
        judged = judge(directory, designs, stars=0, favourite=False)
    else:
        judged = judge(directory, designs, stars=stars, favourite=favourite)
    _report_judgements(judged, as_json)


def _report_judgements(judged: dict[str, Judgement], as_json: bool) -> None:
    if as_json:
        print_json([{"design_id": d, "stars": j.stars, "favourite": j.favourite} for d, j in judged.items()])
        return
    print_table(["design_id", "judgement"], [[identity, str(judgement)] for identity, judgement in judged.items()])
