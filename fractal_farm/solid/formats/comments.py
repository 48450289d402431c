"""Facts in the comments of text headers (PLY, OBJ): JSON on several short lines.

Some readers allow lines of 1,024 bytes at most, and a genome of eight maps is longer; none may lose the spaces at
either end of a line, so no line begins or ends with one.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from fractal_farm.solid.formats.parsed import MAX_FACTS_BYTES, MalformedError, parsed_json

MARK = "fractal_farm"
_WIDTH = 200


def comment_lines(facts: Mapping[str, Any]) -> list[str]:
    """Facts, fit for JSON, as lines of ASCII that begin with MARK; each fact begins a line."""
    members = [f"{_encoded(key)}:{_encoded(facts[key])}," for key in sorted(facts)]
    text = ["{", *members, "}"] if members else []
    if members:
        text[-2] = text[-2].removesuffix(",")
    return [f"{MARK} {piece}" for member in text for piece in _wrapped(member)]


def facts_of_comments(lines: list[str]) -> dict[str, Any]:
    """The facts in comments; empty if none is ours.

    Raises:
        MalformedError: ours, but damaged.
    """
    text = "".join(line.removeprefix(MARK).strip() for line in lines if line.startswith(f"{MARK} "))
    if len(text) > MAX_FACTS_BYTES:
        raise MalformedError("its comments are longer than 1 MiB")
    return parsed_json(text, "comment of Fractal Farm") if text else {}


def _encoded(value: Any) -> str:
    """JSON whose spaces, all of them in texts, stand alone."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return text.replace("  ", "\\u0020\\u0020")


def _wrapped(text: str) -> Iterator[str]:
    """Pieces of at most _WIDTH characters without spaces at their ends."""
    start = 0
    while start < len(text):
        end = min(start + _WIDTH, len(text))
        while end < len(text) and end > start + 1 and " " in text[end - 1 : end + 1]:
            end -= 1
        yield text[start:end]
        start = end
