"""The workbench's addresses: its page, recordings, traces and computations.

Models live in the page; recordings are known here by the hash of their content. A page that finds the service
restarted sends its recordings again, and has lost nothing.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from typing import Annotated, Any

from fastapi import APIRouter, FastAPI, HTTPException, Path, Query, Request, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect

from autotune import __version__
from autotune.core.axis import Axis
from autotune.core.errors import AutotuneError
from autotune.models.table import EFFECTS
from autotune.view.web_files import HEADERS, web_file
from autotune.workbench.answers import about
from autotune.workbench.engine import Engine, Job
from autotune.workbench.files import MOST_SENT, Files, Held, Incoming, known_formats

Id = Annotated[str, Path(pattern=r"^[0-9a-f]{32}$")]
Name = Annotated[str, Query(min_length=1, max_length=200)]
AT_ONCE = 4_000_000
"""Bytes of a file on its way that are written together."""
REFUSED = {
    400: "The body is not JSON, or broke off.",
    401: "No token.",
    403: "Another token, or a host name that the service does not go by.",
    404: "There is none of that name or id, or not any more.",
    408: "The body did not arrive in time.",
    413: "The body is too large.",
    422: "What was sent cannot be used; `detail` says why.",
    503: "Too busy now.",
    504: "No answer in time.",
}
"""What every address may answer instead: status and reason."""
REFUSALS: dict[int | str, dict[str, Any]] = {
    code: {"description": why, "content": {"application/json": {"schema": {"type": "object"}}}}
    for code, why in REFUSED.items()
}
"""The same in the words of the pages' description."""


class Wish(BaseModel):
    """A computation: what, with which recordings (ids), model (TOML) and effects."""

    model_config = ConfigDict(extra="forbid")
    kind: str = Field(pattern=r"^(fit|compare|diagnose|add)$")
    recordings: list[str] = Field(max_length=20)
    left_out: list[list[tuple[float, float]]] | None = Field(None, max_length=20)
    model: str | None = Field(None, max_length=2_000_000)
    effects: list[str] = Field(default_factory=list, max_length=16)


class Foreign(BaseModel):
    """How a foreign file is to be read: `autotune data import`'s options."""

    model_config = ConfigDict(extra="forbid")
    format: str = "csv"
    columns: list[str] = Field(default_factory=list, max_length=20)
    unit: str | None = None
    torque_unit: str | None = None
    resolution: float | None = None
    period: float | None = None
    torque_limit: float | None = None
    controller: str | None = None
    keep_signs: bool = False


def page_of(name: str) -> Response:
    """A file of the pages, from the package."""
    found = web_file(name)
    if found is None:
        raise HTTPException(404, "there is no such page")
    return Response(found[0], media_type=found[1], headers=HEADERS)


def workbench_routes(files: Files, engine: Engine, axes: Sequence[Axis] = ()) -> APIRouter:
    """All addresses of the workbench; `axes`: of the service that it is part of."""
    routes = APIRouter(tags=["workbench"], responses=REFUSALS)
    _recordings(routes, files, axes)
    _jobs(routes, files, engine)
    return routes


def page_routes() -> APIRouter:
    """The pages' files; they hold nothing that is not in the package."""
    routes = APIRouter(include_in_schema=False)

    @routes.get("/workbench")
    def page() -> Response:
        return page_of("workbench.html")

    @routes.get("/web/{name:path}")
    def part(name: str) -> Response:
        return page_of(name)

    return routes


def _recordings(routes: APIRouter, files: Files, axes: Sequence[Axis]) -> None:
    @routes.get("/api/workbench/about")
    def about_all() -> dict[str, Any]:
        """The effects that there are and what they look like, files that can be imported, axes with their limits."""
        effects = {name: about(name) for name in EFFECTS}
        return {
            "version": __version__, "effects": effects, "formats": known_formats(), "most_bytes": MOST_SENT,
            "axes": [one.name for one in axes], "limits": {one.name: _limits(one) for one in axes},
        }  # fmt: skip

    @routes.get("/api/workbench/recordings")
    def listed() -> list[dict[str, Any]]:
        """The recordings that are here."""
        return [_view(held) for held in files.list()]

    @routes.post("/api/workbench/recordings")
    async def sent(request: Request, response: Response, name: Name) -> dict[str, Any]:
        """A recording of this program, Parquet or CSV, as the body."""
        with files.incoming() as given:
            await _receive(request, given)
            began = time.perf_counter()
            held = await run_in_threadpool(files.add_sent, given, name)
        response.headers["Server-Timing"] = f"check;dur={1e3 * (time.perf_counter() - began):.0f}"
        return _view(held)

    @routes.post("/api/workbench/import")
    async def foreign(
        request: Request, name: Name, options: Annotated[str, Query(max_length=4000)]
    ) -> dict[str, Any]:
        """A file of somebody else as the body; `options` is a JSON object of `autotune data import`'s options."""
        wanted = _options(options)
        with files.incoming() as given:
            await _receive(request, given)
            return _view(await run_in_threadpool(files.add_foreign, given, name, wanted))

    @routes.get("/api/workbench/recordings/{recording}/trace", response_model=dict[str, Any])
    def trace(
        recording: Id,
        columns: Annotated[str, Query(pattern=r"^[a-z_]+(,[a-z_]+)*$", max_length=300)],
        start: float | None = None,
        end: float | None = None,
        points: Annotated[int, Query(ge=10, le=5000)] = 1000,
    ) -> Response:
        """Smallest and largest values over time, as many as a screen can show."""
        try:
            shown = files.trace(recording, tuple(columns.split(",")), start=start, end=end, points=points)
        except KeyError:
            raise _gone() from None
        return Response(
            json.dumps(shown, allow_nan=False), media_type="application/json"
        )  # thousands of numbers


def _jobs(routes: APIRouter, files: Files, engine: Engine) -> None:
    @routes.post("/api/workbench/jobs", status_code=202, response_model=dict[str, Any])
    def start(wish: Wish) -> Response:
        """Begins a computation."""
        content = wish.model_dump()
        content["paths"] = [str(_known(files, id).path) for id in content.pop("recordings")]
        left_out = content["left_out"]
        if left_out is not None and len(left_out) != len(content["paths"]):
            raise HTTPException(422, "left_out needs one list for each recording")
        return _told(engine.submit(content), 202)

    @routes.get("/api/workbench/jobs/{job}", response_model=dict[str, Any])
    def state(job: Id) -> Response:
        """How far it is, and what it has found."""
        return _told(_job(engine, job))

    @routes.post("/api/workbench/jobs/{job}/stop", response_model=dict[str, Any])
    def stop(job: Id) -> Response:
        """Ends it."""
        _job(engine, job)
        return _told(engine.stop(job))


def _options(text: str) -> dict[str, Any]:
    """How a foreign file is to be read.

    Raises:
        HTTPException: 422, it is no JSON object of these options; says which one is wrong.
    """
    try:
        return Foreign.model_validate_json(text).model_dump(exclude_none=True)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise HTTPException(
            422, f"options{'.' if where else ''}{where}: {first['msg']}; they are a JSON object, such as {{}}"
        ) from None


async def _receive(request: Request, given: Incoming) -> None:
    """The body into its file, megabytes at a time, while others are served."""
    waiting, size = list[bytes](), 0
    try:
        async for part in request.stream():
            waiting.append(part)
            size += len(part)
            if size > AT_ONCE:
                await run_in_threadpool(given.write, b"".join(waiting))
                waiting, size = [], 0
    except ClientDisconnect:
        raise HTTPException(400, "the connection was closed before the file was here") from None
    await run_in_threadpool(given.write, b"".join(waiting))


def _known(files: Files, id: str) -> Held:
    try:
        return files.get(id)
    except KeyError:
        raise _gone() from None


def _gone() -> HTTPException:
    return HTTPException(404, "this recording is not here any more; drop the file again")


def _told(job: Job, status: int = 200) -> Response:
    return Response(job.text(), status, media_type="application/json")


def _job(engine: Engine, id: str) -> Job:
    try:
        return engine.get(id)
    except KeyError:
        raise HTTPException(404, "this computation is not known any more; ask again") from None


def _limits(axis: Axis) -> dict[str, Any]:
    """What an axis may do; its fingerprint tells whether that was so when something was recorded."""
    held = axis.limits.model_dump(include={"position_min", "position_max", "speed", "torque"})
    return {**held, "fingerprint": axis.fingerprint}


def _view(held: Held) -> dict[str, Any]:
    return {"id": held.id, "name": held.name, **held.about}


def make_app(files: Files, engine: Engine) -> FastAPI:
    """The application of `autotune workbench`, without a service."""
    app = FastAPI(
        title="autotune workbench", version=__version__, docs_url=None, redoc_url=None, openapi_url=None
    )
    app.include_router(page_routes())
    app.include_router(workbench_routes(files, engine))
    app.add_exception_handler(AutotuneError, answer_error)

    @app.get("/", include_in_schema=False)
    def first() -> Response:
        return page_of("workbench.html")

    return app


async def answer_error(request: Request, error: Exception) -> Response:
    """What is wrong with a file or a wish, as a sentence."""
    return JSONResponse({"detail": str(error)}, 422)
