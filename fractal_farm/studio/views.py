"""Saved views: names of filters that somebody wants again, in logs/studio-views.json of the catalogue.

They may be lost without harm, so that they lie where no checksum is expected.
"""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.durable import put
from fractal_farm.errors import InputError
from fractal_farm.studio.bodies import MOST_VIEWS

_FILE = "logs/studio-views.json"
_MOST_BYTES = 1 << 20
_writing = threading.Lock()


def saved_views(root: Path) -> list[dict[str, Any]]:
    """Name and query of each view, in order of names; none where the file is missing or damaged."""
    return [{"name": name, "query": query} for name, query in sorted(_read(root).items())]


def save_view(root: Path, name: str, query: str | None) -> list[dict[str, Any]]:
    """Remember a view, in place of one of the same name; a query of None forgets it.

    Raises:
        InputError: there are too many.
        FarmError: the file system failed.
    """
    with _writing:
        views = _read(root)
        if query is None:
            views.pop(name, None)
        else:
            views[name] = query
        if len(views) > MOST_VIEWS:
            raise InputError(f"{MOST_VIEWS} views are saved already; remove one first")
        put(root / _FILE, json.dumps(views, sort_keys=True, indent=1).encode(), "process")
    return saved_views(root)


def _read(root: Path) -> dict[str, str]:
    path = root / _FILE
    try:
        if path.stat().st_size > _MOST_BYTES:
            return {}
        found = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return {}
    entries = found.items() if isinstance(found, dict) else ()
    return {name: query for name, query in entries if isinstance(query, str)}
