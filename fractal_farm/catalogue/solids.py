"""Finished solids: solids/<design_id>/<parameters hash>/ with its meshes, solid.json and a list of checksums.

A solid appears as a whole, by the rename of its directory; what is there is finished.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.documents import encoded_document
from fractal_farm.catalogue.durable import Durability, put_directory
from fractal_farm.catalogue.layout import SOLIDS, crc32c
from fractal_farm.errors import FarmError, InputError

FACTS = "solid.json"
CERTIFICATE = "certificate.json"
CHECKSUMS = "checksums.json"

_ID = re.compile(r"[0-9a-f]{32}")
_HASH = re.compile(r"[0-9A-Za-z_-]{1,64}")
_FINDING = {"severity", "what", "how_much", "remedy"}
_FILE = re.compile(r"[0-9A-Za-z_-][0-9A-Za-z._-]{0,127}")


@dataclass(frozen=True)
class SolidInfo:
    """A finished solid.

    Attributes:
        design_id: the design.
        parameters_hash: hash of the parameters that the solid was made with.
        files: name -> path of its files.
        facts: content of solid.json.
    """

    design_id: str
    parameters_hash: str
    files: dict[str, Path]
    facts: dict[str, Any]

    @property
    def certificate(self) -> dict[str, Any] | None:
        """What `farm certify --json` says of it; None of a solid of an earlier version, which has none.

        Raises:
            FarmError: it cannot be read.
        """
        path = self.files.get(CERTIFICATE)
        if path is None:
            return None
        try:
            told = opened_certificate(path.read_bytes(), self.design_id)
        except OSError as error:
            raise FarmError(f"{path}: {error.strerror}") from error
        if told is None:
            raise FarmError(f"{path}: is no certificate of this design; `farm verify --repair` makes the solid again")
        return told


def add_solid(
    root: Path,
    design_id: str,
    parameters_hash: str,
    files: Mapping[str, bytes],
    durability: Durability = "full",
) -> bool:
    """Store a solid; see `Catalogue.add_solid`."""
    if not _ID.fullmatch(design_id) or not _HASH.fullmatch(parameters_hash):
        raise InputError(f"solid {design_id}/{parameters_hash}: 32 hex digits and a plain hash are needed")
    if FACTS not in files:
        raise InputError(f"solid {design_id}/{parameters_hash}: {FACTS} is missing among {sorted(files)}")
    for name in files:
        if not _FILE.fullmatch(name) or name == CHECKSUMS:
            raise InputError(f"solid {design_id}/{parameters_hash}: {name!r} cannot name a file")
    checksums = {name: {"bytes": len(data), "crc32c": crc32c(data)} for name, data in files.items()}
    whole = {**files, CHECKSUMS: encoded_document({"files": checksums})}
    return put_directory(root / SOLIDS / design_id / parameters_hash, whole, durability)


def opened_certificate(content: bytes, design_id: str) -> dict[str, Any] | None:
    """A stored certificate; None if it is none, or that of another design."""
    try:
        told = json.loads(content)
    except ValueError:
        return None
    sound = (
        isinstance(told, dict)
        and told.get("verdict") in ("pass", "fail")
        and told.get("design_id") == design_id
        and isinstance(told.get("material"), str)
        and isinstance(told.get("findings"), list)
        and all(isinstance(found, dict) and found.keys() >= _FINDING for found in told["findings"])
    )
    return told if sound else None


def list_solids(root: Path, design_id: str | None = None) -> Iterator[SolidInfo]:
    """The finished solids, in order of design and parameters; only those of one design if it is given.

    Raises:
        FarmError: a solid.json cannot be read.
    """
    for directory in sorted((root / SOLIDS).glob(f"{design_id or '*'}/*")):
        if directory.name.startswith(".") or not directory.is_dir():
            continue
        try:
            facts = json.loads((directory / FACTS).read_bytes())
        except (OSError, ValueError) as error:
            raise FarmError(f"{directory / FACTS}: cannot be read; remove the directory and mesh again") from error
        files = {path.name: path for path in sorted(directory.iterdir()) if path.name != CHECKSUMS}
        yield SolidInfo(directory.parent.name, directory.name, files, facts)
