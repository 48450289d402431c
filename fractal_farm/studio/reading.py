"""From the manifest to the columns and maps that the pages draw from; read a column at a time, without a Python row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue.identities import id_words
from fractal_farm.catalogue.judging import Judgement
from fractal_farm.catalogue.layout import HAND
from fractal_farm.catalogue.scan import Places, Rows, numbers
from fractal_farm.ifs.symmetry import NO_SYMMETRY, SYMMETRIES
from fractal_farm.studio.columns import MAP_NUMBERS, UNKNOWN, id_bytes

_SCORES = ("fitness", "d0", "d2", "lle", "gap", "similarity_dimension", "grams")
_READ = ("design_id", "run_id", "n_maps", *_SCORES, "niche", "symmetry", "created_us")
_MAPS = ("maps", "probabilities")
_FEW = 8  # of fewer rows than one in so many, only those are read
_SECOND_US = 1_000_000
_CODES = {symmetry.name: code for code, symmetry in enumerate(SYMMETRIES)}


def read_columns(rows: Rows, places: Places) -> dict[str, npt.NDArray[Any]]:
    """The columns of some rows that the manifest tells: all of `columns.COLUMNS` but judgements and groups.

    Raises:
        FarmError: a part is missing or damaged.
    """
    table = rows.take(_READ, places)
    created = pc.cast(table.column("created_us"), pa.int64())
    niche = numbers(pc.fill_null(pc.cast(table.column("niche"), pa.int64()), UNKNOWN))
    return {
        "design_id": id_bytes(id_words(table.column("design_id"))),
        "n_maps": numbers(table.column("n_maps")).astype(np.uint8),
        **{name: numbers(pc.fill_null(table.column(name), np.nan)).astype("<f4") for name in _SCORES},
        "niche": niche.astype("<u4"),
        "symmetry": _coded(table.column("symmetry")),
        "by_hand": _equal(table.column("run_id"), HAND),
        "created": (numbers(pc.fill_null(created, 0)) // _SECOND_US).astype("<u4"),
    }


def read_maps(rows: Rows, places: Places) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
    """The number of maps of some rows, (n,) uint8, and their maps and probabilities, (sum, 13) float32."""
    if len(places) < len(rows) // _FEW:
        counts, flat = _flat(rows.take(_MAPS, places))
        return counts, flat
    counts, flat = _flat(rows.read(_MAPS))  # to gather lists takes longer than to read them all
    starts = np.cumsum(counts, dtype=np.int64) - counts
    chosen = counts[places]
    before = np.cumsum(chosen, dtype=np.int64) - chosen
    steps = np.arange(int(chosen.sum(dtype=np.int64))) - np.repeat(before, chosen)
    return chosen, flat[np.repeat(starts[places], chosen) + steps]


def judged_columns(
    ids: npt.NDArray[np.uint8], judgements: Mapping[str, Judgement], row_of: Mapping[str, int]
) -> dict[str, npt.NDArray[np.uint8]]:
    """The columns rating, favourite and rejected of designs.

    Args:
        ids: (n, 16) bytes of their ids.
        judgements: design id -> what is thought of it.
        row_of: design id -> row, for all judged designs that have one.
    """
    found = {name: np.zeros(len(ids), np.uint8) for name in ("rating", "favourite", "rejected")}
    for identity, judgement in judgements.items():
        if (row := row_of.get(identity)) is not None and row < len(ids):
            found["rating"][row] = judgement.stars or 0
            found["favourite"][row] = judgement.favourite
            found["rejected"][row] = judgement.stars == 0
    return found


def _flat(table: Any) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
    """The maps of all rows of a table, one after the other."""
    counts, pieces = [np.zeros(0, np.uint8)], [np.zeros((0, MAP_NUMBERS), np.float32)]
    for maps, probabilities in zip(*(table.column(name).chunks for name in _MAPS), strict=True):
        counts.append(pc.list_value_length(probabilities).to_numpy(zero_copy_only=False).astype(np.uint8))
        shares = probabilities.flatten().to_numpy(zero_copy_only=False)
        pieces.append(np.empty((len(shares), MAP_NUMBERS), np.float32))
        pieces[-1][:, :12] = maps.flatten().to_numpy(zero_copy_only=False).reshape(-1, 12)
        pieces[-1][:, 12] = shares
    return np.concatenate(counts), np.concatenate(pieces)


def _coded(column: Any) -> npt.NDArray[np.uint8]:
    """A column of symmetries as their places in `SYMMETRIES`."""
    entries = pc.fill_null(column, NO_SYMMETRY).combine_chunks().dictionary_encode()
    entries = entries.combine_chunks() if isinstance(entries, pa.ChunkedArray) else entries
    codes = np.array([_CODES.get(name, 0) for name in entries.dictionary.to_pylist()] or [0], np.uint8)
    return np.asarray(codes[numbers(pa.chunked_array([entries.indices]))], np.uint8)


def _equal(column: Any, word: str) -> npt.NDArray[np.uint8]:
    return np.asarray(numbers(pc.cast(pc.fill_null(pc.equal(column, word), False), pa.uint8())), np.uint8)
