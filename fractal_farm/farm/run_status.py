"""What a run has done and what it will take, from the catalogue alone: also of a live run, or a dead one."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow.compute as pc

from fractal_farm.catalogue import Catalogue, committed_records
from fractal_farm.config import RunConfig
from fractal_farm.evolution.island import founding_state
from fractal_farm.farm.event_log import read_log
from fractal_farm.farm.events import Progress
from fractal_farm.farm.history import only_run
from fractal_farm.farm.records import unpack_ledger

FORECAST_HOURS = 10.0
_SETTLED_SECONDS = 60.0


def status(path: Path) -> dict[str, Any]:
    """The state of a catalogue's run, ready for JSON.

    Args:
        path: the catalogue.

    Returns:
        run_id, name, path, state ("running", "ended", "interrupted"), reason, digest, the fields of `Progress`,
        n_maps (designs by number of maps), printable (designs whose wall makes one body), meshes, mesh_failures,
        files, bytes, elapsed_s, rate (evaluations a second) and forecast (files, gigabytes and rows after ten hours
        at the rate of the last half of the run; None in its first minute).

    Raises:
        InputError: not a catalogue, or no run in it.
        FarmError: the manifest is damaged.
    """
    run_id = only_run(path)
    catalogue = Catalogue.open(path)
    info = next(run for run in catalogue.runs() if run.run_id == run_id)
    config = RunConfig.from_dict(info.description["config"], f"{path}: run.json")
    progress, elapsed_s = _totals(path, config)
    usage = catalogue.usage()
    designs = catalogue.designs(["fitness", "n_maps", "gap"], run_id)
    counts = designs.column("n_maps").value_counts().to_pylist()
    log = list(read_log(path, run_id))
    ended = info.ends[-1] if info.ends else None
    if ended is not None and ended["progress"]["epochs"] != progress.epochs:
        ended = None  # it went on since then
    finished = ended is not None and not ended["interrupted"]
    state = "running" if info.live else "ended" if finished else "interrupted"
    failures = sum(1 for entry in log if entry["event"] == "MeshFinished" and entry["failure"])
    wall = config.solids.wall_mm / config.solids.size_mm
    return {
        "run_id": run_id,
        "name": config.name,
        "path": str(path),
        "state": state,
        "reason": ended["reason"] if ended else None,
        "digest": catalogue.digest(run_id),
        **asdict(progress),
        "designs": designs.num_rows,
        "n_maps": {str(entry["values"]): entry["counts"] for entry in counts},
        "printable": int(pc.sum(pc.less_equal(designs.column("gap"), wall)).as_py() or 0),
        "meshes": len(catalogue.solids()),
        "mesh_failures": failures,
        "files": usage.files,
        "bytes": usage.bytes,
        "elapsed_s": elapsed_s,
        "rate": progress.evaluated / elapsed_s if elapsed_s > 0 else 0.0,
        "forecast": _forecast(log, usage.files, usage.bytes, designs.num_rows, elapsed_s),
    }


def _totals(path: Path, config: RunConfig) -> tuple[Progress, float]:
    progress, elapsed_s = Progress(), 0.0
    dtype = founding_state(config.evolution).library.dtype
    for _, blob in committed_records(path, config.run_id):
        ledger = unpack_ledger(blob, dtype)
        progress, elapsed_s = ledger.progress, max(elapsed_s, ledger.elapsed_s)
    return progress, elapsed_s


def _forecast(
    log: list[dict[str, Any]], files: int, size: int, designs: int, elapsed_s: float
) -> dict[str, float] | None:
    """Straight lines through the second half of the run, where the rate has settled."""
    if elapsed_s < _SETTLED_SECONDS:
        return None
    samples = [entry for entry in log if entry["event"] == "PartCommitted"]
    later = [entry for entry in samples if entry["elapsed_s"] >= elapsed_s / 2]
    seconds = max(0.0, 3600.0 * FORECAST_HOURS - elapsed_s)
    growth = {"total_files": 0.0, "total_bytes": 0.0, "total_designs": 0.0}
    if len(later) >= 2 and later[-1]["elapsed_s"] > later[0]["elapsed_s"]:
        span = later[-1]["elapsed_s"] - later[0]["elapsed_s"]
        growth = {name: (later[-1][name] - later[0][name]) / span for name in growth}
    return {
        "hours": FORECAST_HOURS,
        "files": files + growth["total_files"] * seconds,
        "gigabytes": (size + growth["total_bytes"] * seconds) / 1e9,
        "rows": designs + growth["total_designs"] * seconds,
    }
