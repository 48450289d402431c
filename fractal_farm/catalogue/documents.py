"""Small JSON documents that carry their own checksum, such as run.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.layout import crc32c
from fractal_farm.errors import FarmError

_SEAL = "crc32c"


def encoded_document(content: Mapping[str, Any]) -> bytes:
    """The bytes of a sealed document; equal content gives equal bytes."""
    return json.dumps({**content, _SEAL: _seal(content)}, indent=2, sort_keys=True).encode() + b"\n"


def read_document(path: Path) -> dict[str, Any]:
    """Read a sealed document, without its seal.

    Raises:
        FarmError: missing, not JSON, or its checksum does not match.
    """
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise FarmError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise FarmError(f"{path}: damaged, not JSON; restore it from a copy") from error
    if not isinstance(content, dict) or content.pop(_SEAL, None) != _seal(content):
        raise FarmError(f"{path}: damaged, its checksum does not match; restore it from a copy")
    return content


def _seal(content: Mapping[str, Any]) -> str:
    return f"{crc32c(json.dumps(content, sort_keys=True).encode()):08x}"
