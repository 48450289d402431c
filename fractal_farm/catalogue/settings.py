"""The configuration that a run works with now: run.json as it began, and what later sessions changed.

run.json is written once. A session that works with another configuration adds a record of its own, so that the next
session finds it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.documents import encoded_document, read_document
from fractal_farm.catalogue.durable import Durability, put
from fractal_farm.catalogue.layout import crc32c, run_directory
from fractal_farm.catalogue.runs import read_run

_SETTINGS = re.compile(r"settings~(\d{4})~([0-9a-f]{8})\.json")


def read_settings(root: Path, run_id: str) -> dict[str, Any]:
    """The configuration of the latest session, as it was given to `record_settings`; that of run.json at first.

    Raises:
        InputError: no such run.
        FarmError: the record is damaged.
    """
    records = _records(root, run_id)
    config: dict[str, Any] = read_document(records[-1])["config"] if records else read_run(root, run_id)["config"]
    return config


def record_settings(root: Path, run_id: str, config: Mapping[str, Any], durability: Durability = "full") -> None:
    """Remember what a session works with, if that is new; the caller holds the run's lock.

    Raises:
        FarmError: the file system failed.
    """
    if config == read_settings(root, run_id):
        return
    content = encoded_document({"config": config})
    number = len(_records(root, run_id))
    put(run_directory(root, run_id) / f"settings~{number:04d}~{crc32c(content):08x}.json", content, durability)


def _records(root: Path, run_id: str) -> list[Path]:
    return sorted(
        path for path in run_directory(root, run_id).glob("settings~*.json") if _SETTINGS.fullmatch(path.name)
    )
