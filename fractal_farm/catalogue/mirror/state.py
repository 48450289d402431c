"""How far a mirror is behind its catalogue, in a small file for whoever asks: index/mirror.json, which may be lost."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.durable import put
from fractal_farm.catalogue.layout import INDEX

MIRROR_STATE = f"{INDEX}/mirror.json"


@dataclass(frozen=True)
class Backlog:
    """What a mirror lacks.

    Attributes:
        files: number of files.
        bytes: their size.
        cause: why they do not arrive; None while they do.
    """

    files: int
    bytes: int
    cause: str | None = None


def write_state(root: Path, url: str, backlog: Backlog) -> None:
    """Tell how far the mirror at `url` is behind; see `durable.put` for what is raised."""
    content = {"url": url, "at": round(time.time(), 3), **asdict(backlog)}
    put(root / MIRROR_STATE, json.dumps(content).encode(), "process")


def read_state(root: Path) -> dict[str, Any] | None:
    """What `write_state` told last: url, at (seconds since 1970), files, bytes, cause; None if nothing."""
    try:
        content = json.loads((root / MIRROR_STATE).read_bytes())
        return {name: content[name] for name in ("url", "at", "files", "bytes", "cause")}
    except (OSError, ValueError, KeyError, TypeError):
        return None
