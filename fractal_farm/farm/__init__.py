"""The farm: who works when (DESIGN section 4). `submit`, `resume` and `status` are all that the command line uses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fractal_farm.farm.run_status import status
    from fractal_farm.farm.sessions import RunSummary, resume, submit

__all__ = ["RunSummary", "resume", "status", "submit"]


def __getattr__(name: str) -> Any:
    """Import on first use: island actors need none of what sessions bring along."""
    import importlib

    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = importlib.import_module(f"{__name__}.{'run_status' if name == 'status' else 'sessions'}")
    return getattr(module, name)
