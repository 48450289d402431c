"""The pages' own files. Only names that were found in the directory are opened: no path of a request becomes one."""

from __future__ import annotations

import hashlib
from pathlib import Path

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".webp": "image/webp",
    ".ico": "image/x-icon",
    ".woff2": "font/woff2",
    ".wasm": "application/wasm",
    ".txt": "text/plain; charset=utf-8",
    ".md": "text/plain; charset=utf-8",
}
STATIC = Path(__file__).parent / "static"


def static_files(directory: Path = STATIC) -> dict[str, Path]:
    """Relative name -> path of every file that is shown; neither links nor names that begin with a dot."""
    found = {}
    for path in sorted(directory.rglob("*")):
        relative = path.relative_to(directory)
        hidden = any(part.startswith(".") for part in relative.parts)
        if path.is_file() and not path.is_symlink() and not hidden:
            found[relative.as_posix()] = path
    return found


def media_type(name: str) -> str:
    """What a file is sent as, by its ending."""
    return _TYPES.get(Path(name).suffix.lower(), "application/octet-stream")


def entity_tag(content: bytes) -> str:
    """The same for the same content."""
    return f'"{hashlib.blake2b(content, digest_size=8).hexdigest()}"'
