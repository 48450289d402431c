"""A real studio in a process of its own, and a client of it."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from fractal_farm.ifs.kernel import cache_root

FARM = [sys.executable, "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())"]
_URL = re.compile(r"(http://127\.0\.0\.1:(\d+)/)\?token=(\S+)")
_SECONDS = 60.0


@dataclass(frozen=True)
class RunningStudio:
    """A studio that answers.

    Attributes:
        directory: of the catalogue.
        url: of the pages, with a slash at the end and without the token.
        port: of 127.0.0.1.
        token: what writing needs.
        process: `farm studio`.
    """

    directory: Path
    url: str
    port: int
    token: str
    process: subprocess.Popen[str]

    @property
    def address(self) -> str:
        """What a person opens: url and token."""
        return f"{self.url}?token={self.token}"

    def get(self, path: str, **more: Any) -> httpx.Response:
        return httpx.get(self.url + path, timeout=_SECONDS, **more)

    def post(self, path: str, body: Any = None, **more: Any) -> httpx.Response:
        headers = {"X-Farm-Token": self.token, **more.pop("headers", {})}
        given = {} if body is None else {"json": body}
        return httpx.post(self.url + path, headers=headers, timeout=_SECONDS, **given, **more)

    def facts(self) -> dict[str, Any]:
        """data/catalogue.json."""
        return self.get("data/catalogue.json").json()


@contextlib.contextmanager
def running_studio(directory: Path, *options: str) -> Iterator[RunningStudio]:
    """`farm studio` on a catalogue, ended by Ctrl-C."""
    command = [*FARM, "studio", str(directory), "--no-open", *options]
    # Kernels stay where they are compiled already; what the studio keeps for later is this test's own.
    caches = {"NUMBA_CACHE_DIR": str(cache_root()), "XDG_CACHE_HOME": str(directory.parent / "cache")}
    environment = {**os.environ, **caches}
    with (
        tempfile.TemporaryFile("w+") as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment) as process,
    ):
        try:
            line = process.stdout.readline()
            found = _URL.search(line)
            if found is None:
                process.wait(_SECONDS)
                errors.seek(0)
                raise AssertionError(f"no address from farm studio: {line!r} {errors.read()!r}")
            yield RunningStudio(directory, found[1], int(found[2]), found[3], process)
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                raise
