"""What commands print: results to stdout as tables or JSON, messages to stderr."""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fractal_farm.errors import InputError

if TYPE_CHECKING:
    from PIL.Image import Image
    from rich.console import Console
    from rich.table import Table
    from rich.tree import Tree

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]

_PLAIN_WIDTH = 240
_UNBOUNDED_WIDTH = 100_000


def say(message: str) -> None:
    """A message for the person at the terminal, on stderr."""
    typer.echo(message, err=True)


def print_json(value: Any) -> None:
    """A result as JSON: floats with all their digits, no NaN."""
    typer.echo(json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False))


def plain(value: Any) -> Any:
    """A value as JSON has it: tuples and arrays as lists, times in ISO 8601, what is not finite as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return str(value)


def print_table(columns: Sequence[str], rows: Sequence[Sequence[Any]], title: str | None = None) -> None:
    """A table; numbers to the right. On a narrow terminal texts give way; elsewhere lines have their full width."""
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for index, name in enumerate(columns):
        numeric = all(isinstance(row[index], (int, float)) or row[index] is None for row in rows)
        table.add_column(name, justify="right" if numeric else "left", no_wrap=numeric, overflow="ellipsis")
    for row in rows:
        table.add_row(*(text(cell) for cell in row))
    console = _console()
    if not console.is_terminal:
        _widen(console, table)
    console.print(table)


def print_tree(tree: Tree) -> None:
    """A tree; its lines have their full width, however deep it is."""
    console = _console()
    _widen(console, tree)
    console.print(tree)


def print_facts(facts: Mapping[str, Any]) -> None:
    """Names and values, a line each, further lines of a value below its first; what is None is left out."""
    width = max(map(len, facts), default=0)
    for name, value in facts.items():
        if value is not None:
            typer.echo(f"{name:<{width}}  " + text(value).replace("\n", "\n" + " " * (width + 2)))


def text(value: Any) -> str:
    """A value as a person reads it."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4f}" if math.isfinite(value) else "-"
    if isinstance(value, (list, tuple)):
        return ", ".join(text(item) for item in value)
    return str(value)


def byte_count(number: float) -> str:
    """A number of bytes in the largest fitting unit."""
    for unit in ("B", "kB", "MB", "GB"):
        if number < 1000:
            return f"{number:.0f} {unit}" if unit == "B" else f"{number:.1f} {unit}"
        number /= 1000
    return f"{number:.1f} TB"


def duration(seconds: float) -> str:
    """Hours, minutes and seconds: 1:02:03, or 2:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def write_file(path: Path, content: bytes) -> None:
    """Write a file as a whole or not at all; directories are made."""
    check_writable(path)
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_png(path: Path, picture: Image) -> None:
    """Write a picture, and say so."""
    from fractal_farm.picture import encoded

    write_file(path, encoded(picture))
    say(f"wrote {path}")


def check_png(option: str, path: Path | None) -> None:
    """Refuse a name, if there is one, that is not a PNG file's, before anything is drawn."""
    if path is not None and path.suffix.lower() != ".png":
        raise InputError(f"{option} {path}: the picture is a PNG; give a name that ends in .png")


def check_writable(path: Path) -> None:
    """Make the directories of a file that will be written, or say in an `InputError` why it cannot be."""
    if path.is_dir():
        raise InputError(f"{path}: is a directory; name a file")
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is not a regular file; name one")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); name another place") from None


@contextlib.contextmanager
def results_only_on_stdout() -> Iterator[None]:
    """Send what others print on stdout (Ray does) to stderr for a while."""
    sys.stdout.flush()
    with contextlib.redirect_stdout(sys.stderr):
        kept = os.dup(1)
        try:
            os.dup2(2, 1)
            yield
        finally:
            os.dup2(kept, 1)
            os.close(kept)


def _widen(console: Console, content: Table | Tree) -> None:
    unbounded = console.options.update(max_width=_UNBOUNDED_WIDTH)
    console.width = max(console.width, console.measure(content, options=unbounded).maximum)


def _console() -> Console:
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else _PLAIN_WIDTH, highlight=False, markup=False)
