"""Forms of answers that handlers share, and numbers of queries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response

from fractal_farm.studio.guard import Refused
from fractal_farm.studio.static_files import media_type

NO_STORE = {"cache-control": "no-store"}
FOR_EVER = {"cache-control": "private, max-age=31536000, immutable"}
# A certificate's page brings its style and its pictures along, and nothing else.
_PAGE_POLICY = {
    "content-security-policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'; "
    "sandbox"
}


def json_answer(value: Any) -> Response:
    """A value as JSON, as it is now."""
    return JSONResponse(value, headers=NO_STORE)


def file_answer(path: Path, name: str) -> Response:
    """A file to look at (pictures, the certificate) or to take home."""
    headers = {**FOR_EVER, **(_PAGE_POLICY if path.suffix == ".html" else {})}
    shown = path.suffix in (".png", ".html", ".json", ".glb")
    return FileResponse(
        path,
        headers=headers,
        media_type=media_type(path.name),
        filename=name,
        content_disposition_type="inline" if shown else "attachment",
    )


def whole_number(request: Request, name: str, otherwise: int, most: int) -> int:
    """A whole number of the query, 1 to `most`; raises Refused (400) for anything else."""
    text = request.query_params.get(name, str(otherwise))
    if not (text.isascii() and text.isdigit() and len(text) < 12 and 1 <= int(text) <= most):
        raise Refused(400, f"{name} is {text[:20]!r}; give 1 to {most}")
    return int(text)
