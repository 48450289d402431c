"""A run's figures for Prometheus, as a callback on its events.

Ray exports them from the node of the driver (embedded: 127.0.0.1 and the port of `execution.metrics`; a cluster: the
metrics port of its nodes), every few seconds, with `ray_` before the name and `_total` behind that of a counter.
`deploy/grafana.json` draws them.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from typing import Any

from ray.util.metrics import Counter, Gauge, Histogram

from fractal_farm.farm.events import (
    Callback,
    Continued,
    EpochCompleted,
    Event,
    Fault,
    MeshFinished,
    Migration,
    PartCommitted,
    Paused,
    Progress,
    RunStarted,
)

COUNTERS = {
    "farm_evaluated": "genomes evaluated",
    "farm_epochs": "epochs that all islands have completed",
    "farm_migrants": "designs that islands sent to others",
    "farm_migrants_settled": "migrants that found a place",
    "farm_faults": "faults that were handled",
    "farm_solids": "solids made",
    "farm_solids_failed": "designs of which no solid could be made",
}
GAUGES = {
    "farm_designs": "designs kept",
    "farm_qualified": "qualified designs kept",
    "farm_distinct": "qualified designs of different shapes",
    "farm_best_fitness": "highest fitness in any library",
    "farm_mean_fitness": "mean fitness of accepted offspring in the last epoch",
    "farm_committed_epochs": "epochs that are durable",
    "farm_uncommitted_designs": "designs that wait to be committed",
    "farm_solids_waiting": "qualified designs that are to become solids and are none yet",
    "farm_catalogue_bytes": "size of the catalogue",
    "farm_catalogue_files": "files in the catalogue",
    "farm_paused": "1 while the run waits, 0 while it works",
}
HISTOGRAMS = {"farm_solid_seconds": "time to make a solid"}
_LABELS = {"farm_migrants": ("source", "island"), "farm_migrants_settled": ("island",), "farm_faults": ("where",)}
_REFRESH_SECONDS = 1.0
_SOLID_SECONDS = [0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0]


@contextlib.contextmanager
def metrics() -> Iterator[Callback]:
    """A callback that keeps the figures of a run while the context lasts, on the cluster that is joined by then."""
    callback, over = _Metrics(), threading.Event()

    def refresh() -> None:
        # Ray forgets a gauge that is not set again and again, such as those of a run that waits for disk space.
        while not over.wait(_REFRESH_SECONDS):
            callback.refresh()

    refresher = threading.Thread(target=refresh, name="metrics", daemon=True)
    refresher.start()
    try:
        yield callback
    finally:
        over.set()
        refresher.join()


class _Metrics(Callback):
    """The figures of one run."""

    def __init__(self) -> None:
        self._metrics: dict[str, Any] = {}
        self._gauges: dict[str, float] = {}
        self._progress = Progress()
        self._wanted: int | None = None
        self._solids = 0
        self._committed_designs = 0

    def on_event(self, event: Event) -> None:
        """Keep what an event says."""
        if isinstance(event, RunStarted):
            self._metrics = _new_metrics({"run": event.run_id, "name": event.name})
            self._progress, self._solids = event.progress, event.meshes
            self._committed_designs = event.progress.designs
            self._set("farm_catalogue_bytes", event.bytes)
            self._set("farm_catalogue_files", event.files)
            self._set("farm_committed_epochs", event.progress.epochs)
            self._set("farm_paused", 0)
            self._set_progress(event.progress)
        elif isinstance(event, EpochCompleted):
            self._count("farm_evaluated", event.progress.evaluated - self._progress.evaluated)
            self._count("farm_epochs", event.progress.epochs - self._progress.epochs)
            self._set_progress(event.progress)
        elif isinstance(event, PartCommitted):
            self._committed_designs = event.total_designs
            self._set("farm_committed_epochs", event.epochs)
            self._set("farm_catalogue_bytes", event.total_bytes)
            self._set("farm_catalogue_files", event.total_files)
            self._set_progress(self._progress)
        elif isinstance(event, Migration):
            for source, number in event.arrivals:
                self._count("farm_migrants", number, source=source, island=event.island)
            self._count("farm_migrants_settled", event.settled, island=event.island)
        elif isinstance(event, MeshFinished):
            self._solids, self._wanted = event.done, event.wanted
            self._count("farm_solids_failed" if event.failure else "farm_solids", 1)
            self._metrics["farm_solid_seconds"].observe(event.seconds)
            self._set_progress(self._progress)
        elif isinstance(event, Fault):
            # "island 3" is an island: a label for each of a thousand would be too many.
            self._count("farm_faults", 1, where=event.where.rstrip("0123456789 "))
        elif isinstance(event, Paused | Continued):
            self._set("farm_paused", isinstance(event, Paused))

    def refresh(self) -> None:
        """Set all gauges to what they are."""
        for name, value in self._gauges.copy().items():
            self._metrics[name].set(value)

    def _set_progress(self, progress: Progress) -> None:
        self._progress = progress
        self._set("farm_designs", progress.designs)
        self._set("farm_qualified", progress.kept_qualified)
        self._set("farm_distinct", progress.distinct)
        self._set("farm_best_fitness", progress.best_fitness)
        self._set("farm_mean_fitness", progress.mean_accepted)
        self._set("farm_uncommitted_designs", max(0, progress.designs - self._committed_designs))
        wanted = progress.kept_qualified if self._wanted is None else min(self._wanted, progress.kept_qualified)
        self._set("farm_solids_waiting", max(0, wanted - self._solids))

    def _set(self, name: str, value: float) -> None:
        self._gauges[name] = float(value)
        self._metrics[name].set(float(value))

    def _count(self, name: str, number: int, **labels: object) -> None:
        if number > 0:  # Ray refuses to count nothing
            self._metrics[name].inc(number, {key: str(value) for key, value in labels.items()})


def _new_metrics(labels: dict[str, str]) -> dict[str, Any]:
    """Made at each start: a cluster that was lost took its figures along."""
    metrics: dict[str, Any] = {}
    for kinds, kind in ((COUNTERS, Counter), (GAUGES, Gauge)):
        for name, text in kinds.items():
            metrics[name] = kind(name, description=text, tag_keys=(*labels, *_LABELS.get(name, ())))
    for name, text in HISTOGRAMS.items():
        metrics[name] = Histogram(name, description=text, boundaries=_SOLID_SECONDS, tag_keys=tuple(labels))
    for metric in metrics.values():
        metric.set_default_tags(labels)
    return metrics


def exported_names() -> set[str]:
    """Names as Prometheus sees them."""
    parts = {f"ray_{name}_{part}" for name in HISTOGRAMS for part in ("bucket", "count", "sum")}
    return {f"ray_{name}_total" for name in COUNTERS} | {f"ray_{name}" for name in GAUGES} | parts
