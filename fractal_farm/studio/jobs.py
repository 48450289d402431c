"""Work that takes longer than a request: solids, and runs that breed. A page asks for a job and looks at it again.

A solid is known by its content: genome, parameters, material and version of the program give the name of its job, and
of a directory of a cache that outlives the studio; who asks for the same gets the same files. A run that breeds is a
process of its own, `farm breed`, with a log in the catalogue; it goes on when the studio ends.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import secrets
import signal
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from fractal_farm import __version__
from fractal_farm.catalogue import last_epoch
from fractal_farm.errors import FarmError
from fractal_farm.solid.parameters import SolidParameters
from fractal_farm.studio.guard import Refused
from fractal_farm.studio.kept_files import KeptFiles
from fractal_farm.studio.workers import Lane

_FARM = (sys.executable, "-P", "-c", "import sys; from fractal_farm.cli import main; sys.exit(main())")
_SOLID_SECONDS = 600.0
_MOST_JOBS = 256
_MOST_SOLIDS, _MOST_BREEDINGS = 16, 2
_LOOK_SECONDS = 0.5
_TAIL_BYTES = 4096

State = Literal["queued", "running", "done", "failed", "cancelled"]


@dataclass
class Job:
    """Some work and how far it is; see `as_json`."""

    key: str
    kind: Literal["solid", "breed"]
    state: State = "queued"
    stage: str = ""
    share: float = 0.0
    message: str = ""
    facts: dict[str, Any] = field(default_factory=dict)
    files: tuple[str, ...] = ()
    task: asyncio.Task[None] | None = None
    process: asyncio.subprocess.Process | None = None

    @property
    def over(self) -> bool:
        """Whether nothing happens any more."""
        return self.state in ("done", "failed", "cancelled")

    def as_json(self) -> dict[str, Any]:
        """What a page is told."""
        told = {name: getattr(self, name) for name in ("kind", "state", "stage", "share", "message")}
        return {"job": self.key, **told, "certificate": None, **self.facts, "files": list(self.files)}


class Jobs:
    """All jobs of a studio.

    Args:
        root: directory of the catalogue.
        lane: workers that make solids.
        kept: where finished solids lie.
    """

    def __init__(self, root: Path, lane: Lane, kept: KeptFiles) -> None:
        self._root, self._lane, self._kept = root, lane, kept
        self._jobs: dict[str, Job] = {}

    def job(self, key: str) -> Job:
        """A job by its name; a finished solid of an earlier studio, too. Raises Refused (404) if there is none."""
        if key not in self._jobs and not self._finished_earlier(key):
            raise Refused(404, "no such job")
        return self._jobs[key]

    def file(self, key: str, name: str) -> Path:
        """A file of a finished job; raises Refused (404) if there is none of this name."""
        job = self.job(key)
        if name not in job.files or (path := self._kept.path(key) / name).is_symlink() or not path.is_file():
            raise Refused(404, "no such file of this job")
        return path

    def solid(self, genome: Mapping[str, Any], design_id: str, parameters: SolidParameters, material: str) -> Job:
        """Begin to make a solid, or look at the one that is made or being made."""
        words = json.dumps([design_id, parameters.hash, material, __version__])
        key = hashlib.blake2b(words.encode(), digest_size=16, person=b"farm-job-1").hexdigest()
        known = self._jobs.get(key)
        if (known is not None and known.state not in ("failed", "cancelled")) or self._finished_earlier(key):
            return self._jobs[key]
        self._admit("solid", _MOST_SOLIDS)
        job = self._jobs[key] = Job(key, "solid")
        arguments = {"genome": genome, "parameters": parameters.asked_for, "material": material}
        job.task = asyncio.create_task(self._make(job, {**arguments, "directory": str(self._kept.path(key))}))
        return job

    async def breed(self, words: Sequence[str], facts: Mapping[str, Any], epochs: int | None) -> Job:
        """Start `farm breed` with these words after the catalogue's directory."""
        self._admit("breed", _MOST_BREEDINGS)
        job = Job(secrets.token_hex(16), "breed", "running", "breeding", facts=dict(facts))
        self._jobs[job.key] = job
        log = self._root / "logs" / f"breed-{job.key[:8]}.log"
        log.parent.mkdir(exist_ok=True)
        job.facts["log"] = f"logs/{log.name}"
        with log.open("wb") as output:
            job.process = await asyncio.create_subprocess_exec(
                *_FARM,
                "breed",
                str(self._root.resolve()),
                *words,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=output,
                stderr=asyncio.subprocess.STDOUT,
                start_new_session=True,
            )
        job.task = asyncio.create_task(self._watch(job, log, epochs))
        return job

    async def cancel(self, key: str) -> Job:
        """End a job: at once, or a run at its last complete epoch."""
        job = self.job(key)
        if job.over:
            return job
        if job.process is not None:
            with contextlib.suppress(ProcessLookupError):
                job.process.send_signal(signal.SIGINT)
            job.message = "ends at its last complete epoch"
        elif job.task is not None:
            job.task.cancel()
            await asyncio.gather(job.task, return_exceptions=True)
        return job

    async def stop(self) -> None:
        """Leave all jobs; runs go on by themselves."""
        tasks = [job.task for job in self._jobs.values() if job.task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    @property
    def breeding(self) -> int:
        """Number of runs that are at work."""
        return sum(job.kind == "breed" and not job.over for job in self._jobs.values())

    def _admit(self, kind: str, most: int) -> None:
        if sum(job.kind == kind and not job.over for job in self._jobs.values()) >= most:
            raise Refused(503, f"{most} jobs of this kind are waiting already; try again when one is done")
        for key in [key for key, job in self._jobs.items() if job.over][: max(0, len(self._jobs) - _MOST_JOBS + 1)]:
            del self._jobs[key]

    def _finished_earlier(self, key: str) -> bool:
        """Whether a solid of this name lies in the cache; then it is a job, too."""
        found = self._kept.files(key)
        if found is None:
            return False
        if key not in self._jobs or self._jobs[key].over:
            certificate = json.loads((self._kept.path(key) / "certificate.json").read_bytes())
            told = {"certificate": certificate}
            self._jobs[key] = Job(key, "solid", "done", "done", 1.0, "", told, found)
        return True

    async def _make(self, job: Job, arguments: Mapping[str, Any]) -> None:
        def told(stage: str, share: float) -> None:
            job.stage, job.share = stage, share

        def begun() -> None:
            job.state = "running"

        try:
            result, _ = await self._lane.run("solid", arguments, _SOLID_SECONDS, told, begun)
            job.facts["certificate"] = result["certificate"]
            job.files = tuple(result["files"])
            job.state, job.stage, job.share = "done", "done", 1.0
            await asyncio.to_thread(self._kept.prune)
        except asyncio.CancelledError:
            job.state, job.message = "cancelled", "cancelled"
        except (FarmError, Refused) as error:
            job.state, job.message = "failed", error.line if isinstance(error, Refused) else str(error)

    async def _watch(self, job: Job, log: Path, epochs: int | None) -> None:
        assert job.process is not None
        while job.process.returncode is None:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(job.process.wait(), _LOOK_SECONDS)
            if epochs and job.process.returncode is None:
                with contextlib.suppress(FarmError, OSError):
                    job.share = min(1.0, (last_epoch(self._root, job.facts["run_id"]) + 1) / epochs)
        job.message = _last_line(log)
        job.state = "done" if job.process.returncode == 0 else "failed"
        job.stage, job.share = job.state, 1.0 if job.state == "done" else job.share


def _last_line(log: Path) -> str:
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - _TAIL_BYTES))
        lines = file.read().decode("utf-8", "replace").split("\n")
    said = [" ".join(line.split()) for line in lines if line.strip()]
    return said[-1] if said else ""
