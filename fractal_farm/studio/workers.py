"""Workers of the studio: processes that compute, of which each does one thing at a time and can be stopped any time.

A `Lane` is some workers and a bounded queue before them. Whoever waits for an answer no longer (his time is up, or
somebody cancels) ends the worker's process, and another one begins to warm up in its place.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import Callable, Mapping
from typing import Any

from fractal_farm.errors import FarmError, InputError
from fractal_farm.studio.guard import Refused
from fractal_farm.studio.worker import HEAD

_COMMAND = (sys.executable, "-P", "-m", "fractal_farm.studio.worker")
_WARM_SECONDS = 300.0  # where nothing is compiled yet

Told = Callable[[str, float], None]


class Lane:
    """Some workers and who waits for them.

    Args:
        size: number of workers.
        most_waiting: requests that may wait; further ones are refused.
        priority: added to the niceness of their processes.
    """

    def __init__(self, size: int, most_waiting: int, niceness: int = 0) -> None:
        self._workers = [_Worker(niceness) for _ in range(size)]
        self._idle: asyncio.Queue[_Worker] = asyncio.Queue()
        self._waiting, self._most_waiting = 0, most_waiting

    async def start(self) -> None:
        """Begin to warm up; nobody needs to wait for it."""
        for worker in self._workers:
            worker.warm_up()
            self._idle.put_nowait(worker)

    async def stop(self) -> None:
        """End all processes."""
        for worker in self._workers:
            await worker.end()

    async def run(
        self,
        task: str,
        arguments: Mapping[str, Any],
        seconds: float,
        told: Told = lambda _stage, _share: None,
        begun: Callable[[], None] = lambda: None,
    ) -> tuple[Any, bytes]:
        """Let a worker do a task of `tasks.TASKS`.

        Args:
            task: its name.
            arguments: what JSON holds.
            seconds: how long it may take.
            told: hears of its stages.
            begun: called when a worker is free for it.

        Raises:
            Refused: too many wait already (503), or it took too long (503).
            InputError: what the task raised.
            FarmError: the same, or the worker's process died.
        """
        if self._waiting >= self._most_waiting:
            raise Refused(503, "too much to compute at once; try again in a moment")
        self._waiting += 1
        try:
            worker = await self._idle.get()
        finally:
            self._waiting -= 1
        begun()
        sound = False
        try:
            answer = await asyncio.wait_for(worker.ask(task, arguments, told), seconds)
            sound = True
            return answer
        except FarmError:
            sound = worker.is_alive
            raise
        except TimeoutError:
            raise Refused(503, f"{task} took longer than {seconds:.0f} s and was stopped") from None
        finally:
            if not sound:
                await worker.end()
                worker.warm_up()
            self._idle.put_nowait(worker)


class _Worker:
    """One process and what is said to it."""

    def __init__(self, niceness: int) -> None:
        self._niceness = niceness
        self._process: asyncio.subprocess.Process | None = None
        self._talking = asyncio.Lock()
        self._warming: asyncio.Task[None] | None = None

    @property
    def is_alive(self) -> bool:
        return self._process is not None and self._process.returncode is None

    def warm_up(self) -> None:
        """Start the process, and let it load what it needs, while others go on."""
        self._warming = asyncio.create_task(self._warm_up())

    async def ask(self, task: str, arguments: Mapping[str, Any], told: Told) -> tuple[Any, bytes]:
        async with self._talking:
            if not self.is_alive:
                nice = ("nice", "-n", str(self._niceness)) if self._niceness else ()
                self._process = await asyncio.create_subprocess_exec(
                    *nice,
                    *_COMMAND,
                    stdin=asyncio.subprocess.PIPE,
                    stdout=asyncio.subprocess.PIPE,
                    stderr=asyncio.subprocess.DEVNULL,
                    start_new_session=True,  # Ctrl-C is for the studio
                )
            assert self._process is not None
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            words = json.dumps({"task": task, "arguments": arguments}).encode()
            try:
                self._process.stdin.write(HEAD.pack(len(words), 0) + words)
                await self._process.stdin.drain()
                while True:
                    length, more = HEAD.unpack(await self._process.stdout.readexactly(HEAD.size))
                    answer = json.loads(await self._process.stdout.readexactly(length))
                    content = await self._process.stdout.readexactly(more)
                    if "stage" in answer:
                        told(answer["stage"], answer["share"])
                    elif "failed" in answer:
                        raise (InputError if answer["input"] else FarmError)(answer["failed"])
                    else:
                        return answer["done"], content
            except (asyncio.IncompleteReadError, ConnectionError):
                await self._process.wait()
                raise FarmError(
                    f"{task}: the process that worked on it died; out of memory? Try something smaller"
                ) from None

    async def end(self) -> None:
        """Kill the process, and wait until it is gone."""
        if self._warming is not None:
            self._warming.cancel()
            await asyncio.gather(self._warming, return_exceptions=True)
            self._warming = None
        process, self._process = self._process, None
        if process is not None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()

    async def _warm_up(self) -> None:
        with contextlib.suppress(FarmError, TimeoutError, OSError):
            await asyncio.wait_for(self.ask("warm", {}, lambda _stage, _share: None), _WARM_SECONDS)
