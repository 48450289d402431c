"""What people think of designs: stars and favourites, as events of the pseudo-run `hand` (DESIGN section 5).

runs/hand/judgement~<number>~<crc32c>.json is written once for each act of judging, under the lock of `hand`, so that
several processes may judge at the same time. What is said last of a design counts. Judgements never enter the digest.
"""

from __future__ import annotations

import datetime as dt
import functools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from fractal_farm.catalogue.documents import encoded_document, read_document
from fractal_farm.catalogue.durable import PARTIAL, put
from fractal_farm.catalogue.layout import HAND, crc32c, run_directory
from fractal_farm.catalogue.runs import run_lock
from fractal_farm.errors import InputError

MOST_STARS = 5
_JUDGEMENT = re.compile(r"judgement~(?P<number>\d{8})~[0-9a-f]{8}\.json")
_PATIENCE_SECONDS = 60.0


@dataclass(frozen=True)
class Judgement:
    """What is thought of a design.

    Attributes:
        stars: 0 (rejected) to 5; None: not said.
        favourite: whether it is one of the favourites.
    """

    stars: int | None = None
    favourite: bool = False

    @property
    def grade(self) -> int | None:
        """0 to 5, of which a favourite has 5; None without a judgement."""
        return MOST_STARS if self.favourite else self.stars

    def __str__(self) -> str:
        """Such as `4 stars, favourite`."""
        stars = {None: "no stars", 0: "rejected", 1: "1 star"}.get(self.stars, f"{self.stars} stars")
        return f"{stars}, favourite" if self.favourite else stars


NONE = Judgement()


def judge(
    root: Path, design_ids: Sequence[str], *, stars: int | None = None, favourite: bool | None = None
) -> dict[str, Judgement]:
    """Record one judgement of some designs, durably.

    Args:
        root: directory of the catalogue.
        design_ids: 32 hex digits each; whether there are such designs is not looked at.
        stars: 0 (rejected) to 5; None leaves them as they are.
        favourite: whether they are favourites; None leaves that as it is.

    Returns:
        What is thought of these designs now.

    Raises:
        InputError: other stars, or other processes judge for a minute without end.
        FarmError: the file system failed.
    """
    if stars is not None and not 0 <= stars <= MOST_STARS:
        raise InputError(f"stars {stars}: give 0 (rejected) to {MOST_STARS}")
    said = {name: value for name, value in (("stars", stars), ("favourite", favourite)) if value is not None}
    return _record(root, design_ids, said)


def withdraw(root: Path, design_ids: Sequence[str]) -> dict[str, Judgement]:
    """Take back what was said of some designs; see `judge`."""
    return _record(root, design_ids, {"stars": None, "favourite": False})


def judgements(root: Path) -> dict[str, Judgement]:
    """What is thought of each design that somebody has judged.

    Raises:
        FarmError: a judgement is damaged.
    """
    found: dict[str, Judgement] = {}
    for _, path in _numbered(root):
        designs, said = _read(path)
        for identity in designs:
            found[identity] = replace(found.get(identity, NONE), **said)
    return {identity: judgement for identity, judgement in found.items() if judgement != NONE}


def with_judgements(root: Path, designs: Any) -> Any:
    """A table of designs with the columns `stars` (int8, null where nobody has said) and `favourite`.

    Raises:
        FarmError: a judgement is damaged.
    """
    found = judgements(root)
    if not found:  # as a rule; whatever makes an Arrow array of Python's values imports pandas first
        bits = pa.py_buffer(bytes(len(designs) // 8 + 1))
        unsaid = pa.Array.from_buffers(pa.bool_(), len(designs), [None, bits])
        return designs.append_column("stars", pa.nulls(len(designs), pa.int8())).append_column("favourite", unsaid)
    place = pc.index_in(designs.column("design_id"), pa.array(list(found), pa.string()))
    stars = pa.array([judgement.stars for judgement in found.values()], pa.int8())
    favourite = pa.array([judgement.favourite for judgement in found.values()], pa.bool_())
    return designs.append_column("stars", stars.take(place)).append_column(
        "favourite", pc.fill_null(favourite.take(place), False)
    )


def missing_numbers(names: Sequence[str]) -> list[int]:
    """Numbers that no judgement among some file names has, though a later one follows."""
    numbers = {int(found["number"]) for name in names if (found := _JUDGEMENT.fullmatch(name))}
    return sorted(set(range(max(numbers, default=0))) - numbers)


def fill_gaps(root: Path) -> None:
    """Put an empty judgement in place of each that is lost; the caller holds the lock of `hand`."""
    for number in missing_numbers([path.name for _, path in _numbered(root)]):
        _write(root, number, (), {})


def _record(root: Path, design_ids: Sequence[str], said: dict[str, Any]) -> dict[str, Judgement]:
    with run_lock(root, HAND, _PATIENCE_SECONDS):
        for partial in run_directory(root, HAND).glob(f".*{PARTIAL}"):
            partial.unlink()
        numbers = [number for number, _ in _numbered(root)]
        _write(root, numbers[-1] + 1 if numbers else 0, design_ids, said)
    known = judgements(root)
    return {identity: known.get(identity, NONE) for identity in design_ids}


def _write(root: Path, number: int, design_ids: Sequence[str], said: dict[str, Any]) -> None:
    now = dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")
    content = encoded_document({"at": now, "designs": list(design_ids), "said": said})
    put(run_directory(root, HAND) / f"judgement~{number:08d}~{crc32c(content):08x}.json", content)


@functools.lru_cache(1 << 16)
def _read(path: Path) -> tuple[tuple[str, ...], dict[str, Any]]:
    """The designs of a judgement, and what is said of them; files of these names never change."""
    document = read_document(path)
    return tuple(document["designs"]), document["said"]


def _numbered(root: Path) -> list[tuple[int, Path]]:
    """(number, path) in order."""
    directory = run_directory(root, HAND)
    found = ((_JUDGEMENT.fullmatch(path.name), path) for path in directory.glob("judgement~*.json"))
    return sorted((int(name["number"]), path) for name, path in found if name)
