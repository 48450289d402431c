"""Manifest parts: one Parquet file is one commit (research 'storage', section 4.4).

The rows are a plain table that every Parquet reader opens. The footer carries what the farm needs besides:
the epochs and their records (the islands' own memory, opaque here) and the files that the rows refer to. The
name carries the checksum of the whole file, which is checked at each reading.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from fractal_farm.catalogue.layout import DESIGNS, FORMAT, PartName, belongs_to, crc32c, part_name
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.errors import FarmError

_DISTINCT_VALUES = [
    "run_id",
    "writer",
    "cloud_array",
    "family",
    "map_form",
    "operator",
    "generator_version",
    "parents.list.element",
]


@dataclass(frozen=True)
class Footer:
    """What a part carries besides its rows.

    Attributes:
        epochs: first and last epoch of the records.
        records: the islands' records, as they were committed.
        files: key -> (bytes, CRC32C) of every file that this commit put down before, keys relative to the
            root.
        fitness: identity of what scored the rows (`FitnessFormula.identity`); None in older parts.
    """

    epochs: tuple[int, int]
    records: bytes
    files: dict[str, tuple[int, int]]
    fitness: str | None = None


def list_parts(root: Path, run_id: str | None = None) -> list[PartName]:
    """The parts committed so far, in order of their names; only those of one run if `run_id` is given."""
    directory = root / DESIGNS
    if not directory.is_dir():
        return []
    names = (part_name(entry.name) for entry in directory.iterdir())
    return sorted(name for name in names if name and (run_id is None or belongs_to(name.writer, run_id)))


def encoded_part(rows: Any, writer: str, seq: int, footer: Footer) -> tuple[PartName, bytes]:
    """A table in `DESIGN_SCHEMA` as a part: its name and its bytes."""
    buffer = io.BytesIO()
    with pq.ParquetWriter(
        buffer,
        rows.schema,
        compression="zstd",
        use_dictionary=_DISTINCT_VALUES,
        write_statistics=["design_id", "epoch", "fitness"],
        write_page_checksum=True,
    ) as file:
        if rows.num_rows:
            file.write_table(rows)
        # Not in the schema's metadata, which Parquet writers store a second time.
        file.add_key_value_metadata(
            {
                **({"farm.fitness": footer.fitness} if footer.fitness else {}),
                "farm.format": FORMAT,
                "farm.writer": writer,
                "farm.seq": str(seq),
                "farm.epochs": json.dumps(footer.epochs),
                "farm.records": base64.b64encode(footer.records).decode(),
                "farm.shards": json.dumps([{"key": k, "bytes": n, "crc32c": c} for k, (n, c) in footer.files.items()]),
            }
        )
    content = buffer.getvalue()
    return PartName(writer, seq, rows.num_rows, crc32c(content)), content


def read_rows(root: Path, name: PartName, columns: Sequence[str]) -> Any:
    """Columns of a part as a table; null where an older part lacks one.

    Raises:
        FarmError: the part is missing or damaged.
    """
    file = _open_part(root, name)
    present = set(file.schema_arrow.names)
    table = file.read(columns=[column for column in columns if column in present], use_threads=False)
    wanted = pa.schema([DESIGN_SCHEMA.field(column) for column in columns])
    arrays = [
        table.column(field.name).cast(field.type) if field.name in present else pa.nulls(table.num_rows, field.type)
        for field in wanted
    ]
    return pa.Table.from_arrays(arrays, schema=wanted)


def read_footer(root: Path, name: PartName) -> Footer:
    """What a part carries besides its rows.

    Raises:
        FarmError: the part is missing or damaged.
    """
    metadata: Mapping[bytes, bytes] = _open_part(root, name).metadata.metadata
    first, last = json.loads(metadata[b"farm.epochs"])
    files = {entry["key"]: (entry["bytes"], entry["crc32c"]) for entry in json.loads(metadata[b"farm.shards"])}
    fitness = metadata.get(b"farm.fitness", b"").decode() or None
    return Footer((first, last), base64.b64decode(metadata[b"farm.records"]), files, fitness)


def _open_part(root: Path, name: PartName) -> Any:
    path = root / DESIGNS / name.file_name
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FarmError(f"{path}: cannot be read: {error.strerror}") from error
    if crc32c(content) != name.checksum:
        raise FarmError(
            f"{path}: damaged, its checksum is {crc32c(content):08x}; `farm verify {root} --repair` may mend it, "
            "or restore the file from a copy"
        )
    return pq.ParquetFile(pa.BufferReader(content))
