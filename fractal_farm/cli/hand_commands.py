"""`farm rate`, `farm preference`, `farm breed` and `farm keep`: what a person decides about designs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument, IdsArgument
from fractal_farm.cli.output import AsJson, print_facts, print_json, print_table, results_only_on_stdout, say
from fractal_farm.cli.run_commands import (
    AddressOption,
    ExecutorName,
    ExecutorOption,
    RunOption,
    SetOption,
    report_end,
    saying_how_to_resume,
)
from fractal_farm.errors import InputError
from fractal_farm.farm.interrupts import listening
from fractal_farm.ifs.symmetry import ALLOWED

if TYPE_CHECKING:
    from fractal_farm.catalogue import Judgement

_LIKES_SHOWN = 5


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


def preference(directory: DirectoryArgument, as_json: AsJson = False) -> None:
    """What your judgements say that you like, and how well that tells about designs that you have not judged.

    It needs 30 judged designs. farm list DIR --sort preference ranks by it.
    """
    from dataclasses import asdict

    from fractal_farm.hand.preference import Interval, preference_of

    model = preference_of(directory)
    if as_json:
        intervals = {name: getattr(model, name)._asdict() for name in ("accuracy", "fitness_accuracy", "advantage")}
        print_json({**asdict(model), **intervals, "looks_at": dict(model.looks_at), "verdict": model.verdict})
        return

    def shown(interval: Interval) -> str:
        return f"{interval.value:.2f} ({interval.low:.2f} to {interval.high:.2f})"

    likes = [f"{'more' if seen > 0 else 'less'} {name} ({seen:+.2f})" for name, seen in model.looks_at[:_LIKES_SHOWN]]
    print_facts(
        {
            "judged designs": model.judged,
            "pairs told rightly": f"{shown(model.accuracy)} of those held out, with 95 % interval; a coin tells 0.50",
            "by fitness alone": shown(model.fitness_accuracy),
            "advantage": shown(model.advantage),
            "verdict": model.verdict,
            "likes": "\n".join(likes),
        }
    )


@listening()
def breed(
    directory: DirectoryArgument,
    ids: Annotated[
        list[str] | None, typer.Argument(metavar="[ID...]", help="Designs, or the first digits of their ids.")
    ] = None,
    from_favourites: Annotated[bool, typer.Option("--favourites", help="Breed from all favourites.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="NEW", help="New directory for the catalogue; default: DIR-bred.", show_default=False
        ),
    ] = None,
    into: Annotated[bool, typer.Option("--into", help="Add the run to DIR instead.")] = False,
    steered: Annotated[
        bool, typer.Option("--steer", help="No new run: a live or interrupted run of DIR breeds from them, too.")
    ] = False,
    run: RunOption = None,
    address: AddressOption = None,
    executor: ExecutorOption = None,
    overrides: SetOption = None,
    as_json: AsJson = False,
) -> int:
    """Breed from chosen designs: a new run whose only founders they are.

    One generation of 1024 candidates whose genes are moved by .02 to .1, so that the children resemble their parents.
    Choose among them and breed again; --set evolution.seed=N gives other children, and --set stop.epochs=3
    grandchildren, which wander further.
    """
    from fractal_farm.hand.breeding import favourites

    if bool(ids) == from_favourites:
        raise InputError("give the IDs of the designs to breed from, or --favourites")
    chosen = favourites(directory) if from_favourites else list(ids or ())
    given = {"--out": out, "--into": into, "--address": address, "--executor": executor, "--set": overrides}
    if steered and (superfluous := [name for name, value in given.items() if value]):
        raise InputError(f"{superfluous[0]}: not together with --steer, which goes on with a run as it is")
    if steered:
        return _steer(directory, chosen, run, as_json)
    if run is not None:
        raise InputError("--run: only together with --steer; a new run is bred otherwise")
    if into and out is not None:
        raise InputError("--out and --into: leave one of them out")
    return _breed(directory, chosen, None if into else out, into, address, executor, overrides, as_json)


def _breed(
    directory: Path,
    ids: list[str],
    out: Path | None,
    into: bool,
    address: str | None,
    executor: ExecutorName | None,
    overrides: list[str] | None,
    as_json: bool,
) -> int:
    from fractal_farm import farm
    from fractal_farm.cli.progress import progress_display
    from fractal_farm.hand.breeding import breeding_config, founders_of

    founders = founders_of(directory, ids)
    config = breeding_config(founders, overrides or ())
    target = directory if into else out if out is not None else _beside(directory)
    say(f"breeding from {', '.join(identity[:8] for identity in founders.design_ids)}")
    for name, before, now in founders.lowered(config):
        say(f"  {name} is {now:g} instead of {before:g}, which not all of them reach")
    with saying_how_to_resume(target), results_only_on_stdout(), progress_display() as display:
        summary = farm.submit(
            config,
            target,
            address=address,
            executor=executor.value if executor else None,
            into=into,
            callbacks=[display],
        )
    return report_end(summary, as_json)


def _beside(directory: Path) -> Path:
    """Where a bred catalogue goes if nobody says: beside the one that its founders come from."""
    named = directory if directory.name not in ("", "..") else directory.resolve()
    return named.with_name(f"{directory.resolve().name}-bred")


def _steer(directory: Path, ids: list[str], run: str | None, as_json: bool) -> int:
    from dataclasses import asdict

    from fractal_farm.hand.steering import steer

    steered = steer(directory, ids, run=run, said=lambda: say("the wish is recorded; waiting for the run"))
    request = steered.request
    if as_json:
        print_json(asdict(steered))
    else:
        print_facts(
            {
                "run": steered.run_id,
                "breeds from": "\n".join(request.design_ids),
                "in epochs": f"{request.first} to {request.last}; {steered.epochs} are committed",
            }
        )
    if not steered.live:
        further = f" --set stop.epochs={request.last + 1}" if steered.beyond else ""
        say(f"go on with: farm resume {directory}{further}")
    return 0


def keep(
    directory: DirectoryArgument,
    source: Annotated[
        str, typer.Argument(metavar="GENOMES", help="YAML file of genomes, see farm score; with --symmetry: a design.")
    ],
    parents: Annotated[
        list[str] | None,
        typer.Option("--parent", metavar="ID", help="Design that they were made from; may be repeated."),
    ] = None,
    symmetry: Annotated[
        str | None,
        typer.Option(metavar="NAME", help=f"Keep a design of this symmetry: {ALLOWED}.", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Keep variants that were made by hand: designs of the catalogue, with cloud, scores and lineage.

    farm keep DIR ID --symmetry rotation:6 keeps a symmetric child of a design.
    """
    from fractal_farm.genome_file import load_genomes
    from fractal_farm.hand.breeding import chosen_rows, origin_of
    from fractal_farm.hand.keeping import keep as store
    from fractal_farm.hand.keeping import keep_symmetric

    if symmetry is not None:
        if parents:
            raise InputError("--parent: not together with --symmetry, whose parent is the design itself")
        rows = keep_symmetric(directory, source, symmetry)
    else:
        phenotype = origin_of(directory, chosen_rows(directory, parents or ())).evolution.phenotype.phenotype()
        rows = store(directory, [genome for _, genome in load_genomes(source, phenotype)], parents or ())
    columns = ["design_id", "fitness", "d0", "d2", "lle", "n_maps", "symmetry", "gap"]
    if as_json:
        print_json(rows)
    else:
        print_table(columns, [[row[name] for name in columns] for row in rows])
