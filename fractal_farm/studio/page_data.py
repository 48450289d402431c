"""catalogue.json: what a page must know before it reads the columns; the same from a server and in a static export."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fractal_farm import __version__
from fractal_farm.catalogue import Catalogue, RunInfo
from fractal_farm.ifs.symmetry import SYMMETRIES
from fractal_farm.studio.columns import BLOCK, COLUMNS


def catalogue_facts(
    catalogue: Catalogue, version: str, rows: int, maps_per_row: int, *, server: bool
) -> dict[str, Any]:
    """The content of catalogue.json but for what a server adds of its own state."""
    runs = catalogue.runs()
    live = server and any(run.live for run in runs)
    return {
        "title": title_of(catalogue.path),
        "version": version,
        "rows": rows,
        "live": live,
        "server": server,
        "token_needed": server,
        "block": BLOCK,
        "maps_per_row": maps_per_row,
        "columns": [column._asdict() for column in COLUMNS],
        "symmetries": [symmetry.name for symmetry in SYMMETRIES],
        "runs": [_run(run, live=server and run.live) for run in runs],
        "software": f"Fractal Farm {__version__}",
    }


def title_of(path: Path) -> str:
    """What a catalogue is called: the name of its directory."""
    return path.resolve().name


def _run(run: RunInfo, *, live: bool) -> dict[str, Any]:
    config = run.description.get("config")
    name = config.get("name") if isinstance(config, dict) else None
    return {"run_id": run.run_id, "name": str(name or run.run_id), "live": live, "rows": run.rows}
