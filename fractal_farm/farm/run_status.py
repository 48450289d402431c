"""What a run has done, what it is doing and what it will take, from its files alone: also of a live run, or a dead one.

`status` is one look; `RunMonitor` looks again and again, and reads only what is new. A damaged catalogue is described
as far as it can be read, with what is damaged.
"""

from __future__ import annotations

import shutil
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc

from fractal_farm.catalogue import Catalogue, run_is_live
from fractal_farm.catalogue.mirror import read_state
from fractal_farm.catalogue.scan import numbers
from fractal_farm.catalogue.steering import steering_requests
from fractal_farm.errors import FarmError
from fractal_farm.farm.events import Progress
from fractal_farm.farm.history import STATISTICS, Commit, RunHistory, Sample, standing_designs
from fractal_farm.farm.stopping import chosen_run

FORECAST_HOURS = 10.0
MIGRATION_EPOCHS = 10
_SETTLED_SECONDS = 60.0
_RATE_SECONDS = 60.0
_SAMPLES = 40
_DIGEST_ROWS = 100_000
_COLUMNS = ("design_id", "kind", "n_maps", "gap")
_COUNTING_LIMITS = (
    ("epochs", "epochs"),
    ("evaluations", "evaluated"),
    ("qualified", "kept_qualified"),
    ("distinct", "distinct"),
)


def status(path: Path) -> dict[str, Any]:
    """The state of a catalogue's run, ready for JSON.

    Args:
        path: the catalogue.

    Returns:
        See `RunMonitor.look`; with the digest.

    Raises:
        InputError: not a catalogue, or no run in it.
    """
    return RunMonitor(path).look(digest=True)


class RunMonitor:
    """Looks at a run again and again."""

    def __init__(self, path: Path, run: str | None = None) -> None:
        """Find the run.

        Args:
            path: the catalogue.
            run: id of the run, or its first digits; the latest begun if None.

        Raises:
            InputError: not a catalogue, or no such run in it.
        """
        self._path = path
        self._run_id = chosen_run(path, run)
        self._history: RunHistory | None = None

    def look(self, *, digest: bool) -> dict[str, Any]:
        """The state of the run now.

        Args:
            digest: also tell the content digest. Of a large catalogue it is the one that the end of the run recorded,
                since it takes all columns of all rows to compute it; None without such an end, or if it is not wanted.

        Returns:
            run_id, name, path; state ("running", "ended", "interrupted"), reason, digest;
            the fields of `Progress` at the last commit, and `complete_epochs`, which may be ahead of it;
            designs, n_maps (designs by number of maps), printable (designs whose wall makes one body);
            meshes, mesh_failures;
            elapsed_s, rate (evaluations a second, all sessions), rate_now (of the last minute of work; None until two
            moments are known), workers, executor, silent_s (since the last sign of life of a running farm);
            islands (island, epoch, best, mean_accepted, received by source and settled in the last epochs);
            waits: why the run waits at the moment, or None;
            mirror: of the catalogue (url, files and bytes that it lacked at the time `at`, cause), or None;
            migration_epochs (first and last epoch that `received` covers);
            steering (first, last, design_ids), one for each request that the run is bound to;
            failures (where, cause, remedy, count, last: seconds since 1970);
            files, bytes, whole_bytes (that the run will need at most, if that is known), free_bytes, min_free_bytes
            (the run waits below it);
            stop (limits in force), left_s and left_until (the limit that comes first), None where nothing is known;
            forecast (files, gigabytes and rows after ten hours; None in the first minute); damage (lines).
        """
        live = run_is_live(self._path, self._run_id)
        if self._history is None:
            self._history = RunHistory(self._path, self._run_id, _COLUMNS)
        else:
            self._history.refresh()
        history, now = self._history, time.time()
        catalogue = Catalogue.open(self._path)
        damage = list(history.damage)
        last = history.commits[-1] if history.commits else None
        progress = last.progress if last else Progress()
        elapsed_s = last.elapsed_s if last else 0.0
        usage = catalogue.usage()
        rows = standing_designs(history.rows(), ["n_maps", "gap"])
        started: dict[str, Any] = next((entry for entry in reversed(history.log) if entry["event"] == "RunStarted"), {})
        stop = history.config.stop.model_dump() if history.config else started.get("stop") or {}
        samples = history.samples(_SAMPLES if live else 0)
        end = history.end()
        state, reason = _state(end, live)
        left = time_left(samples, stop, now - _heard(history, now)) if state == "running" else None
        asked = history.config.solids.parameters if history.config else None
        wall = asked.wall_mm / asked.size_mm if asked else 0.0
        meshes = _readable(lambda: len(catalogue.solids()), damage)
        islands, window = _islands(history)
        return {
            "run_id": self._run_id,
            "name": history.config.name if history.config else started.get("name"),
            "path": str(self._path),
            "state": state,
            "reason": reason,
            "digest": self._digest(catalogue, usage.rows, end, damage) if digest else None,
            **asdict(progress),
            "complete_epochs": samples[-1][1]["epochs"] if samples else 0,
            "designs": rows.num_rows,
            "n_maps": _counts(rows.column("n_maps")),
            "printable": printable(rows, wall),
            "meshes": meshes or 0,
            "mesh_failures": sum(1 for entry in history.log if entry["event"] == "MeshFinished" and entry["failure"]),
            "elapsed_s": elapsed_s,
            "rate": progress.evaluated / elapsed_s if elapsed_s > 0 else 0.0,
            "rate_now": _rate_now(samples) if state == "running" else None,
            "workers": started.get("workers"),
            "executor": started.get("executor"),
            "silent_s": now - _heard(history, now) if state == "running" else None,
            "waits": _waits(history.log) if state == "running" else None,
            "mirror": read_state(self._path),
            "islands": islands,
            "migration_epochs": window,
            "steering": [
                {"first": request.first, "last": request.last, "design_ids": list(request.design_ids)}
                for request in _readable(lambda: steering_requests(self._path, self._run_id), damage) or ()
            ],
            "failures": failures(history.log),
            "files": usage.files,
            "bytes": usage.bytes,
            "whole_bytes": started.get("whole_bytes"),
            "free_bytes": shutil.disk_usage(self._path).free,
            "min_free_bytes": int(history.config.catalogue.min_free_gb * 1e9) if history.config else None,
            "stop": stop,
            "left_s": left[0] if left else None,
            "left_until": left[1] if left else None,
            "forecast": _forecast(history.log, usage.files, usage.bytes, rows.num_rows, elapsed_s),
            "damage": damage,
        }

    def _digest(self, catalogue: Catalogue, rows: int, end: dict[str, Any] | None, damage: list[str]) -> Any:
        if rows > _DIGEST_ROWS:
            return end["digest"] if end else None
        return _readable(lambda: catalogue.digest(self._run_id), damage)


def printable(designs: Any, wall: float) -> int:
    """How many designs are one body with a wall of this share of their size."""
    return int(np.count_nonzero(numbers(designs.column("gap").drop_null()) <= wall))


def _counts(n_maps: Any) -> dict[str, int]:
    counted = pc.value_counts(n_maps).to_pylist()
    return {str(entry["values"]): entry["counts"] for entry in sorted(counted, key=lambda entry: entry["values"])}


def _state(end: dict[str, Any] | None, live: bool) -> tuple[str, str | None]:
    if live:
        return "running", None
    finished = end is not None and not end["interrupted"]
    return "ended" if finished else "interrupted", end["reason"] if end else None


def _heard(history: RunHistory, now: float) -> float:
    """Time of the last sign of life."""
    return max((entry["at"] for entry in history.log[-1:]), default=now)


def _rate_now(samples: list[Sample]) -> float | None:
    recent = [sample for sample in samples if sample[0] >= samples[-1][0] - _RATE_SECONDS]
    if len(recent) < 2 or recent[-1][0] <= recent[0][0]:
        return None
    return float((recent[-1][1]["evaluated"] - recent[0][1]["evaluated"]) / (recent[-1][0] - recent[0][0]))


def time_left(samples: list[Sample], stop: dict[str, Any], since_s: float) -> tuple[float, str] | None:
    """Seconds until the limit that comes first, at the pace of the last half of the run, and its name."""
    found = []
    elapsed_s = samples[-1][0] if samples else 0.0
    if (hours := stop.get("hours")) is not None:
        found.append((max(0.0, 3600.0 * hours - elapsed_s - since_s), f"{hours:g} hours"))
    later = [sample for sample in samples if sample[0] >= elapsed_s / 2]
    for name, key in _COUNTING_LIMITS:
        limit = stop.get(name)
        if limit is None or len(later) < 2 or later[-1][1][key] <= later[0][1][key]:
            continue
        pace = (later[-1][1][key] - later[0][1][key]) / max(later[-1][0] - later[0][0], 1e-9)
        found.append((max(0.0, (limit - later[-1][1][key]) / pace - since_s), f"{limit:,} {name}"))
    return min(found) if found else None


def _waits(log: list[dict[str, Any]]) -> str | None:
    """The cause of a pause that has not ended."""
    last: dict[str, Any] = next(
        (entry for entry in reversed(log) if entry["event"] in ("Paused", "Continued", "RunStarted")), {}
    )
    return last.get("cause")


def _islands(history: RunHistory) -> tuple[list[dict[str, Any]], list[int] | None]:
    """Where every island stands, and what it received in the last epochs."""
    if not history.commits:
        return [], None
    last = history.commits[-1].last_epoch
    first = max(0, last - MIGRATION_EPOCHS + 1)
    recent: list[Commit] = [commit for commit in history.commits if commit.last_epoch >= first]
    received: dict[int, Counter[int]] = defaultdict(Counter)
    settled: Counter[int] = Counter()
    for commit in recent:
        for island, epoch, arrivals, found_place in commit.exchanges:
            if epoch >= first:
                received[island].update(dict(arrivals))
                settled[island] += found_place
    latest = {int(row[0]): dict(zip(STATISTICS, row.tolist(), strict=True)) for row in recent[-1].statistics}
    islands = [
        {
            "island": island,
            "epoch": int(entry["epoch"]),
            "best": entry["best"],
            "mean_accepted": entry["mean_accepted"],
            "received": {str(source): number for source, number in sorted(received[island].items())},
            "settled": settled[island],
        }
        for island, entry in sorted(latest.items())
    ]
    return islands, [first, last]


def failures(log: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Faults and meshes that could not be made, equal ones together, the latest first."""
    found: dict[tuple[str, str, str], dict[str, Any]] = {}
    for entry in log:
        if entry["event"] == "Fault":
            key = (entry["where"], entry["cause"], entry["remedy"])
        elif entry["event"] == "MeshFinished" and entry["failure"]:
            key = ("solid", entry["failure"], "the design stays without one")
        else:
            continue
        count = found[key]["count"] + 1 if key in found else 1
        found[key] = {"where": key[0], "cause": key[1], "remedy": key[2], "count": count, "last": entry["at"]}
    return sorted(found.values(), key=lambda failure: -failure["last"])


def _readable(read: Callable[[], Any], damage: list[str]) -> Any:
    """What can be read, or None with a line about the damage."""
    try:
        return read()
    except FarmError as error:
        if str(error) not in damage:
            damage.append(str(error))
        return None


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
