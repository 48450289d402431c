"""`RunWriter`: the one that puts a run's designs into a catalogue (research 'storage', section 4.4).

A commit puts the clouds down first, then one manifest part; the appearance of the part *is* the commit. A
writer's names are its own for ever, so writers need no lock between them; a resumed run takes a new writer.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from fractal_farm.catalogue.durable import Durability, put, put_all
from fractal_farm.catalogue.layout import CLOUDS, DESIGNS, FORMAT, checked_run_id, crc32c, new_writer
from fractal_farm.catalogue.parts import Commit, encoded_part
from fractal_farm.catalogue.schema import DESIGN_SCHEMA, GIVEN_SCHEMA, KINDS, OPTIONAL
from fractal_farm.catalogue.shards import (
    CAPACITY,
    POINTS,
    SHARD,
    array_metadata,
    group_metadata,
    shard_files,
)
from fractal_farm.errors import FarmError

if TYPE_CHECKING:
    from fractal_farm.ifs.quantised_cloud import QuantisedClouds


@dataclass(frozen=True)
class CommitReceipt:
    """What one commit added to the catalogue, durably.

    Attributes:
        seq: number of the commit within its writer.
        rows: designs.
        files: new files.
        bytes: their size.
    """

    seq: int
    rows: int
    files: int
    bytes: int


@dataclass(frozen=True)
class _Pending:
    """An encoded commit, kept until it is stored: a second attempt puts the same bytes at the same keys."""

    key: tuple[object, ...]
    files: dict[Path, bytes]
    part: Path
    content: bytes
    shards: int
    receipt: CommitReceipt


class RunWriter:
    """Commits of one attempt of one run; used by one thread of one process.

    Args:
        root: directory of the catalogue.
        run_id: 16 hex digits.
        node: name of the machine; what cannot stand in a file name is replaced.
        attempt: number of the attempt, 0 for the first.
        n_points: points of every cloud.
        clouds: "kept" stores the clouds; "none" keeps only their checksums, readers grow them again.
        durability: "full" survives a power cut, "process" the death of the process.
        fitness: identity of what scores the designs, see `parts.Commit`.
    """

    def __init__(
        self,
        root: Path,
        run_id: str,
        node: str,
        attempt: int,
        n_points: int,
        clouds: Literal["kept", "none"] = "kept",
        durability: Durability = "full",
        fitness: str | None = None,
    ) -> None:
        self._root = Path(root)
        self._run_id = checked_run_id(run_id)
        self._node = node
        self._attempt = attempt
        self._n_points = n_points
        self._clouds = clouds
        self._durability = durability
        self._fitness = fitness
        self._pending: _Pending | None = None
        self._name = ""
        self._seq = 0
        self._next_shard = 0
        self._announced = False
        self._begin()

    @property
    def name(self) -> str:
        """The writer's name; a new one once 2^20 cloud rows are used."""
        return self._name

    def commit(
        self,
        designs: Any,
        clouds: QuantisedClouds | None,
        records: bytes,
        epochs: tuple[int, int],
    ) -> CommitReceipt:
        """Store designs, their clouds and the islands' records as one; return when they are durable.

        After an error the same call may be repeated, and then stores the same bytes under the same names.
        Committing the same epochs twice is harmless: readers drop the second copy.

        Args:
            designs: `schema.GIVEN_SCHEMA` table (`rows.design_table` makes one); m >= 0 of its rows are of kind
                "design", the others "ancestor".
            clouds: the clouds of the m designs in their order; required if clouds are kept and m > 0, otherwise
                None leaves their checksums empty.
            records: opaque bytes, given back by `records.committed_records`.
            epochs: first and last epoch of the records.

        Raises:
            StorageFullError: no space left; repeat the call once there is.
            FarmError: the file system failed, the table is not as described, or an earlier commit failed and
                was not repeated.
        """
        key = (epochs, designs.num_rows, crc32c(records))
        if self._pending is None:
            self._pending = self._encoded(key, designs, clouds, records, epochs)
        elif self._pending.key != key:
            raise FarmError(
                f"{self._name}: commit {self._pending.receipt.seq} is not stored; repeat it before the next"
            )
        pending = self._pending
        if pending.files:
            self._announce()
            put_all(pending.files, self._durability)
        put(pending.part, pending.content, self._durability)
        self._pending = None
        self._seq += 1
        self._next_shard += pending.shards
        self._announced = self._announced or bool(pending.files)
        return pending.receipt

    def _begin(self) -> None:
        self._name = new_writer(self._run_id, self._node, self._attempt)
        self._seq = 0
        self._next_shard = 0
        self._announced = False

    def _encoded(
        self,
        key: tuple[object, ...],
        designs: Any,
        clouds: QuantisedClouds | None,
        records: bytes,
        epochs: tuple[int, int],
    ) -> _Pending:
        given = _checked(designs)
        kept = np.array([kind == KINDS[0] for kind in given.column("kind").to_pylist()], bool)
        count = int(kept.sum())
        if clouds is not None and clouds.points.shape != (count, self._n_points, 3):
            raise FarmError(
                f"commit of {count} designs: clouds of shape {clouds.points.shape}; this writer stores "
                f"({count}, {self._n_points}, 3)"
            )
        stored = self._clouds == "kept" and count > 0
        if stored and clouds is None:
            raise FarmError(f"commit of {count} designs without clouds, by a writer that keeps them")
        shards = -(-count // SHARD) if stored else 0
        if self._next_shard + shards > CAPACITY // SHARD:
            self._begin()
        directory = self._root / CLOUDS / self._name
        files: dict[Path, bytes] = {}
        if stored and clouds is not None:
            ids = given.column("design_id").filter(pa.array(kept)).to_pylist()
            chunks = shard_files(clouds, ids, self._next_shard)
            files = {directory / chunk: content for chunk, content in chunks.items()}
        listed = files if not stored or self._announced else {**self._metadata(), **files}
        references = {
            path.relative_to(self._root).as_posix(): (len(content), crc32c(content)) for path, content in listed.items()
        }
        rows = self._placed(given, kept, clouds, stored)
        commit = Commit(self._seq, given.num_rows, epochs, records, crc32c(records), references, self._fitness)
        name, content = encoded_part(rows, self._name, commit)
        part = self._root / DESIGNS / name.file_name
        receipt = CommitReceipt(
            self._seq, given.num_rows, len(listed) + 1, len(content) + sum(map(len, listed.values()))
        )
        return _Pending(key, files, part, content, shards, receipt)

    def _placed(self, given: Any, kept: npt.NDArray[np.bool_], clouds: QuantisedClouds | None, stored: bool) -> Any:
        """The given rows with the columns that say where and how the clouds of those kept are stored."""
        count = given.num_rows
        clouds_before = np.cumsum(kept) - 1

        def of_clouds(values: Sequence[Any] | npt.NDArray[Any]) -> list[Any]:
            return [values[i] if mine else None for i, mine in zip(clouds_before, kept, strict=True)]

        place: dict[str, Any] = {
            "run_id": [self._run_id] * count,
            "writer": [self._name] * count,
            "n_points": [self._n_points] * count,
            "created_us": [dt.datetime.now(dt.UTC).replace(tzinfo=None)] * count,
        }
        if stored:
            cloud_rows = np.arange(kept.sum()) + self._next_shard * SHARD
            place["cloud_array"] = of_clouds([POINTS] * len(cloud_rows))
            place["cloud_row"] = of_clouds(cloud_rows)
        if clouds is not None:
            checksums = [crc32c(points.astype("<u2", copy=False).tobytes()) for points in clouds.points]
            place["origin"] = of_clouds(clouds.origin)
            place["scale"] = of_clouds(clouds.scale)
            place["cloud_crc32c"] = of_clouds(checksums)
        arrays = []
        for field in DESIGN_SCHEMA:
            if field.name in place:
                arrays.append(pa.array(place[field.name], field.type))
            elif field.name in given.schema.names:
                arrays.append(given.column(field.name))
            else:
                arrays.append(pa.nulls(count, field.type))
        return pa.Table.from_arrays(arrays, schema=DESIGN_SCHEMA)

    def _metadata(self) -> Mapping[Path, bytes]:
        directory = self._root / CLOUDS / self._name
        arrays = {directory / name / "zarr.json": c for name, c in array_metadata(self._n_points).items()}
        return {directory / "zarr.json": group_metadata({"format": FORMAT, "writer": self._name}), **arrays}

    def _announce(self) -> None:
        """Write the metadata of the writer's arrays, once."""
        if not self._announced:
            put_all(self._metadata(), self._durability)


def _checked(designs: Any) -> Any:
    """The table in `GIVEN_SCHEMA`; columns that may be left out are null."""
    names = designs.schema.names
    missing = [n for n in GIVEN_SCHEMA.names if n not in names and n not in OPTIONAL]
    unknown = [name for name in names if name not in GIVEN_SCHEMA.names]
    if missing or unknown:
        raise FarmError(f"designs to commit: missing columns {missing}, unknown columns {unknown}")
    arrays = []
    for field in GIVEN_SCHEMA:
        if field.name not in names:
            arrays.append(pa.nulls(designs.num_rows, field.type))
            continue
        try:
            arrays.append(designs.column(field.name).combine_chunks().cast(field.type))
        except pa.ArrowException as error:
            raise FarmError(f"designs to commit: column {field.name}: {error}") from error
    return pa.Table.from_arrays(arrays, schema=GIVEN_SCHEMA)
