"""Publishing: the designs of a catalogue as files that need no farm, best first (DESIGN section 5).

    designs.parquet     one sorted table with every column, and the signature of each shape
    clouds.zarr/        one dense Zarr v3 array of quantised clouds; design k is row k of the table
    collection.json     what it is, in the form of a STAC collection, without a place on Earth: licence, ranges, columns
    checksums.sha256    for `sha256sum -c`

Rows and clouds go through memory a block at a time.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from fractal_farm.catalogue.cloud_export import write_clouds
from fractal_farm.catalogue.durable import new_directory
from fractal_farm.catalogue.parts import read_of_parts
from fractal_farm.catalogue.reader import Catalogue
from fractal_farm.catalogue.scan import Rows
from fractal_farm.catalogue.schema import DESIGN_SCHEMA
from fractal_farm.catalogue.signatures import row_signatures
from fractal_farm.distinctness import LENGTH
from fractal_farm.errors import InputError

DESIGNS = "designs.parquet"
CLOUDS = "clouds.zarr"
COLLECTION = "collection.json"
CHECKSUMS = "checksums.sha256"
NO_LICENCE = "other"
"""What STAC calls a licence that is not in its list; here: none was given."""

BLOCK = 1 << 16
_ROW_GROUP = 1 << 14
_PLACES = ("writer", "cloud_array", "cloud_row")
_RANGES = ("fitness", "d0", "d2", "lle", "gap", "similarity_dimension")
_SIGNATURE = pa.field(
    "signature",
    pa.list_(pa.field("element", pa.float64()), LENGTH),
    metadata={"unit": "1", "meaning": "discriminants of the shape; designs less than 1 apart differ by chance alone"},
)
SCHEMA = pa.schema([*(field for field in DESIGN_SCHEMA if field.name not in _PLACES), _SIGNATURE])
"""Columns of the table: those of a catalogue but the places of clouds, and the signature."""


@dataclass(frozen=True)
class Exported:
    """What was published.

    Attributes:
        designs: rows of the table.
        clouds: clouds, 0 without them.
        bytes: of all files.
    """

    designs: int
    clouds: int
    bytes: int


def export(
    catalogue: Catalogue,
    out: Path,
    where: Any = None,
    names: tuple[str, ...] = (),
    *,
    clouds: bool = True,
    licence: str = NO_LICENCE,
    told: Mapping[str, Any] | None = None,
) -> Exported:
    """Publish designs in a new directory, which appears when it is complete.

    Args:
        catalogue: where they are.
        out: the directory; it must not exist.
        where: pyarrow expression that is true of the wanted designs; all if None.
        names: columns that the expression refers to.
        clouds: whether to publish the clouds, too.
        licence: SPDX identifier.
        told: further entries of the collection.

    Raises:
        InputError: the directory exists, no design is wanted, or the clouds differ in their number of points.
        StorageFullError: no space left; nothing stays behind.
        FarmError: a part or a cloud is missing or damaged.
    """
    # A live run may merge parts while they are read; then all is read again.
    return read_of_parts(
        catalogue.path, None, lambda _: _exported(catalogue, out, where, names, clouds, licence, told or {})
    )


def _exported(
    catalogue: Catalogue,
    out: Path,
    where: Any,
    names: tuple[str, ...],
    clouds: bool,
    licence: str,
    told: Mapping[str, Any],
) -> Exported:
    with new_directory(out, [catalogue.path]) as place:
        rows, places = catalogue.selection(where, names)
        if not len(places):
            raise InputError(f"{catalogue.path}: no design to export; `farm list` shows the designs")
        summary = _write_table(place / DESIGNS, rows, places)
        if clouds:
            write_clouds(place / CLOUDS, catalogue.path, rows, places, {"license": licence})
        collection = _collection(catalogue, out.name, len(places), summary, clouds, licence) | dict(told)
        (place / COLLECTION).write_text(json.dumps(collection, indent=2, ensure_ascii=False) + "\n")
        size = _write_checksums(place)
    return Exported(len(places), len(places) if clouds else 0, size)


def _write_table(path: Path, rows: Rows, places: Any) -> dict[str, Any]:
    """Write the table; smallest and largest values of some columns, the numbers of maps, and the times of birth."""
    ranges: dict[str, list[Any]] = {}
    counts: set[int] = set()
    stored = [name for name in SCHEMA.names if name != _SIGNATURE.name]
    with pq.ParquetWriter(path, SCHEMA, compression="zstd", write_page_checksum=True) as file:
        for start in range(0, len(places), BLOCK):
            block = rows.take(stored, places[start : start + BLOCK])
            block = block.append_column(_SIGNATURE, _signatures(block)).cast(SCHEMA)
            file.write_table(block, row_group_size=_ROW_GROUP)
            for name in (*_RANGES, "created_us"):
                ends = pc.min_max(block.column(name)).as_py()
                ranges.setdefault(name, []).extend(end for end in ends.values() if end is not None)
            counts.update(pc.unique(block.column("n_maps")).to_pylist())
    return {
        "ranges": {name: (min(values), max(values)) for name, values in ranges.items() if values},
        "n_maps": sorted(counts),
    }


def _signatures(block: Any) -> Any:
    """A column of signatures; null where there is no descriptor."""
    marks = row_signatures(block)
    array = pa.FixedSizeListArray.from_arrays(pa.array(marks.ravel()), type=_SIGNATURE.type)
    return array.take(pa.array(np.arange(len(marks)), mask=~np.isfinite(marks).all(axis=1)))


def _collection(
    catalogue: Catalogue, name: str, designs: int, summary: Mapping[str, Any], clouds: bool, licence: str
) -> dict[str, Any]:
    ranges = summary["ranges"]
    born = [f"{moment.isoformat(timespec='seconds')}Z" for moment in ranges["created_us"]]
    assets = {
        "designs": {
            "href": f"./{DESIGNS}",
            "type": "application/vnd.apache.parquet",
            "title": "Genomes, scores and lineage, best first",
            "roles": ["data"],
            "table:row_count": designs,
        }
    }
    if clouds:
        assets["clouds"] = {
            "href": f"./{CLOUDS}",
            "type": "application/vnd.zarr; version=3",
            "title": "Point clouds: row k is design k of the table; xyz = points / 65535 * scale + origin",
            "roles": ["data"],
        }
    assets["checksums"] = {"href": f"./{CHECKSUMS}", "type": "text/plain", "roles": ["metadata"]}
    return {
        "type": "Collection",
        "stac_version": "1.1.0",
        "stac_extensions": ["https://stac-extensions.github.io/table/v1.2.0/schema.json"],
        "id": name,
        "title": f"{designs:,} fractal designs",
        "description": "Iterated function systems, evolved and scored by Fractal Farm after Pang and Hui (2009).",
        "license": licence,
        "extent": {"temporal": {"interval": [born]}},
        "links": [{"rel": "self", "href": f"./{COLLECTION}", "type": "application/json"}],
        "summaries": {
            "n_maps": summary["n_maps"],
            **{name: {"minimum": ends[0], "maximum": ends[1]} for name, ends in ranges.items() if name in _RANGES},
        },
        "table:columns": list(_columns()),
        "assets": assets,
        "farm:runs": {run.run_id: run.description for run in catalogue.runs()},
    }


def _columns() -> Iterator[dict[str, str]]:
    for field in SCHEMA:
        about = {key.decode(): value.decode() for key, value in (field.metadata or {}).items()}
        unit = {"unit": about["unit"]} if about.get("unit") else {}
        yield {"name": field.name, "type": str(field.type), "description": about.get("meaning", ""), **unit}


def _write_checksums(place: Path) -> int:
    """Write the list of checksums; bytes of all files."""
    lines, size = [], 0
    for path in sorted(path for path in place.rglob("*") if path.is_file()):
        with path.open("rb") as file:
            lines.append(f"{hashlib.file_digest(file, 'sha256').hexdigest()}  {path.relative_to(place).as_posix()}\n")
        size += path.stat().st_size
    (place / CHECKSUMS).write_text("".join(lines))
    return size + (place / CHECKSUMS).stat().st_size
