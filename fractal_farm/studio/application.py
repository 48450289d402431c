"""The studio's routes: its pages, the data that they draw from, and what they may ask for (issue 7, 'API')."""

from __future__ import annotations

import asyncio
import contextlib
import os
import time
from collections.abc import AsyncIterator
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route, Router

from fractal_farm.errors import FarmError
from fractal_farm.studio.api import Api
from fractal_farm.studio.columns import encoded
from fractal_farm.studio.gallery import Gallery
from fractal_farm.studio.guard import Application, Guard, Refused
from fractal_farm.studio.jobs import Jobs
from fractal_farm.studio.kept_files import KeptFiles
from fractal_farm.studio.page_data import catalogue_facts
from fractal_farm.studio.static_files import STATIC, entity_tag, media_type, static_files
from fractal_farm.studio.workers import Lane

_LOOK_SECONDS = 1.0
_PIECE = 1 << 20
_GROUPS_SECONDS = 900.0
_MOST_WAITING = 32
_FOR_EVER = {"cache-control": "private, max-age=31536000, immutable"}
_ASK_AGAIN = {"cache-control": "no-cache"}


class Studio:
    """What all requests share.

    Args:
        gallery: the designs.
        workers: processes that make solids; by the number of processors if None.
    """

    def __init__(self, gallery: Gallery, workers: int | None = None) -> None:
        cores = os.cpu_count() or 1
        self.gallery = gallery
        self._quick = Lane(1 if cores <= 2 else 2, _MOST_WAITING)
        self._slow = Lane(workers or max(1, cores // 2), _MOST_WAITING, niceness=5)
        self.jobs = Jobs(gallery.root, self._slow, KeptFiles())
        self.api = Api(gallery, self._quick, self.jobs)
        self._files = static_files()
        self._told: tuple[float, dict[str, Any]] = (0.0, {})

    @contextlib.asynccontextmanager
    async def at_work(self, _application: object) -> AsyncIterator[None]:
        """Follow the catalogue, and hold workers ready, for as long as requests come."""
        await self._quick.start()
        await self._slow.start()
        await asyncio.to_thread(self.gallery.all_maps)  # who opens the page is not to wait for them
        following = asyncio.create_task(self._follow())
        try:
            yield
        finally:
            following.cancel()
            await self.jobs.stop()
            await asyncio.gather(self._quick.stop(), self._slow.stop())

    async def _follow(self) -> None:
        with contextlib.suppress(FarmError, OSError):
            await asyncio.to_thread(self.api.family.lineage)
        if (parts := self.gallery.ungrouped) is not None:
            found = None
            with contextlib.suppress(FarmError, Refused):
                arguments = {"root": str(self.gallery.root), "parts": parts}
                _, content = await self._slow.run("groups", arguments, _GROUPS_SECONDS)
                found = np.frombuffer(content, "<u4")
            await asyncio.to_thread(self.gallery.finish_groups, found)
        while True:
            await asyncio.sleep(_LOOK_SECONDS)
            with contextlib.suppress(FarmError, OSError):
                await asyncio.to_thread(self.gallery.refresh)

    async def page(self, request: Request) -> Response:
        """A file of the pages."""
        name = request.path_params.get("name") or "index.html"
        if name not in self._files:
            self._files = static_files()
        if name not in self._files:
            raise Refused(404, "no such page")
        content = await asyncio.to_thread((STATIC / self._files[name]).read_bytes)
        headers = {"etag": entity_tag(content), **_ASK_AGAIN}
        if request.headers.get("if-none-match") == headers["etag"]:
            return Response(status_code=304, headers=headers)
        return Response(content, headers=headers, media_type=media_type(name))

    async def catalogue(self, _request: Request) -> Response:
        """data/catalogue.json."""
        now = self.gallery.current
        if time.monotonic() > self._told[0]:  # runs are looked up no more often than the catalogue is
            facts = await asyncio.to_thread(
                catalogue_facts, self.gallery.catalogue, now.version, len(now), now.maps_per_row, server=True
            )
            self._told = (time.monotonic() + _LOOK_SECONDS, facts)
        state = {"version": now.version, "rows": len(now), "maps_per_row": now.maps_per_row}
        facts = {**self._told[1], **state}
        return JSONResponse({**facts, "epoch": now.epoch, "judged": now.judged}, headers={"cache-control": "no-store"})

    async def columns(self, request: Request) -> Response:
        """data/{version}/columns.bin."""
        rows = self._rows(request)
        start = _number(request.query_params.get("from", "0"), rows)
        arrays = self.gallery.current.arrays

        async def pieces() -> AsyncIterator[bytes]:
            for piece in encoded(arrays, start, rows):
                for place in range(0, len(piece), _PIECE):
                    yield bytes(piece[place : place + _PIECE])

        return StreamingResponse(pieces(), headers=_FOR_EVER, media_type="application/octet-stream")

    async def maps(self, request: Request) -> Response:
        """data/{version}/maps/{block}.bin."""
        rows = self._rows(request)
        content = await asyncio.to_thread(self.gallery.maps, request.path_params["block"], rows)
        if content is None:
            raise Refused(404, "no such block of maps")
        return Response(content, headers=_FOR_EVER, media_type="application/octet-stream")

    def _rows(self, request: Request) -> int:
        rows = self.gallery.rows_in(request.path_params["version"])
        if rows is None:
            raise Refused(404, "no such version of the data; read data/catalogue.json again")
        return rows


def studio_app(studio: Studio, token: str, port: int) -> Application:
    """The studio as an ASGI application.

    Args:
        studio: what requests share.
        token: what writing needs.
        port: at which it is reached, for the Host header.
    """
    routes = [
        Route("/data/catalogue.json", studio.catalogue),
        Route("/data/{version}/columns.bin", studio.columns),
        Route("/data/{version}/maps/{block:int}.bin", studio.maps),
        *studio.api.routes(),
        Route("/", studio.page),
        Route("/{name:path}", studio.page),
    ]
    application = Router(routes, redirect_slashes=False, lifespan=studio.at_work)
    hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}
    return Guard(application, frozenset(hosts), token)


def _number(text: str, most: int) -> int:
    """A number of a query, 0 to `most`."""
    if not (text.isascii() and text.isdigit() and len(text) < 12 and int(text) <= most):
        raise Refused(400, f"from is {text[:20]!r}; give a row from 0 to {most}")
    return int(text)
