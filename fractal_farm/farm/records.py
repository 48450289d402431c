"""Epoch records and island states as bytes, for the catalogue: raw arrays behind one line of JSON, compressed.

The born rows of a record are not in its bytes: they are the rows of the manifest part that carries the record.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fractal_farm.evolution.designs import Designs
from fractal_farm.evolution.epoch import EpochRecord, GenerationStatistics, IslandState
from fractal_farm.evolution.hearsay import FIND
from fractal_farm.farm.events import Progress
from fractal_farm.farm.work import SetAside

_INDEX = np.dtype(np.int32)


@dataclass(frozen=True)
class Ledger:
    """What one manifest part says about the run.

    Attributes:
        records: records of whole epochs, in the order (epoch, island); their `born` is empty when unpacked.
        progress: totals of the run after the last of these epochs.
        elapsed_s: seconds that all sessions had worked by then (not part of any result).
        set_aside: genomes of these epochs that nobody could evaluate: (island, epoch, genome and reason).
        steered: steering requests that the run was bound to by then.
    """

    records: list[EpochRecord]
    progress: Progress
    elapsed_s: float
    set_aside: tuple[tuple[int, int, SetAside], ...] = ()
    steered: int = 0


def pack_ledger(ledger: Ledger) -> bytes:
    """A ledger as bytes, without the rows that were born."""
    header = {
        "progress": asdict(ledger.progress),
        "elapsed_s": ledger.elapsed_s,
        "set_aside": [[island, epoch, asdict(verdict)] for island, epoch, verdict in ledger.set_aside],
        "steered": ledger.steered,
        "records": [
            {
                "island": record.island,
                "epoch": record.epoch,
                "statistics": [list(asdict(entry).values()) for entry in record.statistics],
                "arrivals": record.arrivals,
                "settled": record.settled,
            }
            for record in ledger.records
        ],
    }
    arrays = [
        array
        for record in ledger.records
        for array in (_steps(record.survivors), record.entrants, _steps(record.order), record.emigrants, record.hits)
    ]
    return _pack(header, arrays)


def unpack_ledger(blob: bytes, dtype: np.dtype[Any]) -> Ledger:
    """The inverse of `pack_ledger`; `dtype` is that of the run's design rows."""
    header, arrays = _unpack(blob, [_INDEX, dtype, _INDEX, _INDEX, _INDEX])
    records = []
    for k, entry in enumerate(header["records"]):
        survivors, entrants, order, emigrants, hits = arrays[5 * k : 5 * k + 5]
        records.append(
            EpochRecord(
                entry["island"],
                entry["epoch"],
                np.cumsum(survivors, dtype=_INDEX),
                entrants,
                np.cumsum(order, dtype=_INDEX),
                emigrants,
                np.zeros(0, dtype),
                tuple(GenerationStatistics(*values) for values in entry["statistics"]),
                tuple((source, number) for source, number in entry["arrivals"]),
                entry["settled"],
                hits,
            )
        )
    set_aside = tuple((island, epoch, _verdict(entry)) for island, epoch, entry in header.get("set_aside", ()))
    return Ledger(records, Progress(**header["progress"]), header["elapsed_s"], set_aside, header.get("steered", 0))


def _steps(indices: Designs) -> Designs:
    """Differences of consecutive indices: of those that count up, nothing is left to store."""
    return np.diff(indices, prepend=_INDEX.type(0)).astype(_INDEX)


def _verdict(entry: dict[str, Any]) -> SetAside:
    return SetAside(entry["design_id"], tuple(tuple(row) for row in entry["genes"]), entry["reason"])


def read_summary(blob: bytes) -> dict[str, Any]:
    """What a ledger says without its arrays: progress, elapsed_s, and of each record island, epoch, statistics,
    arrivals and settled, as JSON has them.
    """
    stream = zlib.decompressobj()
    length = int.from_bytes(stream.decompress(blob, 4), "little")
    summary: dict[str, Any] = json.loads(stream.decompress(stream.unconsumed_tail, length))[0]
    return summary


def pack_states(states: dict[int, IslandState], found: Designs | None) -> bytes:
    """The states of all islands after one epoch, and what was found by then (`hearsay.FIND` rows)."""
    islands = sorted(states)
    found = np.zeros(0, FIND) if found is None else found
    arrays = [array for island in islands for array in (states[island].library, found[found["island"] == island])]
    return _pack({"islands": islands, "epoch": states[islands[0]].epoch}, arrays)


def unpack_states(blob: bytes, dtype: np.dtype[Any]) -> tuple[dict[int, IslandState], Designs]:
    """The inverse of `pack_states`."""
    header, arrays = _unpack(blob, [dtype, FIND])
    found = np.concatenate(arrays[1::2])
    states = {
        island: IslandState(header["epoch"], library)
        for island, library in zip(header["islands"], arrays[::2], strict=True)
    }
    return states, found[np.lexsort((found["island"], found["epoch"]))]


def _pack(header: Any, arrays: list[Designs]) -> bytes:
    head = json.dumps([header, [len(array) for array in arrays]], separators=(",", ":")).encode()
    body = b"".join(array.tobytes() for array in arrays)
    return zlib.compress(len(head).to_bytes(4, "little") + head + body, 6)


def _unpack(blob: bytes, dtypes: list[np.dtype[Any]]) -> tuple[Any, list[Designs]]:
    """Arrays follow each other in the order of `dtypes`, again and again."""
    raw = zlib.decompress(blob)
    start = 4 + int.from_bytes(raw[:4], "little")
    header, lengths = json.loads(raw[4:start])
    arrays = []
    for index, length in enumerate(lengths):
        dtype = dtypes[index % len(dtypes)]
        arrays.append(np.frombuffer(raw, dtype, length, start).copy())
        start += length * dtype.itemsize
    return header, arrays
