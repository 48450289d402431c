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
from fractal_farm.farm.on_ray.extras import check_metrics
from fractal_farm.farm.on_ray.last_word import watched_start
from fractal_farm.farm.on_ray.pulse import Pulse

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
# How long the servers of a cluster that somebody else keeps may be away: its keeper may start them again.
_PATIENCE_SECONDS = 20.0
_STARTS = 3


@contextlib.contextmanager
def session(address: str | None, workers: int | None, metrics: int | None = None) -> Iterator[Cluster]:
    """Connect to Ray for the length of a run.

    Args:
        address: "host:port" or "auto" for a running cluster; None starts one inside this process, on loopback.
        workers: processors of the embedded cluster; None for all of this machine.
        metrics: port on loopback at which the embedded cluster answers Prometheus; None for no metrics.

    Yields:
        The cluster.

    Raises:
        InputError: nothing answers at the address.
        FarmError: Ray does not start on this machine.
    """
    cluster = Cluster(address, workers, metrics)
    cluster.connect()
    try:
        yield cluster
    finally:
        cluster.disconnect()


class Cluster:
    """The cluster that this process is connected to.

    Attributes:
        processors: that it has, counted when the process connected.
        embedded: it was started by this process and lives on this machine alone.
    """

    def __init__(self, address: str | None, workers: int | None, metrics: int | None) -> None:
        self._address = address
        self._workers = workers
        self._metrics = metrics
        self._ours = False
        self._pulse: Pulse | None = None
        self.processors = 0
        self.embedded = address is None

    def connect(self) -> None:
        """Start Ray, or join the cluster; see `session` for what is raised."""
        if self._metrics is not None:
            check_metrics(self._metrics, self.embedded)
        for name, value in _QUIET.items():
            os.environ.setdefault(name, value)
        if self._address is None:
            os.environ.setdefault("RAY_AUTH_MODE", "disabled")
            # Without a cluster Ray binds to loopback; with one its servers listen on all addresses.
            os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
            os.environ.setdefault("RAY_TMPDIR", _short_temporary_directory())
        elif self._address != "auto":
            _check_reachable(self._address)
        import ray

        for tries_left in reversed(range(_STARTS if self.embedded else 1)):
            try:
                if not ray.is_initialized():
                    _start(self._address, self._workers, self._metrics)
                    self._ours = True
                self.processors = max(1, int(ray.cluster_resources().get("CPU", 1)))
                self._pulse = Pulse(_servers(), 0.0 if self.embedded else _PATIENCE_SECONDS)
            except Exception:  # whatever Ray raises when one of its processes is killed while it starts
                self.disconnect()
                if not tries_left:
                    raise
            else:
                return

    def disconnect(self) -> None:
        """Leave the cluster; an embedded one ends. One that was there before this process asked for it stays."""
        if self._pulse is not None:
            self._pulse.stop()
            self._pulse = None
        if self._ours:
            import ray

            with contextlib.redirect_stdout(sys.stderr):
                ray.shutdown()
            self._ours = False

    def restart(self) -> bool:
        """Start an embedded cluster anew after it was lost; False if it is not ours to start."""
        if not (self.embedded and self._ours):
            return False
        self.disconnect()
        self.connect()
        return True

    def lost(self) -> str | None:
        """Why the cluster cannot work any more; None while it can."""
        return self._pulse.lost if self._pulse is not None else "it is not connected"

    def lost_now(self) -> str | None:
        """As `lost`, but after asking the servers at this moment; for when a call has failed."""
        if self._pulse is not None:
            self._pulse.beat()
        return self.lost()

    def name(self) -> str:
        """For messages."""
        return "Ray on this machine" if self.embedded else f"the Ray cluster at {self._address}"


def _start(address: str | None, workers: int | None, metrics: int | None) -> None:
    import ray

    options: dict[str, Any] = {
        "log_to_driver": False,
        "logging_level": logging.ERROR,
        "namespace": "fractal_farm",
    }
    try:
        if address is None:
            with watched_start():
                ray.init(
                    address="local",
                    num_cpus=workers or os.cpu_count(),
                    include_dashboard=False,
                    object_store_memory=_OBJECT_STORE_BYTES,
                    _node_ip_address="127.0.0.1",
                    _metrics_export_port=metrics,
                    **options,
                )
        else:
            ray.init(address=address, **options)
    except SystemExit:  # Ray's own handler of SIGTERM
        raise KeyboardInterrupt from None
    except Exception as error:
        # Ray raises all kinds when one of its processes dies while it starts.
        reason = (str(error) or type(error).__name__).splitlines()[0]
        with contextlib.suppress(Exception), contextlib.redirect_stdout(sys.stderr):
            ray.shutdown()
        if address is None:
            raise FarmError(f"Ray does not start on this machine ({reason}); see `farm doctor --ray`") from None
        raise InputError(
            f"--address {address}: no Ray cluster answers ({reason}); start one with `ray start --head`, or leave "
            "--address out"
        ) from None


def _servers() -> dict[str, tuple[str, int]]:
    """The two processes without which a driver cannot work: the cluster's head, and Ray's own on this node."""
    import ray

    context = ray.get_runtime_context()
    host, _, port = context.gcs_address.rpartition(":")
    own = [entry for entry in ray.nodes() if entry["NodeID"] == context.get_node_id()]
    if not own:
        raise FarmError("Ray does not know this machine; see `farm doctor --ray`")
    node = own[0]
    return {"head": (host, int(port)), "raylet": (node["NodeManagerAddress"], node["NodeManagerPort"])}


def _check_reachable(address: str) -> None:
    """A plain TCP connection, since Ray itself would try for minutes."""
    if "://" in address:
        raise InputError(f"--address {address}: a Ray client is not offered; run farm on a node, with host:port")
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit():
        raise InputError(f"--address {address}: give host:port of a running cluster, or auto")
    try:
        socket.create_connection((host, int(port)), timeout=5.0).close()
    except (OSError, OverflowError, ValueError) as error:  # also of ports and names that cannot be
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"--address {address}: nothing answers there ({reason}); start a cluster with "
            "`ray start --head`, or leave --address out"
        ) from None


def _short_temporary_directory() -> str:
    """Ray's sockets need a path of fewer than 107 characters."""
    directory = tempfile.gettempdir()
    return directory if len(directory) < 40 and Path(directory).is_dir() else "/tmp"
