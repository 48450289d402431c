"""Whether the servers of a cluster still live.

Ray itself waits a minute for a dead head, and then ends the process that waits, without a word; and a driver whose
raylet has died sees its actors die one by one. Asking the servers themselves tells at once.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Mapping

from fractal_farm.farm.on_ray.last_word import end_at_once

_EVERY_SECONDS = 1.0
_ANSWER_SECONDS = 5.0
_SILENCE_SECONDS = 30.0
_GRACE_SECONDS = 20.0
# How an HTTP/2 client begins (RFC 9113, 3.4): Ray's servers speak gRPC, and answer with their own settings.
_HELLO = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])


class Pulse:
    """Asks servers every second, from a thread of its own.

    Who owns it must stop it soon after a loss; a process that does not is caught inside Ray, and is ended.
    """

    def __init__(self, servers: Mapping[str, tuple[str, int]], patience_s: float) -> None:
        """Begin.

        Args:
            servers: name -> (host, port) of gRPC servers.
            patience_s: how long a server may refuse connections; one that takes them without an answer is given at
                least half a minute.
        """
        self._servers = dict(servers)
        self._patience = patience_s
        self._since: dict[str, float] = {}
        self._lost: str | None = None
        self._over = threading.Event()
        self._asking = threading.Lock()
        threading.Thread(target=self._watch, name="pulse", daemon=True).start()

    @property
    def lost(self) -> str | None:
        """Which server is gone; None while all live. What was lost once stays lost."""
        return self._lost

    def beat(self) -> None:
        """Ask all servers once, now."""
        with self._asking:
            for name, address in self._servers.items():
                self._ask(name, address)

    def stop(self) -> None:
        """No more questions."""
        self._over.set()

    def _watch(self) -> None:
        while not self._over.wait(_EVERY_SECONDS):
            if self._lost is None:
                self.beat()
            elif not self._over.wait(_GRACE_SECONDS):
                end_at_once(f"Ray is lost: {self._lost}; go on from the last commit with `farm resume`")

    def _ask(self, name: str, address: tuple[str, int]) -> None:
        failure = _failure(address)
        if failure is None:
            self._since.pop(name, None)
            return
        refused = isinstance(failure, ConnectionRefusedError)
        now = time.monotonic()
        away = now - self._since.setdefault(name, now)
        if away >= (self._patience if refused else max(self._patience, _SILENCE_SECONDS)):
            self._lost = f"its {name} at {address[0]}:{address[1]} " + ("has died" if refused else "does not answer")


def _failure(address: tuple[str, int]) -> OSError | None:
    """Why a server does not live, or None: any byte from it, and a connection that it closes, are signs of life."""
    try:
        with socket.create_connection(address, timeout=_ANSWER_SECONDS) as connection:
            connection.sendall(_HELLO)
            connection.recv(1)
    except (ConnectionResetError, BrokenPipeError):
        return None
    except OSError as error:
        return error
    return None
