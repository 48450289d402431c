"""Small JSON documents that carry their own checksum, such as run.json."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fractal_farm.catalogue.layout import crc32c
from fractal_farm.errors import FarmError

_SEAL = "crc32c"
_REMEDY = "`farm verify --repair` may mend it, or restore it from a copy"


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
    except (ValueError, RecursionError) as error:
        raise FarmError(f"{path}: damaged, not JSON; {_REMEDY}") from error
    if not isinstance(content, dict) or content.pop(_SEAL, None) != _seal(content):
        raise FarmError(f"{path}: damaged, its checksum does not match; {_REMEDY}")
    return content


def opened_document(data: bytes) -> dict[str, Any] | None:
    """The content of a sealed document if every bit of it is as it was written, otherwise None.

    Stricter than `read_document`, which does not mind what JSON does not (1e-05 or 1E-05).
    """
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return None
    if not isinstance(content, dict) or content.pop(_SEAL, None) is None:
        return None
    return content if encoded_document(content) == data else None


def _seal(content: Mapping[str, Any]) -> str:
    return f"{crc32c(json.dumps(content, sort_keys=True).encode()):08x}"


SEALED_PAGE = ".html"
_PAGE_SEAL = "\n<!-- crc32c {:08x} -->\n"


def sealed_page(page: str) -> bytes:
    """An HTML page with its checksum in a comment at its end."""
    content = page.encode()
    return content + _PAGE_SEAL.format(crc32c(content)).encode()


def is_sealed_page(content: bytes) -> bool:
    """Whether every bit of a page is as `sealed_page` made it."""
    length = len(content) - len(_PAGE_SEAL.format(0))
    return length >= 0 and content[length:] == _PAGE_SEAL.format(crc32c(content[:length])).encode()
