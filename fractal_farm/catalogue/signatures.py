"""The signatures of all designs in one matrix: what `similar` and `prototypes` search, kept in a disposable file.

`index/signatures~<key>~<crc32c>.arrow` holds 73 bytes a design. Its key is a hash of the manifest's part names and of
the discriminants, so that a catalogue that has grown, or was merged, gets another one; its checksum is looked at each
time. A lost, damaged or outdated file is made again from the manifest; where none can be written, it is done without.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from fractal_farm.catalogue.durable import put
from fractal_farm.catalogue.identities import DIGITS, find_id, id_array
from fractal_farm.catalogue.layout import INDEX, PartName, crc32c
from fractal_farm.catalogue.parts import PartGoneError, read_of_parts
from fractal_farm.catalogue.scan import Rows, numbers
from fractal_farm.catalogue.schema import DESCRIPTOR_LENGTH
from fractal_farm.distinctness import LENGTH, projection, signatures
from fractal_farm.errors import FarmError

_MARKS = tuple(f"mark{axis}" for axis in range(LENGTH))
_NUMBERS = {"fitness": np.float32, "gap": np.float32, "n_maps": np.int8}
_FIELDS: list[tuple[str, Any]] = [*((field, np.float32) for field in _MARKS), *_NUMBERS.items(), ("place", np.int32)]
_READ = ("d0", "d2", "descriptor", *_NUMBERS)
_BLOCK = 1 << 16

IntArray = npt.NDArray[np.intp]


@dataclass(frozen=True)
class SignatureIndex:
    """All designs of a catalogue, each once, in order of design_id.

    Attributes:
        root: the catalogue.
        parts: the manifest parts that it was made of.
        ids: (n,) bytes of 32, the design ids.
        marks: (6, n) float32 signatures, in units of what makes two designs distinct; nan where there is no descriptor.
        fitness: (n,) float32.
        gap: (n,) float32, nan where it is not known.
        n_maps: (n,) int8.
        places: (n,) int32, rows of the parts, counted through.
    """

    root: Path
    parts: tuple[PartName, ...]
    ids: npt.NDArray[np.bytes_]
    marks: npt.NDArray[np.float32]
    fitness: npt.NDArray[np.float32]
    gap: npt.NDArray[np.float32]
    n_maps: npt.NDArray[np.int8]
    places: npt.NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.ids)

    def design_id(self, index: int) -> str:
        """32 hex digits."""
        return bytes(self.ids[index]).decode()

    def find(self, design_id: str) -> int:
        """Index of a design.

        Args:
            design_id: 32 hex digits, or the first four or more if no other design begins with them.

        Raises:
            InputError: no such design, or several.
        """
        return find_id(self.ids, design_id, self.root)

    def distances(self, mark: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Distances (n,) of all designs from a signature (6,); nan where there is none."""
        total = np.zeros(len(self), np.float32)
        for values, centre in zip(self.marks, np.asarray(mark, np.float32), strict=True):
            difference = values - centre
            difference *= difference
            total += difference
        return np.sqrt(total, out=total)

    def nearest(self, mark: npt.ArrayLike, count: int) -> IntArray:
        """Indices of the designs nearest to a signature, nearest first, of equal ones in order of design_id."""
        distances = self.distances(mark)
        known = int(np.isfinite(distances).sum())
        count = min(count, known)
        if count == 0:
            return np.zeros(0, np.intp)
        farthest = np.partition(distances, count - 1)[count - 1]  # nan comes last
        near = np.flatnonzero(distances <= farthest)
        return near[np.argsort(distances[near], kind="stable")[:count]]

    def rows(self, indices: Sequence[int] | IntArray, columns: Sequence[str]) -> list[dict[str, Any]]:
        """Rows of the manifest, column -> value, in the order of the indices.

        Raises:
            FarmError: a manifest part is missing or damaged.
        """
        rows = Rows([(self.root, part) for part in self.parts])
        places = self.places[np.asarray(indices, np.intp)].astype(np.int64)
        try:
            found: list[dict[str, Any]] = rows.take(columns, places).to_pylist()
        except PartGoneError:  # merged with others since they were listed
            now = open_signatures(self.root)
            if now.parts == self.parts:
                raise
            return now.rows([now.find(self.design_id(index)) for index in indices], columns)
        return found


def open_signatures(root: Path) -> SignatureIndex:
    """The index of a catalogue as it is now, from its file, or from the manifest if there is none for it.

    Raises:
        FarmError: a manifest part is missing or damaged.
    """
    return read_of_parts(root, None, lambda parts: _opened(root, tuple(part for part in parts if part.rows)))


def _opened(root: Path, parts: tuple[PartName, ...]) -> SignatureIndex:
    name = f"signatures~{_key(parts)}"
    table = _stored(root, name)
    if table is None:
        table = _built(root, parts)
        if table.num_rows:
            _store(root, name, table)
    arrays = {field: numbers(table.column(field)) for field, _ in _FIELDS}
    ids = np.frombuffer(table.column("design_id").chunk(0).buffers()[1], f"S{DIGITS}", table.num_rows)
    marks = np.stack([arrays[field] for field in _MARKS])
    return SignatureIndex(root, parts, ids, marks, *(arrays[field] for field in (*_NUMBERS, "place")))


def standing_designs(root: Path, parts: Sequence[PartName]) -> npt.NDArray[np.int64] | None:
    """The rows of some parts that are designs, each once, in ascending order, if a file knows them; None if none does.

    Like `Rows.standing`, without reading a million ids.
    """
    table = _stored(root, f"signatures~{_key([part for part in parts if part.rows])}")
    return None if table is None else np.sort(numbers(table.column("place"))).astype(np.int64)


def row_signatures(table: Any) -> npt.NDArray[np.float64]:
    """Signatures (n, 6) of the rows of a table with the columns descriptor, d0 and d2; nan where there is none."""
    column = table.column("descriptor").combine_chunks()
    descriptors = np.full((table.num_rows, DESCRIPTOR_LENGTH), np.nan, np.float32)
    flat = column.drop_null().flatten().to_numpy(zero_copy_only=False)
    descriptors[column.is_valid().to_numpy(zero_copy_only=False)] = flat.reshape(-1, DESCRIPTOR_LENGTH)
    return signatures(descriptors, table.column("d0").to_numpy(), table.column("d2").to_numpy())


def _key(parts: Sequence[PartName]) -> str:
    content = "\n".join([repr(projection()), *(part.file_name for part in parts)])
    return hashlib.blake2b(content.encode(), digest_size=8, person=b"farm-index-1").hexdigest()


def _built(root: Path, parts: Sequence[PartName]) -> Any:
    rows = Rows([(root, part) for part in parts])
    places = rows.standing(ancestors=False)
    ids = id_array(rows.read(["design_id"]).column(0))[places]
    facts = np.empty(len(places), _FIELDS)
    facts["place"] = places
    for start in range(0, len(places), _BLOCK):
        block = slice(start, start + _BLOCK)
        table = rows.take(_READ, places[block])
        for field, values in zip(_MARKS, row_signatures(table).T, strict=True):
            facts[field][block] = values
        for field in _NUMBERS:
            facts[field][block] = table.column(field).to_numpy()
    order = np.argsort(ids)
    return pa.table(
        {
            "design_id": pa.FixedSizeBinaryArray.from_buffers(
                pa.binary(DIGITS), len(order), [None, pa.py_buffer(ids[order].tobytes())]
            ),
            **{field: np.ascontiguousarray(facts[field][order]) for field, _ in _FIELDS},
        }
    )


def _stored(root: Path, name: str) -> Any:
    """The table in the file of this name, mapped into memory; None if there is none, or it is damaged."""
    for path in sorted((root / INDEX).glob(f"{name}~????????.arrow")):
        with contextlib.suppress(OSError, pa.ArrowException):
            content = pa.memory_map(str(path)).read_buffer()
            if path.stem.rpartition("~")[2] == f"{crc32c(content):08x}":
                return pa.ipc.open_file(content).read_all()
    return None


def _store(root: Path, name: str, table: Any) -> None:
    """Put the table beside the manifest, in place of older ones; done without where nothing can be written."""
    sink = pa.BufferOutputStream()
    with pa.ipc.new_file(sink, table.schema) as file:
        file.write_table(table, max_chunksize=max(1, table.num_rows))
    content = sink.getvalue()
    path = root / INDEX / f"{name}~{crc32c(content):08x}.arrow"
    with contextlib.suppress(FarmError, OSError):
        outdated = set((root / INDEX).glob("signatures~*")) - {path}
        put(path, content, "process")
        for old in outdated:
            old.unlink(missing_ok=True)
