"""The command line: it translates arguments into calls of the library, and results into text."""

from fractal_farm.cli.main import main

__all__ = ["main"]
