"""Runs that a Ray cluster keeps by itself, as Ray jobs: submitted, watched and stopped from anywhere (DESIGN, 9).

The driver runs on the cluster's head, so the catalogue's directory is one that the head sees. The configuration
travels with the job; nothing else does. A job that was stopped, or died, is resumed like any other run.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import re
import secrets
import shlex
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import urlsplit

from fractal_farm.config import RunConfig
from fractal_farm.errors import FarmError, InputError
from fractal_farm.farm.on_ray.extras import check_extra

# How long a job that is asked to stop may take to commit what is complete, before Ray kills it.
STOP_SECONDS = 120
_CONFIG = "run.json"
_HOST = re.compile(r"[\w.:-]+")
_ENDED = ("SUCCEEDED", "FAILED", "STOPPED")
_MISSING = (
    "command -v farm >/dev/null || { echo 'farm: not on the PATH of the Ray head; install fractal-farm where Ray runs "
    "and start Ray with it on the PATH' >&2; exit 127; }; exec "
)


@dataclass(frozen=True)
class Job:
    """A run that a cluster keeps.

    Attributes:
        job: its id.
        status: PENDING, RUNNING, STOPPED, SUCCEEDED or FAILED.
        exit_code: of the `farm` command on the head; None while it runs.
        message: what Ray says of it.
        name: name of the run.
        catalogue: directory on the head.
        started: seconds since 1970, or None.
        ended: seconds since 1970, or None.
    """

    job: str
    status: str
    exit_code: int | None
    message: str
    name: str
    catalogue: str
    started: float | None
    ended: float | None


def detach(config: RunConfig, out: str, address: str | None, into: bool = False) -> str:
    """Hand a new run to a cluster and return at once.

    Args:
        config: what to run; it works on that cluster whatever `execution` says.
        out: absolute directory of the catalogue on the head.
        address: of the cluster's dashboard, "http://host:8265"; None for RAY_API_SERVER_ADDRESS, or this machine.
        into: add the run to the catalogue that is there.

    Returns:
        The id of the job.

    Raises:
        InputError: nothing answers at the address, the directory is relative, or the extra is missing.
        FarmError: the cluster refused the job.
    """
    if config.execution.workers is not None:
        raise InputError(
            f"execution.workers {config.execution.workers}: the cluster decides how many work; leave it null"
        )
    tree = config.to_dict()
    tree["execution"] |= {"executor": "ray", "address": "auto"}
    with tempfile.TemporaryDirectory() as directory:
        (Path(directory) / _CONFIG).write_text(json.dumps(tree))
        words = ["farm", "submit", _CONFIG, "--out", _absolute(out), *(["--into"] if into else [])]
        return _start(words, config.name, out, address, {"working_dir": directory})


def detach_resume(path: str, run: str | None, overrides: Sequence[str], address: str | None) -> str:
    """Hand an interrupted run, by the first digits of its id or the latest begun, to a cluster; see `detach`."""
    words = ["farm", "resume", _absolute(path), "--address", "auto", *(["--run", run] if run else [])]
    for override in overrides:
        words += ["--set", override]
    return _start(words, PurePosixPath(path).name, path, address, {})


def jobs(address: str | None) -> list[Job]:
    """The farm's jobs that a cluster remembers, the latest first; see `detach` for what is raised."""
    with _client(address) as client:
        found = [_job(entry) for entry in client.list_jobs() if (entry.metadata or {}).get("farm")]
    return sorted(found, key=lambda job: -(job.started or 0.0))


def job(identity: str, address: str | None) -> Job:
    """One job; see `detach` for what is raised."""
    with _client(address, identity) as client:
        return _job(client.get_job_info(identity))


def logs(identity: str, address: str | None, follow: bool) -> Iterator[str]:
    """What a job has printed, and with `follow` what it prints until its end; see `detach` for what is raised."""
    shown = 0
    while True:
        with _client(address, identity) as client:
            over = not follow or str(client.get_job_status(identity)) in _ENDED
            text = client.get_job_logs(identity)
        yield text[shown:]
        shown = len(text)
        if over:
            return
        time.sleep(1.0)


def stop(identity: str, address: str | None) -> Job:
    """End a job at the last epoch that all islands have completed; see `detach` for what is raised.

    Returns:
        The job after its end.

    Raises:
        FarmError: it has not ended after `STOP_SECONDS` and some more.
    """
    with _client(address, identity) as client:
        client.stop_job(identity)
        deadline = time.monotonic() + STOP_SECONDS + 30
        while time.monotonic() < deadline:
            found = _job(client.get_job_info(identity))
            if found.status in _ENDED:
                return found
            time.sleep(0.5)
    raise FarmError(f"{identity}: has not ended yet; look again with `farm jobs status {identity}`")


def _start(words: list[str], name: str, out: str, address: str | None, environment: dict[str, Any]) -> str:
    identity = f"farm-{name}-{secrets.token_hex(3)}"
    with _client(address) as client:
        client.submit_job(
            entrypoint=_MISSING + shlex.join(words),
            submission_id=identity,
            metadata={"farm": "1", "name": name, "catalogue": out},
            runtime_env={**environment, "env_vars": {"RAY_JOB_STOP_WAIT_TIME_S": str(STOP_SECONDS)}},
        )
    return identity


@contextlib.contextmanager
def _client(address: str | None, identity: str | None = None) -> Iterator[Any]:
    """Ray's client for jobs, its errors in one line."""
    check_extra("Ray jobs")
    if address is not None and address != "auto" and not _is_dashboard(address):
        raise InputError(f"--address {address}: for jobs give the cluster's dashboard, http://HOST:8265")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    from ray.exceptions import AuthenticationError
    from ray.job_submission import JobSubmissionClient

    logging.getLogger("ray").setLevel(logging.WARNING)
    place = f"--address {address}" if address else os.environ.get("RAY_API_SERVER_ADDRESS", "this machine")
    try:
        yield JobSubmissionClient(address)
    except ConnectionError:
        raise InputError(f"{place}: no Ray dashboard answers; give http://HOST:8265 of a running cluster") from None
    except AuthenticationError:
        raise InputError(
            f"{place}: the cluster wants its token; set RAY_AUTH_MODE=token, and RAY_AUTH_TOKEN or ~/.ray/auth_token"
        ) from None
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        if identity is not None and ("404" in reason or "does not exist" in reason):
            raise InputError(f"{place}: no job {identity}; `farm jobs list` shows them") from None
        raise FarmError(f"{place}: the cluster refused: {reason[:300]}") from None


def _is_dashboard(address: str) -> bool:
    try:
        place = urlsplit(address)
        return place.scheme in ("http", "https") and bool(_HOST.fullmatch(place.hostname or "")) and place.port != 0
    except ValueError:  # its port is none
        return False


def _absolute(out: str) -> str:
    if not PurePosixPath(out).is_absolute():
        raise InputError(f"--out {out}: the run works on the cluster's head; give an absolute directory there")
    return out


def _job(entry: Any) -> Job:
    metadata = entry.metadata or {}
    return Job(
        entry.submission_id,
        str(getattr(entry.status, "value", entry.status)),
        entry.driver_exit_code,
        entry.message or "",
        metadata.get("name", ""),
        metadata.get("catalogue", ""),
        entry.start_time / 1000 if entry.start_time else None,
        entry.end_time / 1000 if entry.end_time else None,
    )
