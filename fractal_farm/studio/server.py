"""The studio's socket: 127.0.0.1 alone, a token of its own, and no patience with clients that never finish asking."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import resource
import secrets
import signal
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from fractal_farm.errors import InputError
from fractal_farm.studio.application import Studio, studio_app
from fractal_farm.studio.gallery import Gallery

ADDRESS = "127.0.0.1"
_TOKEN_BYTES = 24
_HEAD_SECONDS = 10.0
_MOST_CONNECTIONS = 256
_OPEN_FILES = 4096


def serve(
    root: Path, port: int = 0, *, workers: int | None = None, ready: Callable[[str], None] = lambda _url: None
) -> int:
    """Serve a catalogue until a signal ends it.

    Args:
        root: directory of the catalogue.
        port: to listen on; 0 picks a free one.
        workers: processes that make solids; by the number of processors if None.
        ready: called with the address, token included, once requests are answered.

    Returns:
        Number of runs that were begun here and go on.

    Raises:
        InputError: not a catalogue, one without designs, or the port is in use.
        FarmError: a part is damaged.
    """
    _allow_open_files()
    listening = bound(port)
    with contextlib.closing(listening):
        token = secrets.token_urlsafe(_TOKEN_BYTES)
        return asyncio.run(_serve(listening, Gallery(root), token, workers, ready))


def bound(port: int) -> socket.socket:
    """A socket on this port of 127.0.0.1; nothing is accepted yet.

    Raises:
        InputError: the port is in use, or is not ours to take.
    """
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)  # asyncio sends at once then
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((ADDRESS, port))
    except OSError as error:
        listening.close()
        why = (
            "is in use by another program" if error.errno == errno.EADDRINUSE else f"cannot be used ({error.strerror})"
        )
        raise InputError(f"port {port}: {why}; choose another with --port, or 0 for a free one") from None
    return listening


async def _serve(
    listening: socket.socket, gallery: Gallery, token: str, workers: int | None, ready: Callable[[str], None]
) -> int:
    port = listening.getsockname()[1]
    studio = Studio(gallery, workers)
    config = uvicorn.Config(
        studio_app(studio, token, port),
        http=_PatientProtocol,
        ws="none",
        lifespan="on",
        loop="asyncio",
        log_config=None,
        log_level="critical",
        access_log=False,
        server_header=False,
        date_header=False,
        proxy_headers=False,
        limit_concurrency=_MOST_CONNECTIONS,
        timeout_keep_alive=30,
        timeout_graceful_shutdown=2,
    )
    server = _Server(config)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, server.end)
    task = asyncio.create_task(server.serve([listening]))
    while not server.started and not task.done():
        await asyncio.sleep(0.01)
    if server.started:
        ready(f"http://{ADDRESS}:{port}/?token={token}")
    await task
    return studio.jobs.breeding


class _Server(uvicorn.Server):
    """Signals are ours: the first ends the studio, the second does not wait for open requests."""

    def end(self) -> None:
        """What a signal does."""
        self.force_exit = self.should_exit
        self.should_exit = True

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals as they are."""
        yield


class _PatientProtocol(H11Protocol):
    """HTTP of one connection, which ends if the head of a request does not come within some seconds."""

    def connection_made(self, transport: Any) -> None:
        """Begin to wait for a request."""
        super().connection_made(transport)
        self._waiting = self.loop.call_later(_HEAD_SECONDS, self._give_up)

    def data_received(self, data: bytes) -> None:
        """Take what came; wait on while it is no whole head."""
        import h11

        super().data_received(data)
        if self.conn.their_state is not h11.IDLE:
            self._waiting.cancel()
        elif self._waiting.cancelled():
            self._waiting = self.loop.call_later(_HEAD_SECONDS, self._give_up)

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        self._waiting.cancel()
        super().connection_lost(exc)

    def _give_up(self) -> None:
        if not self.transport.is_closing():
            self.transport.abort()


def _allow_open_files() -> None:
    """As many open connections as are answered at all, beside what else is open."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(_OPEN_FILES, hard)
    if soft < wanted:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
