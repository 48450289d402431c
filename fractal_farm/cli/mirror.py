"""`farm mirror` and `farm fetch`: a catalogue's copy in an object store, by hand."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fractal_farm.cli.catalogue_commands import DirectoryArgument
from fractal_farm.cli.output import AsJson, byte_count, print_facts, print_json, say
from fractal_farm.errors import FarmError

if TYPE_CHECKING:
    from fractal_farm.catalogue.mirror import Fetched

UrlArgument = Annotated[str, typer.Argument(metavar="URL", help="s3://bucket/prefix; the AWS_* variables say who.")]
_TELL_SECONDS = 5.0
_SHOWN = 5


def mirror(directory: DirectoryArgument, url: UrlArgument, as_json: AsJson = False) -> None:
    """Bring the copy of a catalogue in an object store up to date.

    A run with catalogue.mirror does so by itself. What was interrupted is simply started again.
    """
    from fractal_farm.catalogue import Catalogue
    from fractal_farm.catalogue.mirror import Backlog, kept, read_state, write_state

    catalogue = Catalogue.open(directory)
    told = _now_and_then()

    def tell(backlog: Backlog) -> None:
        told(lambda: f"{backlog.files:,} files to go ({byte_count(backlog.bytes)})")

    with kept(catalogue.path, url, "farm mirror", lambda cause, remedy: say(f"{cause}; {remedy}")) as uploader:
        uploader.catch_up(tell, everything=True)
    state = read_state(directory)
    if state is not None and state["url"] == url:  # the run's own mirror
        write_state(directory, url, Backlog(0, 0))
    _print(directory, url, uploader.arrived, uploader.arrived_bytes, as_json)


def fetch(
    url: UrlArgument,
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="A new directory, or an earlier state of it.")],
    as_json: AsJson = False,
) -> None:
    """Bring a catalogue back from an object store.

    What was interrupted is simply started again; what is there is not fetched again.
    """
    from fractal_farm.catalogue.mirror import fetch as bring

    told = _now_and_then()

    def tell(fetched: Fetched, commits: int) -> None:
        told(lambda: f"{fetched.commits:,} of {commits:,} commits, {byte_count(fetched.bytes)}")

    fetched = bring(url, directory, tell)
    for key in fetched.damaged[:_SHOWN]:
        say(f"damaged in the mirror: {key}")
    if fetched.damaged:
        raise FarmError(
            f"{url}: {len(fetched.damaged)} files are missing or damaged there, all else has come; "
            f"farm verify {directory} --repair mends what can be"
        )
    _print(directory, url, fetched.files, fetched.bytes, as_json)


def _print(directory: Path, url: str, files: int, size: int, as_json: bool) -> None:
    from fractal_farm.catalogue import Catalogue

    digest = Catalogue.open(directory).digest()
    facts: dict[str, Any] = {"catalogue": str(directory), "mirror": url}
    if as_json:
        print_json({**facts, "files": files, "bytes": size, "digest": digest})
        return
    print_facts({**facts, "new": f"{files:,} files, {byte_count(size)}" if files else "nothing", "digest": digest})


def _now_and_then() -> Callable[[Callable[[], str]], None]:
    """Says a line if the last one was some seconds ago."""
    last = time.monotonic()

    def tell(line: Callable[[], str]) -> None:
        nonlocal last
        if time.monotonic() - last >= _TELL_SECONDS:
            last = time.monotonic()
            say(line())

    return tell
