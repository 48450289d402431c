"""The option that says what others may do with what is made."""

from __future__ import annotations

import re
from typing import Annotated

import typer

from fractal_farm.errors import InputError

LicenceOption = Annotated[
    str | None,
    typer.Option("--licence", help="What others may do: an SPDX identifier, such as CC-BY-4.0.", show_default=False),
]


def check_licence(licence: str | None) -> None:
    """Refuse what cannot be an SPDX expression, with an `InputError`."""
    if licence is not None and not re.fullmatch(r"[A-Za-z0-9.+() -]{1,100}", licence):
        raise InputError(f"--licence {licence!r}: give an SPDX identifier, such as CC0-1.0 or CC-BY-4.0")
