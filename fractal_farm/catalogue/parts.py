"""Manifest parts: one Parquet file is one commit, or several that were merged (research 'storage', section 4.4).

The rows are a plain table that every Parquet reader opens. The footer carries what the farm needs besides:
the epochs and their records (the islands' own memory, opaque here) and the files that the rows refer to. The
name carries the checksum of the whole file, which is checked at each reading of a commit. A merged part is large:
what is read of it is checked page by page, and its footer against a checksum of its own.
"""

from __future__ import annotations

import base64
import errno
import functools
import io
import json
import os
import zlib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from fractal_farm.catalogue.layout import DESIGNS, FORMAT, PartName, belongs_to, crc32c, part_name
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.errors import FarmError

ROW_GROUP = 8192
"""Rows that are read together of a merged part."""

_DISTINCT_VALUES = [
    "kind",
    "run_id",
    "writer",
    "cloud_array",
    "family",
    "map_form",
    "operator",
    "generator_version",
    "parents.list.element",
]
_STATISTICS = ["design_id", "epoch", "fitness"]
_TAIL_BYTES = 8

Result = TypeVar("Result")


class PartGoneError(FarmError):
    """A part is no longer there: it was merged into a larger one after it was listed."""


@dataclass(frozen=True)
class Commit:
    """What was committed at once, besides its rows.

    Attributes:
        seq: number of the commit within its writer.
        rows: designs.
        epochs: first and last epoch of the records.
        records: the islands' records, as they were committed; empty where they were not asked for.
        checksum: CRC32C of the records.
        files: key -> (bytes, CRC32C) of every file that the commit put down before, keys relative to the root.
        fitness: identity of what scored the rows (`FitnessFormula.identity`); None in older parts.
    """

    seq: int
    rows: int
    epochs: tuple[int, int]
    records: bytes
    checksum: int
    files: Mapping[str, tuple[int, int]]
    fitness: str | None = None


def list_parts(root: Path, run_id: str | None = None) -> list[PartName]:
    """The parts that hold what was committed so far, each commit once, in order of writers and commits.

    Only those of one run if `run_id` is given.
    """
    return _listed(root, run_id)[0]


def replaced_parts(root: Path, run_id: str | None = None) -> list[PartName]:
    """Parts whose commits a merged part holds too: what is left where a merge was interrupted."""
    return _listed(root, run_id)[1]


def read_of_parts(root: Path, run_id: str | None, read: Callable[[list[PartName]], Result]) -> Result:
    """What `read` makes of the parts; it is called again if some of them were merged meanwhile.

    Raises:
        FarmError: a part is missing or damaged.
    """
    while True:
        parts = list_parts(root, run_id)
        try:
            return read(parts)
        except PartGoneError:
            if list_parts(root, run_id) == parts:
                raise


def encoded_part(rows: Any, writer: str, commit: Commit) -> tuple[PartName, bytes]:
    """A table in `DESIGN_SCHEMA` as the part of one commit: its name and its bytes."""
    buffer = io.BytesIO()
    with _parquet_writer(buffer, rows.schema) as file:
        if rows.num_rows:
            file.write_table(rows)
        # Not in the schema's metadata, which Parquet writers store a second time.
        file.add_key_value_metadata(
            {
                **_about(writer, commit.seq),
                **({"farm.fitness": commit.fitness} if commit.fitness else {}),
                "farm.epochs": json.dumps(commit.epochs),
                "farm.records": base64.b64encode(commit.records).decode(),
                "farm.shards": json.dumps(_file_list(commit)),
            }
        )
    content = buffer.getvalue()
    return PartName(writer, commit.seq, commit.seq, rows.num_rows, crc32c(content)), content


def encoded_merged_part(rows: Any, writer: str, commits: Sequence[Commit]) -> tuple[PartName, bytes]:
    """Consecutive commits of a writer as one part, rows in the given order: its name and its bytes.

    The commits lie between the rows and the footer, where Parquet leaves room for what its readers need not know.
    """
    sink = pa.BufferOutputStream()
    with _parquet_writer(sink, rows.schema) as file:
        file.write_table(rows, row_group_size=ROW_GROUP)
        entries = []
        for commit in commits:
            place = (sink.tell(), len(commit.records), commit.checksum)
            sink.write(commit.records)
            entries.append([commit.seq, commit.rows, commit.epochs, place, _file_list(commit), commit.fitness])
        index = zlib.compress(json.dumps(entries, separators=(",", ":")).encode(), 6)
        place = (sink.tell(), len(index), crc32c(index))
        sink.write(index)
        about = _about(writer, commits[0].seq)
        file.add_key_value_metadata({**about, "farm.last": str(commits[-1].seq), "farm.commits": json.dumps(place)})
    content = sink.getvalue().to_pybytes()
    end = crc32c(content[-_end_bytes(content[-_TAIL_BYTES:]) :])
    return PartName(writer, commits[0].seq, commits[-1].seq, rows.num_rows, crc32c(content), end), content


def read_rows(root: Path, name: PartName, columns: Sequence[str]) -> Any:
    """Columns of a part as a table; null where an older part lacks one.

    Raises:
        PartGoneError: the part is no longer there.
        FarmError: it is damaged.
    """
    return read_columns(root, name, open_part(root, name), columns)


def read_columns(
    root: Path, name: PartName, file: Any, columns: Sequence[str], row_groups: Sequence[int] | None = None
) -> Any:
    """The same of a part that is open.

    Args:
        root: directory of the catalogue.
        name: the part.
        file: what `open_part` gave.
        columns: names of `DESIGN_SCHEMA`.
        row_groups: only these groups of `ROW_GROUP` rows of a merged part.

    Raises:
        FarmError: it is damaged.
    """
    present = set(file.schema_arrow.names)
    stored = [column for column in columns if column in present]
    try:
        if row_groups is None:
            table = file.read(columns=stored, use_threads=name.is_merged)
        else:
            table = file.read_row_groups(row_groups, columns=stored, use_threads=True)
    except (OSError, pa.ArrowException) as error:
        raise _damaged(root, name, str(error)) from error
    return as_asked(table, columns)


def as_asked(table: Any, columns: Sequence[str]) -> Any:
    """A stored table with just these columns of `DESIGN_SCHEMA`; null where it lacks one."""
    wanted = pa.schema([DESIGN_SCHEMA.field(column) for column in columns])
    arrays = [
        table.column(field.name).cast(field.type)
        if field.name in table.schema.names
        else pa.nulls(table.num_rows, field.type)
        for field in wanted
    ]
    return pa.Table.from_arrays(arrays, schema=wanted)


def read_commits(root: Path, name: PartName, *, records: bool | Collection[int] = True) -> list[Commit]:
    """The commits that a part holds, in order.

    Args:
        root: directory of the catalogue.
        name: the part.
        records: whether their records are wanted, or the numbers of the commits whose are.

    Raises:
        PartGoneError: the part is no longer there.
        FarmError: it is damaged.
    """

    def wanted(seq: int) -> bool:
        return records if isinstance(records, bool) else seq in records

    if not name.is_merged:
        metadata: Mapping[bytes, bytes] = open_part(root, name).metadata.metadata
        first, last = json.loads(metadata[b"farm.epochs"])
        files = _file_dictionary(json.loads(metadata[b"farm.shards"]))
        blob = base64.b64decode(metadata[b"farm.records"])
        fitness = metadata.get(b"farm.fitness", b"").decode() or None
        kept = blob if wanted(name.seq) else b""
        return [Commit(name.seq, name.rows, (first, last), kept, crc32c(blob), files, fitness)]
    with _opened(root, name) as file:
        return [
            replace(commit, records=_piece(root, name, file, place)) if wanted(commit.seq) else commit
            for commit, place in _merged_commits(root, name)
        ]


def epochs_of(commits: Sequence[Commit]) -> tuple[int, int]:
    """First and last epoch of some commits."""
    return min(commit.epochs[0] for commit in commits), max(commit.epochs[1] for commit in commits)


def open_part(root: Path, name: PartName) -> Any:
    """A part as a `pyarrow.parquet.ParquetFile` whose metadata are sound, and whose pages are checked when read.

    Raises:
        PartGoneError: the part is no longer there.
        FarmError: it is damaged.
    """
    # What is checked is what is read: a part is opened once, for another merge may remove its name at any instant.
    file = _opened(root, name)
    if not name.is_merged:
        with file:
            content = file.read()
        if crc32c(content) != name.checksum:
            raise _damaged(root, name, f"its checksum is {crc32c(content):08x}")
        return pq.ParquetFile(pa.BufferReader(content))
    size = file.size()
    file.seek(max(0, size - _TAIL_BYTES))
    length = _end_bytes(file.read())
    file.seek(max(0, size - length))
    end = file.read()
    if crc32c(end) != name.end:
        raise _damaged(root, name, f"the checksum of its footer is {crc32c(end):08x}")
    return pq.ParquetFile(file, page_checksum_verification=True)


@functools.lru_cache(maxsize=64)
def _merged_commits(root: Path, name: PartName) -> list[tuple[Commit, tuple[int, int, int]]]:
    """The commits of a merged part without their records, and where those lie in it: (offset, length, CRC32C)."""
    place = json.loads(open_part(root, name).metadata.metadata[b"farm.commits"])
    with _opened(root, name) as file:
        entries = json.loads(zlib.decompress(_piece(root, name, file, place)))
    return [
        (Commit(seq, rows, (epochs[0], epochs[1]), b"", place[2], _file_dictionary(files), fitness), tuple(place))
        for seq, rows, epochs, place, files, fitness in entries
    ]


def _listed(root: Path, run_id: str | None) -> tuple[list[PartName], list[PartName]]:
    directory = root / DESIGNS
    names = [part_name(entry.name) for entry in directory.iterdir()] if directory.is_dir() else []
    return told_apart(name for name in names if name and (run_id is None or belongs_to(name.writer, run_id)))


def told_apart(names: Iterable[PartName]) -> tuple[list[PartName], list[PartName]]:
    """Parts that hold each commit once, in order of writers and commits, and those whose commits they hold, too."""
    holding: list[PartName] = []
    replaced: list[PartName] = []
    for name in sorted(names, key=lambda name: (name.writer, name.seq, -name.last, name.file_name)):
        (replaced if holding and holds(holding[-1], name) else holding).append(name)
    return holding, replaced


def holds(wider: PartName, name: PartName) -> bool:
    """Whether a merged part holds all commits of another one."""
    inside = wider.seq <= name.seq and name.last <= wider.last
    return wider.writer == name.writer and inside and (wider.seq, wider.last) != (name.seq, name.last)


def _opened(root: Path, name: PartName) -> Any:
    path = root / DESIGNS / name.file_name
    try:
        return pa.OSFile(str(path))
    except FileNotFoundError as error:
        raise PartGoneError(f"{path}: cannot be read: {os.strerror(error.errno or errno.EIO)}") from error
    except OSError as error:
        raise FarmError(f"{path}: cannot be read: {os.strerror(error.errno or errno.EIO)}") from error


def _piece(root: Path, name: PartName, file: Any, place: Sequence[int]) -> bytes:
    """A range of a merged part: (offset, length, CRC32C)."""
    offset, length, checksum = place
    file.seek(offset)
    content: bytes = file.read(length)
    if crc32c(content) != checksum:
        raise _damaged(root, name, "its records have another checksum")
    return content


def _parquet_writer(sink: Any, schema: Any) -> Any:
    return pq.ParquetWriter(
        sink,
        schema,
        compression="zstd",
        use_dictionary=_DISTINCT_VALUES,
        write_statistics=_STATISTICS,
        write_page_checksum=True,
    )


def _about(writer: str, seq: int) -> dict[str, str]:
    return {"farm.format": FORMAT, "farm.writer": writer, "farm.seq": str(seq)}


def _end_bytes(tail: bytes) -> int:
    """Length of a Parquet footer with its tail: the length of the metadata, and PAR1."""
    return int.from_bytes(tail[:4], "little") + _TAIL_BYTES


def _file_list(commit: Commit) -> list[dict[str, Any]]:
    return [{"key": key, "bytes": size, "crc32c": checksum} for key, (size, checksum) in commit.files.items()]


def _file_dictionary(entries: Sequence[Mapping[str, Any]]) -> dict[str, tuple[int, int]]:
    return {entry["key"]: (entry["bytes"], entry["crc32c"]) for entry in entries}


def _damaged(root: Path, name: PartName, what: str) -> FarmError:
    return FarmError(
        f"{root / DESIGNS / name.file_name}: damaged, {what}; `farm verify {root} --repair` may mend it, or restore "
        "the file from a copy"
    )
