"""The farm: who works when (DESIGN section 4). What the command line uses of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fractal_farm.farm.run_status import status
    from fractal_farm.farm.sessions import RunSummary, resume, submit
    from fractal_farm.farm.stopping import stop

__all__ = ["RunSummary", "resume", "status", "stop", "submit"]
_ELSEWHERE = {"status": "run_status", "stop": "stopping"}


def __getattr__(name: str) -> Any:
    """Import on first use: island actors need none of what sessions bring along."""
    import importlib

    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = importlib.import_module(f"{__name__}.{_ELSEWHERE.get(name, 'sessions')}")
    return getattr(module, name)
