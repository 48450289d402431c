"""What the files of a run tell of its course: committed parts and the event log, each read once, as they appear.

`farm status` and the report stand on it. Nothing is locked and nothing is asked of the running farm, so that it works
from another terminal or host, for live, ended, interrupted and damaged catalogues; what cannot be read is named.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue import read_run, run_ends
from fractal_farm.catalogue.layout import PartName
from fractal_farm.catalogue.parts import list_parts, read_footer, read_rows
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
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
    """One committed part of a run.

    Attributes:
        first_epoch: first epoch covered.
        last_epoch: last epoch covered.
        progress: totals of the run after it.
        elapsed_s: seconds that all sessions had worked by then.
        statistics: (n, len(STATISTICS)) float64, a row for each island and generation.
        exchanges: (island, epoch, arrivals as (source, number), how many of them settled), one for each record.
        rows: table of the part's rows with the columns that were asked for.
    """

    first_epoch: int
    last_epoch: int
    progress: Progress
    elapsed_s: float
    statistics: npt.NDArray[np.float64]
    exchanges: list[tuple[int, int, list[tuple[int, int]], int]]
    rows: Any


class RunHistory:
    """The course of one run, read again with `refresh` as it goes on.

    Attributes:
        root: the catalogue.
        run_id: id of the run.
        config: what its last session works with; None if run.json is damaged, or another version wrote it.
        versions: of what it was begun with.
        ends: the records of its ends, oldest first.
        commits: committed parts in order of epochs.
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
        self._parts: dict[PartName, Commit | str] = {}
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
        empty = pa.schema([DESIGN_SCHEMA.field(name) for name in self._columns]).empty_table()
        return pa.concat_tables([empty, *(commit.rows for commit in self.commits)]).combine_chunks()

    def end(self) -> dict[str, Any] | None:
        """How the run ended; None if it never did, or went on since then."""
        epochs = self.commits[-1].progress.epochs if self.commits else 0
        return self.ends[-1] if self.ends and self.ends[-1]["progress"]["epochs"] == epochs else None

    def samples(self) -> list[Sample]:
        """Moments of the run in order: commits, and complete epochs of the log, committed or not."""
        samples = [(commit.elapsed_s, asdict(commit.progress)) for commit in self.commits]
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
        listed = list_parts(self.root, self.run_id)
        for name in listed:
            if name not in self._parts:
                try:
                    self._parts[name] = _commit(self.root, name, self._columns)
                except FarmError as error:
                    self._parts[name] = str(error)
        self._parts = {name: self._parts[name] for name in listed}
        found = list(self._parts.values())
        self.damage += [part for part in found if isinstance(part, str)]
        commits = [part for part in found if isinstance(part, Commit)]
        self.commits = sorted(commits, key=lambda commit: (commit.first_epoch, commit.last_epoch))

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


def standing_designs(rows: Any) -> Any:
    """The designs among rows of a manifest, each once, without order."""
    rows = rows.filter(pc.equal(rows.column("kind"), "design"))
    ids = np.array(rows.column("design_id").to_pylist(), "S32")
    return rows.take(pa.array(np.unique(ids, return_index=True)[1]))


def _commit(root: Path, name: PartName, columns: list[str]) -> Commit:
    footer = read_footer(root, name)
    summary = read_summary(footer.records)
    statistics, exchanges = [], []
    for record in summary["records"]:
        island, epoch = record["island"], record["epoch"]
        exchanges.append((island, epoch, [(source, sent) for source, sent in record["arrivals"]], record["settled"]))
        for values in record["statistics"]:
            statistics.append((island, epoch, *(values[k] for k in _PLACES)))
    return Commit(
        *footer.epochs,
        Progress(**summary["progress"]),
        summary["elapsed_s"],
        np.array(statistics, np.float64).reshape(-1, len(STATISTICS)),
        exchanges,
        read_rows(root, name, columns),
    )
