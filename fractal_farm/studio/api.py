"""The API of the pages (issue 7): what is known of a design, what a worker computes, what somebody decides."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Awaitable, Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from fractal_farm.catalogue import judge, judgements, run_ids, withdraw
from fractal_farm.catalogue.judging import NONE
from fractal_farm.errors import InputError
from fractal_farm.hand.breeding import origin_of
from fractal_farm.ifs.design_code import design_code
from fractal_farm.ifs.genome import Genome
from fractal_farm.solid.materials import material as profile_of
from fractal_farm.solid.materials import materials
from fractal_farm.solid.parameters import BAILS, BASES, SolidParameters
from fractal_farm.solid.presets import parameters_of, presets
from fractal_farm.studio.answers import FOR_EVER, NO_STORE, file_answer, json_answer, whole_number
from fractal_farm.studio.bodies import (
    MOST_POINTS,
    BreedBody,
    JudgeBody,
    KeepBody,
    PointsBody,
    ScoreBody,
    SolidBody,
    ViewBody,
    parsed,
)
from fractal_farm.studio.details import ancestry, children_of, details, judgement_json
from fractal_farm.studio.family import Family
from fractal_farm.studio.gallery import Gallery
from fractal_farm.studio.genomes import genome_of_json, json_of_genome
from fractal_farm.studio.guard import Refused
from fractal_farm.studio.jobs import Jobs
from fractal_farm.studio.remembered import Remembered
from fractal_farm.studio.views import save_view, saved_views
from fractal_farm.studio.workers import Lane

_QUICK_SECONDS = 20.0
_WRITE_SECONDS = 120.0  # a commit waits for others that write
_REMEMBERED_BYTES = 96 << 20


class Api:
    """Handlers of everything below api/.

    Args:
        gallery: the designs.
        lane: workers for what a person waits for.
        jobs: what takes longer.
    """

    def __init__(self, gallery: Gallery, lane: Lane, jobs: Jobs) -> None:
        self._gallery, self._lane, self._jobs = gallery, lane, jobs
        self.family = Family(gallery.catalogue)
        self._origins: dict[tuple[str, ...], Any] = {}
        self._remembered = Remembered(_REMEMBERED_BYTES)

    def routes(self) -> list[Route]:
        """Paths and who answers."""
        asked: dict[str, Callable[[Request], Awaitable[Response]]] = {
            "/api/design/{identity}": self.design,
            "/api/design/{identity}/points": self.points_of_design,
            "/api/design/{identity}/similar": self.similar,
            "/api/design/{identity}/lineage": self.lineage,
            "/api/design/{identity}/solids/{solid}/{name}": self.solid_file,
            "/api/presets": self.presets,
            "/api/judgements": self.judgements,
            "/api/jobs/{job}": self.job,
            "/api/jobs/{job}/files/{name}": self.job_file,
            "/api/views": self.views,
        }
        told: dict[str, Callable[[Request], Awaitable[Response]]] = {
            "/api/score": self.score,
            "/api/points": self.points,
            "/api/keep": self.keep,
            "/api/judge": self.judge,
            "/api/breed": self.breed,
            "/api/solid": self.solid,
            "/api/jobs/{job}/cancel": self.cancel,
            "/api/views": self.save_view,
        }
        return [
            *(Route(path, answer, methods=["GET"]) for path, answer in asked.items()),
            *(Route(path, answer, methods=["POST"]) for path, answer in told.items()),
            Route("/api/{rest:path}", _nothing, methods=["GET", "POST"]),
        ]

    async def design(self, request: Request) -> Response:
        """All that is known of a design."""
        identity = await self._identity(request.path_params["identity"])

        def found() -> dict[str, Any]:
            gallery = self._gallery
            return details(
                gallery.design(identity),
                gallery.row_of,
                gallery.current.arrays["representative"],
                children_of(self.family.lineage(), identity),
                judgements(gallery.root).get(identity),
                gallery.catalogue.solids(identity),
                str(gallery.root),
            )

        return json_answer(await asyncio.to_thread(found))

    async def points_of_design(self, request: Request) -> Response:
        """Points of a design's shape, as POST api/points gives them of a genome."""
        identity = await self._identity(request.path_params["identity"])
        count = whole_number(request, "count", 100_000, MOST_POINTS)
        view = request.query_params.get("view", "density")
        if view not in ("density", "even"):
            raise Refused(400, "view: allowed are density and even")
        genome = await asyncio.to_thread(self._gallery.genome, identity)
        content = await self._points(genome, count, view)
        return Response(content, headers=FOR_EVER, media_type="application/octet-stream")

    async def similar(self, request: Request) -> Response:
        """The designs that look like one."""
        identity = await self._identity(request.path_params["identity"])
        limit = whole_number(request, "limit", 12, 100)
        arguments = {"root": str(self._gallery.root), "design_id": identity, "limit": limit}
        hits, _ = await self._lane.run("similar", arguments, _QUICK_SECONDS)
        return json_answer([{**hit, "row": self._gallery.row_of(hit["design_id"])} for hit in hits])

    async def lineage(self, request: Request) -> Response:
        """A design and its ancestors."""
        identity = await self._identity(request.path_params["identity"])
        nodes = await asyncio.to_thread(lambda: ancestry(self.family.lineage(), identity, self._gallery.row_of))
        return json_answer({"nodes": nodes})

    async def solid_file(self, request: Request) -> Response:
        """A file of a solid that lies in the catalogue."""
        identity = await self._identity(request.path_params["identity"])
        for solid in await asyncio.to_thread(self._gallery.catalogue.solids, identity):
            name = request.path_params["name"]
            if solid.parameters_hash == request.path_params["solid"] and name in solid.files:
                return file_answer(solid.files[name], f"{design_code(identity)}{solid.files[name].suffix}")
        raise Refused(404, "no such file of a solid")

    async def presets(self, _request: Request) -> Response:
        """What solids are made for, and of."""
        return json_answer(
            {
                "presets": [
                    {
                        "name": each.name,
                        "title": each.title,
                        "material": each.material.name,
                        "parameters": asdict(parameters_of(each.name)),
                    }
                    for each in presets().values()
                ],
                "materials": [asdict(each) for each in materials().values()],
                "defaults": asdict(SolidParameters()),
                "bases": BASES,
                "bails": BAILS,
            }
        )

    async def judgements(self, _request: Request) -> Response:
        """All designs that somebody has judged."""
        found = await asyncio.to_thread(judgements, self._gallery.root)
        return json_answer(
            [
                {"design_id": identity, "row": self._gallery.row_of(identity), **judgement_json(judgement)}
                for identity, judgement in found.items()
            ]
        )

    async def score(self, request: Request) -> Response:
        """Scores of a genome."""
        body = parsed(await request.body(), ScoreBody)
        began = time.perf_counter()
        genome, origin = await self._genome(body.genome)
        phenotype, formula = origin.evolution.phenotype, origin.evolution.fitness.model_dump()
        arguments = {"genome": json_of_genome(genome), "points": phenotype.points, "fitness": formula}

        async def computed() -> bytes:
            result, _ = await self._lane.run("score", arguments, _QUICK_SECONDS)
            return json.dumps(result).encode()

        content = await self._remembered.get(("score", json.dumps(arguments)), computed)
        result = json.loads(content)
        row = self._gallery.row_of(result["design_id"])
        return json_answer({**result, "row": row, "seconds": time.perf_counter() - began})

    async def points(self, request: Request) -> Response:
        """Points of a genome's shape: float32 x, y, z."""
        body = parsed(await request.body(), PointsBody)
        genome, _ = await self._genome(body.genome)
        content = await self._points(genome, body.count, body.view)
        return Response(content, headers=NO_STORE, media_type="application/octet-stream")

    async def keep(self, request: Request) -> Response:
        """Store a genome as a child of a design."""
        body = parsed(await request.body(), KeepBody)
        genome, _ = await self._genome(body.genome)
        identity, known = genome.design_id, self._gallery.row_of(genome.design_id) is not None
        if not known:
            given = [*([body.parent] if body.parent is not None else []), *body.parents]
            parents = [await self._identity(parent) for parent in dict.fromkeys(given)]
            arguments = {"root": str(self._gallery.root), "genome": json_of_genome(genome), "parents": parents}
            await self._lane.run("keep", arguments, _WRITE_SECONDS)
            await asyncio.to_thread(self._gallery.refresh)
        row = self._gallery.row_of(identity)
        return json_answer({"design_id": identity, "code": design_code(identity), "row": row, "known": known})

    async def judge(self, request: Request) -> Response:
        """Stars, favourites."""
        body = parsed(await request.body(), JudgeBody)
        identity = await self._identity(body.design_id)

        result = await asyncio.to_thread(_judged, self._gallery.root, identity, body)
        await asyncio.to_thread(self._gallery.refresh)
        return json_answer({"design_id": identity, "row": self._gallery.row_of(identity), **result})

    async def breed(self, request: Request) -> Response:
        """Start a run that breeds from designs, or steer one."""
        body = parsed(await request.body(), BreedBody)
        ids = [await self._identity(identity) for identity in body.design_ids]
        root = str(self._gallery.root)
        if body.steer:
            words, facts, epochs = [*ids, "--steer"], {"run_id": None}, None
        else:
            arguments = {"root": root, "design_ids": ids, "epochs": body.epochs, "seed": body.seed}
            plan, _ = await self._lane.run("breeding", arguments, _QUICK_SECONDS)
            settings = [word for override in plan["overrides"] for word in ("--set", override)]
            words = [*plan["design_ids"], "--into", "--executor", "serial", *settings]
            facts, epochs = {"run_id": plan["run_id"]}, body.epochs
        job = await self._jobs.breed(words, facts, epochs)
        return json_answer({"job": job.key, **facts, "command": f"farm breed {root} {' '.join(words)}"})

    async def solid(self, request: Request) -> Response:
        """Begin to make a solid."""
        body = parsed(await request.body(), SolidBody)
        if body.genome is not None:
            genome, _ = await self._genome(body.genome)
        else:
            assert body.design_id is not None
            genome = await asyncio.to_thread(self._gallery.genome, await self._identity(body.design_id))
        parameters = parameters_of(body.preset, **body.parameters.model_dump())
        material = body.material or (presets()[body.preset].material.name if body.preset else "silver")
        profile_of(material)
        job = self._jobs.solid(json_of_genome(genome), genome.design_id, parameters, material)
        return json_answer({"job": job.key, "state": job.state})

    async def job(self, request: Request) -> Response:
        """How far a job is."""
        return json_answer(self._jobs.job(request.path_params["job"]).as_json())

    async def cancel(self, request: Request) -> Response:
        """End a job."""
        return json_answer((await self._jobs.cancel(request.path_params["job"])).as_json())

    async def job_file(self, request: Request) -> Response:
        """A file of a finished job."""
        name = request.path_params["name"]
        return file_answer(self._jobs.file(request.path_params["job"], name), name)

    async def views(self, _request: Request) -> Response:
        """Saved views."""
        return json_answer(await asyncio.to_thread(saved_views, self._gallery.root))

    async def save_view(self, request: Request) -> Response:
        """Save a view."""
        body = parsed(await request.body(), ViewBody)
        return json_answer(await asyncio.to_thread(save_view, self._gallery.root, body.name, body.query))

    async def _identity(self, text: str) -> str:
        """The 32 digits of a design's id, from them, its first digits or its code."""
        if len(text) > 64:
            raise Refused(404, "no such design")
        try:
            return await asyncio.to_thread(self._gallery.identity, text)
        except InputError as error:
            missing = "no design" in str(error)
            raise Refused(404 if missing else 400, " ".join(str(error).split())) from None

    async def _genome(self, value: dict[str, Any]) -> tuple[Genome, Any]:
        """A valid genome of a request, and the configuration by which the catalogue scores."""
        origin = await asyncio.to_thread(self._origin)
        return genome_of_json(value, origin.evolution.phenotype.phenotype()), origin

    def _origin(self) -> Any:
        runs = tuple(run_ids(self._gallery.root))
        if runs not in self._origins:
            self._origins = {runs: origin_of(self._gallery.root, [])}
        return self._origins[runs]

    async def _points(self, genome: Genome, count: int, view: str) -> bytes:
        arguments = {"genome": json_of_genome(genome), "count": count, "view": view}

        async def computed() -> bytes:
            return (await self._lane.run("points", arguments, _QUICK_SECONDS))[1]

        return await self._remembered.get(("points", json.dumps(arguments)), computed)


def _judged(root: Path, identity: str, body: JudgeBody) -> dict[str, Any]:
    """Record what is said of a design; what is thought of it now."""
    if body.rejected:
        found = judge(root, [identity], stars=0, favourite=bool(body.favourite))
    elif body.rating:
        found = judge(root, [identity], stars=body.rating, favourite=body.favourite)
    elif body.rating is None and body.rejected is None:
        found = judge(root, [identity], favourite=body.favourite)
    else:  # no stars any more; nobody can say just that
        before = judgements(root).get(identity, NONE)
        found = withdraw(root, [identity])
        if before.favourite if body.favourite is None else body.favourite:
            found = judge(root, [identity], favourite=True)
    return judgement_json(found[identity])


async def _nothing(_request: Request) -> Response:
    raise Refused(404, "no such part of the API")
