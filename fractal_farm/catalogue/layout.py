"""Where things lie in a catalogue, and how they are named (research 'storage', 4.1; DESIGN section 5).

    zarr.json                                   root group; attribute `fractal_farm` says format and features
    runs/<run_id>/                              run.json, lock, final~<n>~<crc32c>.json
        steering~<n>~<crc32c>.json, wish~...    what somebody wants it to breed from, see `steering`
    runs/hand/                                  judgement~<n>~<crc32c>.json; no run, but what people do
    clouds/<writer>/{points,transform,design_id}/     Zarr v3 arrays, one chunk file of each a commit
    manifest/designs/<writer>~<seq>~<rows>~<crc32c>.parquet     one file = one commit
    manifest/designs/<writer>~<seq>-<last>~<rows>~<crc32c of its end>~<crc32c>.parquet     commits merged into one file
    manifest/mendings/<hex>~<crc32c>.json       checksums of cloud files that a repair grew again with other bytes
    snapshots/<run_id>~<epoch>~<crc32c>.snapshot
    solids/<design_id>/<parameters hash>/       a finished solid, with solid.json
    identity.json                               which catalogue this is, once it has a mirror (`mirror`)
    catalogue.png, report.html, logs/, index/   can be made again, or lost
    quarantine/                                 what a repair moved aside; never read, never deleted

A writer's name is unique for ever, so that names never collide and nothing is overwritten.
"""

from __future__ import annotations

import re
import secrets
from pathlib import Path
from typing import NamedTuple

import google_crc32c

from fractal_farm.errors import InputError

FORMAT = "1.0"
FEATURES = frozenset({"merged-parts"})

RUNS = "runs"
HAND = "hand"
"""The pseudo-run of what people do: judgements, and designs that they made."""
CLOUDS = "clouds"
DESIGNS = "manifest/designs"
MENDINGS = "manifest/mendings"
SNAPSHOTS = "snapshots"
SOLIDS = "solids"
IDENTITY = "identity.json"
INDEX = "index"
QUARANTINE = "quarantine"

_RUN_ID = re.compile(r"[0-9a-z]{4,32}")
_PART = re.compile(
    r"(?P<writer>[^~/]+)~(?P<seq>\d{8})(-(?P<last>\d{8}))?~(?P<rows>\d{6})"
    r"(~(?P<end>[0-9a-f]{8}))?~(?P<checksum>[0-9a-f]{8})\.parquet"
)


class PartName(NamedTuple):
    """What the name of a manifest part says.

    Attributes:
        writer: name of the writer.
        seq: number of its first commit, from 0, without gaps within a writer.
        last: number of its last commit; that of the first unless commits were merged.
        rows: number of designs.
        checksum: CRC32C of the whole file.
        end: CRC32C of the Parquet footer, by which parts of a merged file can be read and trusted; None of a commit.
    """

    writer: str
    seq: int
    last: int
    rows: int
    checksum: int
    end: int | None = None

    @property
    def is_merged(self) -> bool:
        """Whether it holds several commits."""
        return self.end is not None

    @property
    def file_name(self) -> str:
        """Name of the file in `DESIGNS`."""
        if self.end is None:
            return f"{self.writer}~{self.seq:08d}~{self.rows:06d}~{self.checksum:08x}.parquet"
        return (
            f"{self.writer}~{self.seq:08d}-{self.last:08d}~{self.rows:06d}~{self.end:08x}~{self.checksum:08x}.parquet"
        )


def part_name(file_name: str) -> PartName | None:
    """The parsed name of a manifest part, or None for any other file."""
    found = _PART.fullmatch(file_name)
    if found is None or (found["last"] is None) != (found["end"] is None):
        return None
    seq, rows, checksum = int(found["seq"]), int(found["rows"]), int(found["checksum"], 16)
    if found["last"] is None:
        return PartName(found["writer"], seq, seq, rows, checksum)
    last, end = int(found["last"]), int(found["end"], 16)
    return PartName(found["writer"], seq, last, rows, checksum, end) if last > seq else None


def new_writer(run_id: str, node: str, attempt: int) -> str:
    """A name that nobody has used before: <run_id>-<node>-<attempt>-<8 random hex>."""
    plain = re.sub(r"[^0-9A-Za-z.]", "_", node) or "node"
    return f"{checked_run_id(run_id)}-{plain[:32]}-{attempt}-{secrets.token_hex(4)}"


def belongs_to(writer: str, run_id: str) -> bool:
    """Whether a writer worked for this run."""
    return writer.startswith(f"{run_id}-")


def checked_run_id(run_id: str) -> str:
    """The run id itself, if it can be part of a file name.

    Raises:
        InputError: it cannot.
    """
    if not _RUN_ID.fullmatch(run_id):
        raise InputError(f"run id {run_id!r}: 4 to 32 digits and small letters are allowed")
    return run_id


def run_directory(root: Path, run_id: str) -> Path:
    """runs/<run_id>."""
    return root / RUNS / checked_run_id(run_id)


def crc32c(content: bytes) -> int:
    """CRC32C (Castagnoli) of bytes, as an unsigned 32-bit integer."""
    return int(google_crc32c.value(content))
