"""What needs more than the core of Ray: metrics and jobs, which the extra `cluster` brings. Nothing imports Ray."""

from __future__ import annotations

import importlib.util
import socket

from fractal_farm.errors import InputError

_NEEDED = ("aiohttp", "opencensus", "prometheus_client")


def check_extra(what: str) -> None:
    """Refuse what the installed Ray cannot do; Ray itself would be silent about metrics, and obscure about jobs.

    Raises:
        InputError: the libraries are missing.
    """
    if any(importlib.util.find_spec(name) is None for name in _NEEDED):
        raise InputError(f"{what}: needs more of Ray than is installed; pip install 'fractal-farm[cluster]'")


def check_metrics(port: int, embedded: bool) -> None:
    """Refuse before Ray starts: it would say nothing of a port that is in use.

    Raises:
        InputError: the libraries are missing, or the port is not free.
    """
    check_extra(f"execution.metrics {port}")
    if not embedded:
        return
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError(f"execution.metrics {port}: {error.strerror}; choose another port") from None
