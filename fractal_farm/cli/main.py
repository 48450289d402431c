"""The `farm` command: its subcommands, and the translation of errors into one line and an exit code.

0: done. 1: the farm could not do it, or `verify` found damage. 2: the input was wrong. 3: damage that
`verify --repair` could not undo. 130: interrupted. Results go to stdout, everything else to stderr. Nothing heavy
is imported here: each command imports what it needs when it runs.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Sequence
from typing import Annotated

import typer

from fractal_farm import __version__
from fractal_farm.cli import (
    bench,
    catalogue_commands,
    certify,
    design_commands,
    doctor,
    exchange_commands,
    experiment,
    hand_commands,
    jobs,
    likeness_commands,
    lineage,
    mirror,
    paper,
    run_commands,
    scene_commands,
    solid_commands,
    status,
    studio,
    verify,
)
from fractal_farm.errors import FarmError, InputError

app = typer.Typer(
    name="farm",
    help="Grows catalogues of printable 3D fractal designs.",
    epilog="Start with: farm submit configs/quickstart.yaml --out runs/quickstart",
    context_settings={"help_option_names": ["-h", "--help"]},
    add_completion=False,
    rich_markup_mode=None,  # rich doubles the time of --help
    pretty_exceptions_enable=False,
)
app.command("submit")(run_commands.submit)
app.command("resume")(run_commands.resume)
app.command("stop")(run_commands.stop)
app.command("status")(status.status)
app.command("report")(status.report)
app.add_typer(jobs.app, name="jobs")
app.command("list")(catalogue_commands.list_designs)
app.command("show")(catalogue_commands.show)
app.command("find")(scene_commands.find)
app.command("similar")(likeness_commands.similar)
app.command("prototypes")(likeness_commands.prototypes)
app.command("diff")(likeness_commands.diff)
app.command("lineage")(lineage.lineage)
app.command("score")(design_commands.score)
app.command("render")(design_commands.render)
app.command("scene")(scene_commands.scene)
app.command("sweep")(scene_commands.sweep)
app.command("morph")(scene_commands.morph)
app.command("mesh")(solid_commands.mesh)
app.command("certify")(certify.certify)
app.command("rate")(hand_commands.rate)
app.command("preference")(hand_commands.preference)
app.command("breed")(hand_commands.breed)
app.command("keep")(hand_commands.keep)
app.command("studio")(studio.studio)
app.command("gallery")(studio.gallery)
app.command("verify")(verify.verify)
app.command("mirror")(mirror.mirror)
app.command("fetch")(mirror.fetch)
app.command("reproduce")(verify.reproduce)
app.command("compact")(exchange_commands.compact)
app.command("export")(exchange_commands.export)
app.command("merge")(exchange_commands.merge)
app.command("doctor")(doctor.doctor)
app.command("bench")(bench.bench)
app.add_typer(experiment.app, name="experiment")
app.command("paper")(paper.paper)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: without the program's name; `sys.argv` if None.

    Returns:
        The exit code.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    words = [word for word in words if word != "--debug"] or ["--help"]
    try:
        result = app(args=words, prog_name="farm", standalone_mode=False)
        return result if isinstance(result, int) else 0
    except (Exception, KeyboardInterrupt) as error:
        if debug:
            traceback.print_exc()
        message, code = _translated(error)
        typer.echo(f"farm: error: {message}", err=True)
        return code


# Errors of the operating system that come of a path that somebody gave.
_WRONG_PATH = (FileExistsError, FileNotFoundError, IsADirectoryError, NotADirectoryError, PermissionError)


def _translated(error: BaseException) -> tuple[str, int]:
    """One line about an error, and the exit code."""
    if isinstance(error, typer.TyperException):
        return _usage(error), error.exit_code
    if isinstance(error, FarmError):
        return _one_line(error), 2 if isinstance(error, InputError) else 1
    if isinstance(error, (KeyboardInterrupt, typer.Abort)):
        return "interrupted", 130
    if isinstance(error, OSError):
        place = str(error.filename or "operating system").removesuffix(".partial")
        return _one_line(f"{place}: {error.strerror or error}"), 2 if isinstance(error, _WRONG_PATH) else 1
    what = _one_line(f"{type(error).__name__}: {error}")
    return f"unexpected {what}; run again with --debug and report what it prints", 1


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"farm {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version and exit.", callback=_print_version, is_eager=True),
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Grows catalogues of printable 3D fractal designs."""


def _usage(error: typer.TyperException) -> str:
    """What is wrong with the arguments, and where help is."""
    message = _one_line(error.format_message()).rstrip(".").replace(". Did", "; did")
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "farm"
    return f"{message[:1].lower()}{message[1:]}; see {command} --help"


def _one_line(text: object) -> str:
    return " ".join(str(text).split())
