"""What the files of a run tell of its course: committed parts and the event log, each read once, as they appear.

`farm status` and the report stand on it. Nothing is locked and nothing is asked of the running farm, so that it works
from another terminal or host, for live, ended, interrupted and damaged catalogues; what cannot be read is named.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue import read_run, run_ends
from fractal_farm.catalogue.layout import PartName
from fractal_farm.catalogue.parts import PartGoneError, read_commits, read_of_parts, read_rows
from fractal_farm.catalogue.scan import empty_table, indices, one_of_each, places_of
from fractal_farm.catalogue.schema import KINDS
from fractal_farm.catalogue.settings import read_settings
from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError, InputError
from fractal_farm.evolution.epoch import GenerationStatistics
from fractal_farm.farm.event_log import log_path
from fractal_farm.farm.events import Progress
from fractal_farm.farm.records import read_summary

# Columns of a commit's statistics: two keys, and fields of `GenerationStatistics`.
STATISTICS = ("island", "epoch", "generation", "evaluated", "refused", "accepted", "qualified", "mean_accepted", "best")


_FIELDS = [field.name for field in fields(GenerationStatistics)]
_PLACES = [_FIELDS.index(name) for name in STATISTICS[2:]]

# Seconds worked, and the fields of `Progress`, at some time of the run.
Sample = tuple[float, dict[str, Any]]


@dataclass(frozen=True)
class Commit:
    """One commit of a run.

    What it tells of the run is read when it is first asked for.

    Attributes:
        first_epoch: first epoch covered.
        last_epoch: last epoch covered.
        told: what the ledger says (`farm.records.read_summary`).
    """

    first_epoch: int
    last_epoch: int
    told: Callable[[], dict[str, Any]]

    @cached_property
    def progress(self) -> Progress:
        """Totals of the run after it."""
        return Progress(**self._summary["progress"])

    @property
    def elapsed_s(self) -> float:
        """Seconds that all sessions had worked by then."""
        return float(self._summary["elapsed_s"])

    @cached_property
    def statistics(self) -> npt.NDArray[np.float64]:
        """(n, len(STATISTICS)) float64, a row for each island and generation."""
        rows = [
            (record["island"], record["epoch"], *(values[k] for k in _PLACES))
            for record in self._summary["records"]
            for values in record["statistics"]
        ]
        return np.array(rows, np.float64).reshape(-1, len(STATISTICS))

    @property
    def exchanges(self) -> list[tuple[int, int, list[tuple[int, int]], int]]:
        """(island, epoch, arrivals as (source, number), how many of them settled), one for each record."""
        return [
            (
                record["island"],
                record["epoch"],
                [(source, sent) for source, sent in record["arrivals"]],
                record["settled"],
            )
            for record in self._summary["records"]
        ]

    @cached_property
    def _summary(self) -> dict[str, Any]:
        return self.told()


@dataclass(frozen=True)
class _Part:
    """What was read of a part: its commits, and its rows with the columns that were asked for."""

    commits: list[Commit]
    rows: Any


class RunHistory:
    """The course of one run, read again with `refresh` as it goes on.

    Attributes:
        root: the catalogue.
        run_id: id of the run.
        config: what its last session works with; None if run.json is damaged, or another version wrote it.
        versions: of what it was begun with.
        ends: the records of its ends, oldest first.
        commits: what was committed, in order of epochs.
        log: entries of the event log, oldest first.
        damage: one line for everything that could not be read.
    """

    def __init__(self, root: Path, run_id: str, columns: Sequence[str]) -> None:
        """Read all there is.

        Args:
            root: the catalogue.
            run_id: id of the run.
            columns: columns of the manifest to read with the parts.
        """
        self.root = root
        self.run_id = run_id
        self.config: RunConfig | None = None
        self.versions: dict[str, str] = {}
        self.ends: list[dict[str, Any]] = []
        self.commits: list[Commit] = []
        self.log: list[dict[str, Any]] = []
        self.damage: list[str] = []
        self._columns = list(columns)
        self._parts: dict[PartName, _Part | str] = {}
        self._log_end = 0
        self.refresh()

    def refresh(self) -> None:
        """Read what has come since the last time."""
        self.damage = []
        self._read_documents()
        # Parts come after the log: a run that goes on never seems to have more events than epochs to show for them.
        self._read_log()
        self._read_parts()

    def rows(self) -> Any:
        """All rows committed, duplicates included, as one table."""
        sound = [part.rows for part in self._parts.values() if isinstance(part, _Part)]
        return pa.concat_tables([empty_table(self._columns), *sound])

    def end(self) -> dict[str, Any] | None:
        """How the run ended; None if it never did, or went on since then."""
        epochs = self.commits[-1].progress.epochs if self.commits else 0
        return self.ends[-1] if self.ends and self.ends[-1]["progress"]["epochs"] == epochs else None

    def samples(self, most: int | None = None) -> list[Sample]:
        """Moments of the run in order: commits, and complete epochs of the log, committed or not.

        Args:
            most: look at about so many commits, spread evenly, and at the last.
        """
        step = 1 if most is None else max(1, len(self.commits) // max(most, 1))
        looked_at = [*(self.commits[:-1][::step] if most != 0 else ()), *self.commits[-1:]]
        samples = [(commit.elapsed_s, asdict(commit.progress)) for commit in looked_at]
        for entry in self.log:
            if entry["event"] == "EpochCompleted":
                samples.append((entry["elapsed_s"], entry["progress"]))
        samples.sort(key=lambda sample: (sample[1]["epochs"], sample[0]))
        # An epoch that was lost before its commit, and done again by a later session, would turn the clock back.
        ordered: list[Sample] = []
        for sample in samples:
            if not ordered or sample[0] >= ordered[-1][0]:
                ordered.append(sample)
        return ordered

    def _read_documents(self) -> None:
        try:
            self.versions = read_run(self.root, self.run_id).get("versions", {})
            settings = read_settings(self.root, self.run_id)
        except FarmError as error:
            self.damage.append(str(error))
        else:
            with contextlib.suppress(InputError):  # of another version, with other fields
                self.config = RunConfig.from_dict(settings)
        try:
            self.ends = run_ends(self.root, self.run_id)
        except FarmError as error:
            self.damage.append(str(error))

    def _read_parts(self) -> None:
        self._parts = read_of_parts(
            self.root, self.run_id, lambda parts: {name: self._parts.get(name) or self._part(name) for name in parts}
        )
        found = list(self._parts.values())
        self.damage += [part for part in found if isinstance(part, str)]
        commits = [commit for part in found if isinstance(part, _Part) for commit in part.commits]
        self.commits = sorted(commits, key=lambda commit: (commit.first_epoch, commit.last_epoch))

    def _part(self, name: PartName) -> _Part | str:
        """What there is in a part, or in words why it cannot be read."""
        try:
            return self._read_part(name)
        except PartGoneError:
            raise
        except FarmError as error:
            return str(error)

    def _read_part(self, name: PartName) -> _Part:
        commits = []
        for commit in read_commits(self.root, name, records=not name.is_merged):
            if name.is_merged:
                told = partial(self._summary, name.writer, commit.seq)
            else:
                told = partial(dict, read_summary(commit.records))
            commits.append(Commit(*commit.epochs, told))
        return _Part(commits, read_rows(self.root, name, self._columns))

    def _summary(self, writer: str, seq: int) -> dict[str, Any]:
        """What one commit tells, wherever it lies by now."""

        def read(parts: list[PartName]) -> dict[str, Any]:
            name = next(part for part in parts if part.writer == writer and part.seq <= seq <= part.last)
            chosen = read_commits(self.root, name, records={seq})
            return read_summary(next(commit.records for commit in chosen if commit.seq == seq))

        return read_of_parts(self.root, self.run_id, read)

    def _read_log(self) -> None:
        """Whole lines since the last time; one that was torn by a crash is passed over."""
        try:
            with log_path(self.root, self.run_id).open("rb") as file:
                file.seek(self._log_end)
                content = file.read()
        except FileNotFoundError:
            return
        whole = content[: content.rfind(b"\n") + 1]
        self._log_end += len(whole)
        for line in whole.splitlines():
            try:
                entry = json.loads(line)
            except ValueError:
                continue
            if isinstance(entry, dict) and {"at", "event"} <= set(entry):
                self.log.append(entry)


def standing_designs(rows: Any, columns: Sequence[str] | None = None) -> Any:
    """The designs among rows of a manifest, each once, in their order; with these columns alone if they are given."""
    designs = places_of(pc.indices_nonzero(pc.starts_with(rows.column("kind"), KINDS[0])))
    chosen = one_of_each(rows.column("design_id"), designs)
    return rows.select(rows.column_names if columns is None else columns).take(indices(chosen))
