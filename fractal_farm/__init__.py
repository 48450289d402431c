"""Fractal Farm grows catalogues of printable 3D fractal designs."""

__version__ = "0.1.0"
