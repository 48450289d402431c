"""The `farm` command: its subcommands, and the translation of errors into one line and an exit code.

0: done. 1: the farm could not do it. 2: the input was wrong. 130: interrupted. Results go to stdout,
everything else to stderr. Nothing heavy is imported here: each command imports what it needs when it runs.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from fractal_farm import __version__
from fractal_farm.cli import catalogue_commands, design_commands, doctor, run_commands
from fractal_farm.errors import FarmError, InputError

app = typer.Typer(
    name="farm",
    help="Grows catalogues of printable 3D fractal designs.",
    epilog="Start with: farm submit configs/quickstart.yaml --out runs/quickstart",
    context_settings={"help_option_names": ["-h", "--help"]},
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.command("submit")(run_commands.submit)
app.command("resume")(run_commands.resume)
app.command("status")(run_commands.status)
app.command("list")(catalogue_commands.list_designs)
app.command("show")(catalogue_commands.show)
app.command("score")(design_commands.score)
app.command("render")(design_commands.render)
app.command("mesh")(design_commands.mesh)
app.command("doctor")(doctor.doctor)


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
    except typer.TyperException as error:
        if debug:
            raise
        return _fail(f"{_one_line(error.format_message())}; see farm --help", error.exit_code)
    except FarmError as error:
        if debug:
            raise
        return _fail(_one_line(error), 2 if isinstance(error, InputError) else 1)
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted", 130)
    except OSError as error:
        if debug:
            raise
        return _fail(_one_line(f"{error.filename or 'operating system'}: {error.strerror or error}"), 1)
    except Exception as error:
        if debug:
            raise
        what = _one_line(f"{type(error).__name__}: {error}")
        return _fail(f"unexpected {what}; run again with --debug and report what it prints", 1)


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.", is_eager=True)] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,  # noqa: ARG001
) -> None:
    """Grows catalogues of printable 3D fractal designs."""
    if version:
        typer.echo(f"farm {__version__}")
        raise typer.Exit


def _fail(message: str, code: int) -> int:
    print(f"farm: error: {message}", file=sys.stderr)  # noqa: T201 - this is the one place that says it
    return code


def _one_line(text: object) -> str:
    return " ".join(str(text).split())
