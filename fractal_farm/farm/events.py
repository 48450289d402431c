"""What happens in a run, as small values, and who hears of it.

Progress bar, log, metrics and report are callbacks on these events; the schedule knows none of them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Progress:
    """Totals of a run up to its last complete epoch.

    Attributes:
        epochs: complete epochs (all islands).
        evaluated: genomes evaluated.
        accepted: of them, fitness at or above the elimination threshold.
        qualified: of them, fitness above the threshold of qualified designs.
        designs: designs kept in the catalogue.
        kept_qualified: of them, qualified.
        best_fitness: highest fitness in any library.
        mean_accepted: mean fitness of the accepted in the last epoch.
        settled: migrants that found a place.
        distinct: qualified designs of a shape that the run had not found before.
        refused: genomes that got no score.
    """

    epochs: int = 0
    evaluated: int = 0
    accepted: int = 0
    qualified: int = 0
    designs: int = 0
    kept_qualified: int = 0
    best_fitness: float = 0.0
    mean_accepted: float = 0.0
    settled: int = 0
    distinct: int = 0
    refused: int = 0


@dataclass(frozen=True)
class RunStarted:
    """A run begins, or goes on from where `progress` says; the catalogue has so many files, bytes and meshes.

    It needs no more than so many bytes in its first hour, and in all, as far as that is known.
    """

    run_id: str
    name: str
    path: str
    executor: str
    workers: int
    islands: int
    progress: Progress
    files: int
    bytes: int
    meshes: int
    stop: dict[str, float | int | None]
    first_hour_bytes: float | None = None
    whole_bytes: float | None = None


@dataclass(frozen=True)
class EpochCompleted:
    """All islands have finished an epoch; `elapsed_s` counts this session alone."""

    epoch: int
    progress: Progress
    elapsed_s: float
    rate: float


@dataclass(frozen=True)
class PartCommitted:
    """Epochs first..last are durable in the catalogue, which now has so many files, bytes and rows in all."""

    first_epoch: int
    last_epoch: int
    rows: int
    files: int
    bytes: int
    total_files: int
    total_bytes: int
    total_designs: int
    epochs: int
    elapsed_s: float


@dataclass(frozen=True)
class Migration:
    """Island `island` received `arrivals` (source, number) before an epoch, of which `settled` found a place."""

    island: int
    epoch: int
    arrivals: tuple[tuple[int, int], ...]
    settled: int


@dataclass(frozen=True)
class Steered:
    """From epoch `first` to `last` all islands breed from these designs, too: somebody has asked for it."""

    first: int
    last: int
    design_ids: tuple[str, ...]


@dataclass(frozen=True)
class MeshFinished:
    """A solid is in the catalogue, which now has `done` of the `wanted` ones, or `failure` says why not."""

    design_id: str
    seconds: float
    done: int
    wanted: int | None
    failure: str | None = None


@dataclass(frozen=True)
class Fault:
    """Something failed and was handled; `remedy` says how."""

    where: str
    cause: str
    remedy: str


@dataclass(frozen=True)
class Paused:
    """The run waits, and goes on by itself once the cause is gone."""

    cause: str


@dataclass(frozen=True)
class Continued:
    """The run goes on after a pause."""

    reason: str


@dataclass(frozen=True)
class MirrorChanged:
    """The mirror of the catalogue, which is so many files behind, falls silent because of `cause`, or answers again."""

    url: str
    files: int
    bytes: int
    cause: str | None


@dataclass(frozen=True)
class Draining:
    """The run is asked to end: what is complete will be committed."""

    reason: str


@dataclass(frozen=True)
class RunEnded:
    """The session is over; `interrupted` if somebody ended it before a limit was reached."""

    reason: str
    interrupted: bool
    progress: Progress
    elapsed_s: float
    digest: str
    meshes: int
    mesh_failures: int


Event = (
    RunStarted
    | EpochCompleted
    | PartCommitted
    | Migration
    | Steered
    | MeshFinished
    | Fault
    | Paused
    | Continued
    | MirrorChanged
    | Draining
    | RunEnded
)


class Callback:
    """Hears every event of a run; override what is of interest."""

    def on_event(self, event: Event) -> None:
        """Called in the driver, in order; it must be quick and must not raise."""


@dataclass
class Announcer:
    """Passes events on to all callbacks."""

    callbacks: Iterable[Callback] = field(default_factory=tuple)

    def __call__(self, event: Event) -> None:
        """Tell everybody."""
        for callback in self.callbacks:
            callback.on_event(event)
