"""Starting an embedded Ray, or joining a running cluster, silently and on loopback alone."""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fractal_farm.errors import FarmError, InputError

# Read by Ray when it is first imported. Token authentication would write into HOME; the embedded cluster listens on
# loopback only and ends with this process.
_QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_DEDUP_LOGS": "0",
    "RAY_COLOR_PREFIX": "0",
    "RAY_SCHEDULER_EVENTS": "0",
    # Ray's record of every task would grow all night.
    "RAY_task_events_report_interval_ms": "0",
    "RAY_ROTATION_MAX_BYTES": str(16 * 2**20),
    "RAY_ROTATION_BACKUP_COUNT": "1",
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    "OMP_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}
_OBJECT_STORE_BYTES = 256 * 2**20


@contextlib.contextmanager
def session(address: str | None, workers: int | None) -> Iterator[int]:
    """Connect to Ray for the length of a run.

    Args:
        address: "host:port" or "auto" for a running cluster; None starts one inside this process, on loopback.
        workers: processors of the embedded cluster; None for all of this machine.

    Yields:
        The number of processors of the cluster.

    Raises:
        InputError: nothing answers at the address.
    """
    for name, value in _QUIET.items():
        os.environ.setdefault(name, value)
    if address is None:
        os.environ.setdefault("RAY_AUTH_MODE", "disabled")
        # Without a cluster Ray binds to loopback; with one its servers listen on all addresses.
        os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
        os.environ.setdefault("RAY_TMPDIR", _short_temporary_directory())
    elif address != "auto":
        _check_reachable(address)
    import ray

    if ray.is_initialized():
        yield _processors(ray)
        return
    options: dict[str, Any] = {
        "log_to_driver": False,
        "logging_level": logging.ERROR,
        "namespace": "fractal_farm",
    }
    try:
        if address is None:
            ray.init(
                address="local",
                num_cpus=workers or os.cpu_count(),
                include_dashboard=False,
                object_store_memory=_OBJECT_STORE_BYTES,
                _node_ip_address="127.0.0.1",
                **options,
            )
        else:
            ray.init(address=address, **options)
    except (OSError, RuntimeError, ValueError) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        if address is None:
            raise FarmError(f"Ray does not start on this machine ({reason}); see `farm doctor --ray`") from None
        raise InputError(
            f"--address {address}: no Ray cluster answers ({reason}); start one with `ray start --head`, or leave "
            "--address out"
        ) from None
    try:
        yield _processors(ray)
    finally:
        with _stdout_to_stderr():
            ray.shutdown()


def _processors(ray: Any) -> int:
    return max(1, int(ray.cluster_resources().get("CPU", 1)))


def _check_reachable(address: str) -> None:
    """A plain TCP connection, since Ray itself would try for minutes."""
    if "://" in address:
        raise InputError(f"--address {address}: a Ray client is not offered; run farm on a node, with host:port")
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit():
        raise InputError(f"--address {address}: give host:port of a running cluster, or auto")
    try:
        socket.create_connection((host, int(port)), timeout=5.0).close()
    except OSError as error:
        raise InputError(
            f"--address {address}: nothing answers there ({error.strerror or error}); start a cluster with "
            "`ray start --head`, or leave --address out"
        ) from None


def _short_temporary_directory() -> str:
    """Ray's sockets need a path of fewer than 107 characters."""
    directory = tempfile.gettempdir()
    return directory if len(directory) < 40 and Path(directory).is_dir() else "/tmp"


@contextlib.contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    with contextlib.redirect_stdout(sys.stderr):
        yield
