"""The HTTP API: what a person, a script or the workbench asks the service.

Every answer is JSON but events (server-sent), metrics and recordings. A request names axes, jobs, models
and recordings by name or id; none of these is ever used as a path.
"""

from __future__ import annotations

import logging
from typing import Annotated, Any

from fastapi import APIRouter, FastAPI, HTTPException, Path, Query, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.utils import get_openapi
from fastapi.responses import FileResponse, JSONResponse, StreamingResponse
from sqlalchemy.exc import SQLAlchemyError

from autotune import __version__
from autotune.models.model_file import parse_model
from autotune.service import studies
from autotune.service.access import STUDIES
from autotune.service.event_stream import EVENTS, stream
from autotune.service.live_routes import live_routes
from autotune.service.manager import Manager
from autotune.service.metrics import exposition
from autotune.service.pages import add_pages
from autotune.service.report_history import Histories
from autotune.service.settings import WatchedAxis
from autotune.service.store import Row
from autotune.service.views import (
    AxisView,
    FileView,
    HistoryView,
    IdleFor,
    Job,
    ModelView,
    Problem,
    Proposal,
    Start,
    by_id,
    models,
    recordings,
    view_axis,
    view_job,
)
from autotune.tuning.backup import backup_ids
from autotune.workbench.routes import REFUSED

AxisName = Annotated[str, Path(pattern=r"^[a-z0-9][a-z0-9-]{0,40}$")]
Id = Annotated[str, Path(pattern=r"^[0-9a-f]{32}$")]
Limit = Annotated[int, Query(ge=1, le=1000)]
log = logging.getLogger("autotune.service")
TICKS_LATE = 15.0  # s without a round after which the service is not healthy
_COMMON: dict[int | str, dict[str, Any]] = {
    code: {"model": Problem, "description": why} for code, why in REFUSED.items() if code != 422
}
_CONFLICT: dict[int | str, dict[str, Any]] = {
    409: {"model": Problem, "description": "Not as things are now."}
}


def make_api(manager: Manager) -> FastAPI:
    """The application; `access.AccessGuard` goes round it."""
    app = FastAPI(
        title="autotune", version=__version__, docs_url=None, redoc_url=None, openapi_url="/openapi.json"
    )
    app.include_router(_axes(manager))
    app.include_router(_jobs(manager))
    app.include_router(_files(manager))
    app.include_router(_proposals(manager))
    app.include_router(_health(manager))
    app.include_router(live_routes(manager))
    add_pages(app, manager)
    app.add_exception_handler(RequestValidationError, _senseless)
    app.add_exception_handler(SQLAlchemyError, _unreadable)
    app.add_exception_handler(OSError, _unreadable)
    app.openapi = lambda: _openapi(app)  # type: ignore[method-assign]
    return app


async def _senseless(request: Request, error: Exception) -> Response:
    """What is wrong where; what was sent is not repeated: it may be anything, also what JSON cannot hold."""
    found = error.errors() if isinstance(error, RequestValidationError) else []
    detail = [{"loc": one["loc"], "msg": _words(one), "type": one["type"]} for one in found]
    return JSONResponse({"detail": detail}, 422)


async def _unreadable(request: Request, error: Exception) -> Response:
    """History or files cannot be used now; the rounds say the same in /healthz."""
    log.error("%s %s: %s", request.method, request.url.path, error)
    return JSONResponse({"detail": "the history or a file of it cannot be used now; see /healthz"}, 503)


def _words(problem: dict[str, Any]) -> str:
    if problem["type"] == "model_attributes_type":
        return "the body must be a JSON object, sent with 'Content-Type: application/json'"
    return str(problem["msg"])


def _openapi(app: FastAPI) -> dict[str, Any]:
    """The description, with the token on everything that writes or computes for long."""
    if app.openapi_schema is None:
        schema = get_openapi(title=app.title, version=app.version, routes=app.routes)
        schema.setdefault("components", {})["securitySchemes"] = {
            "token": {"type": "http", "scheme": "bearer"}
        }
        for path, operations in schema["paths"].items():
            for method, operation in operations.items():
                if method not in ("get", "head", "options") or STUDIES.fullmatch(path):
                    operation["security"] = [{"token": []}]
        app.openapi_schema = schema
    return app.openapi_schema


def _axes(manager: Manager) -> APIRouter:
    routes = APIRouter(prefix="/api/axes", tags=["axes"], responses=_COMMON)
    histories = Histories(manager.store)

    @routes.get("", response_model=list[AxisView])
    def axes() -> list[dict[str, Any]]:
        """All axes and their states."""
        return [view_axis(manager, one) for one in manager.configuration.axes]

    @routes.get("/{axis}", response_model=AxisView)
    def one_axis(axis: AxisName) -> dict[str, Any]:
        """One axis and its state."""
        return view_axis(manager, _axis(manager, axis))

    @routes.get("/{axis}/history", response_model=HistoryView)
    def history(axis: AxisName, checks: Limit = 400) -> Response:
        """Parameters, temperature and events over time, and what the trend says."""
        return Response(histories.of(_axis(manager, axis).name, checks), media_type="application/json")

    @routes.get("/{axis}/checks", response_model=list[dict[str, Any]])
    def checks(axis: AxisName, limit: Limit = 50) -> Response:
        """Checks, oldest first."""
        return JSONResponse(manager.store.list_checks(_axis(manager, axis).name, limit, whole=False))

    @routes.get("/{axis}/backups", response_model=list[str])
    def backups(axis: AxisName) -> list[str]:
        """Ids of what the drive held before commits, oldest first."""
        return backup_ids(manager.configuration.runs, _axis(manager, axis).name)

    @routes.put("/{axis}/idle", response_model=AxisView)
    def idle(axis: AxisName, wish: IdleFor) -> dict[str, Any]:
        """Calls the machine idle for some minutes: jobs that wait for that may begin."""
        watched = _axis(manager, axis)
        manager.permit(watched.name, wish.minutes)
        return view_axis(manager, watched)

    @routes.post("/{axis}/jobs", status_code=202, response_model=Job, responses=_CONFLICT)
    def start(axis: AxisName, wish: Start) -> dict[str, Any]:
        """Starts a check, a run or a rollback. The token is the consent to move: nobody is asked at the machine."""
        watched = _axis(manager, axis)
        options = wish.model_dump(exclude={"kind"}, exclude_none=True)
        if "to" in options and options["to"] not in backup_ids(manager.configuration.runs, watched.name):
            raise HTTPException(404, f"there is no backup {options['to']} of axis {watched.name}")
        if "model" in options:
            parse_model(options["model"])  # or says what is wrong
        row = manager.submit(watched.name, wish.kind, "http", options)
        if row is None:
            raise HTTPException(409, f"a {wish.kind} of axis {watched.name} is waiting or running already")
        return view_job(manager, row)

    return routes


def _jobs(manager: Manager) -> APIRouter:
    routes = APIRouter(prefix="/api", tags=["jobs"], responses=_COMMON)

    @routes.get("/jobs", response_model=list[Job])
    def jobs(
        axis: Annotated[str | None, Query(pattern=r"^[a-z0-9][a-z0-9-]{0,40}$")] = None,
        state: Annotated[str | None, Query(pattern=r"^(queued|running|done)$")] = None,
        limit: Limit = 50,
    ) -> list[dict[str, Any]]:
        """Jobs, newest first."""
        return [view_job(manager, row) for row in manager.store.list_jobs(axis, state, limit)]

    @routes.get("/jobs/{job}", response_model=Job)
    def one_job(job: Id) -> dict[str, Any]:
        """One job."""
        return view_job(manager, _job(manager, job))

    @routes.get("/jobs/{job}/result", response_model=dict[str, Any], responses=_CONFLICT)
    def result(job: Id) -> Response:
        """What a check or run has found: the object that `--json` prints."""
        row = _job(manager, job)
        if row["state"] != "done":
            raise HTTPException(409, "this job has not ended yet")
        found = manager.store.measured_by_name(str(row["run"] or ""))
        if found is None:
            raise HTTPException(404, "this job has left no result; see its sentence")
        return Response(found["content"], media_type="application/json")

    @routes.post("/jobs/{job}/stop", status_code=202, response_model=Job, responses=_CONFLICT)
    def stop(job: Id) -> dict[str, Any]:
        """Stops a job: the axis comes to rest and everything is put back."""
        _job(manager, job)
        if not manager.stop(job):
            raise HTTPException(409, "this job has ended already")
        return view_job(manager, _job(manager, job))

    @routes.get("/jobs/{job}/events", response_class=StreamingResponse, responses=EVENTS)
    def job_events(job: Id) -> StreamingResponse:
        """Stages and progress of a job as server-sent events, until it has ended."""
        row = _job(manager, job)
        return stream(manager, job, row)

    @routes.get("/events", response_class=StreamingResponse, responses=EVENTS)
    def events() -> StreamingResponse:
        """Everything that happens, as server-sent events."""
        return stream(manager, None, None)

    @routes.get("/history/events", response_model=list[dict[str, Any]])
    def history_events(limit: Limit = 200) -> list[dict[str, Any]]:
        """What has happened, oldest first."""
        return [
            {name: row[name] for name in ("axis", "at", "kind", "sentence")}
            for row in manager.store.list_events(None, limit)
        ]

    return routes


def _files(manager: Manager) -> APIRouter:
    routes = APIRouter(prefix="/api", tags=["models and recordings"], responses=_COMMON)

    @routes.get("/axes/{axis}/models", response_model=list[FileView])
    def list_models(axis: AxisName) -> list[dict[str, Any]]:
        """Models of an axis, newest first."""
        return [view for view, _ in models(manager.configuration.runs, _axis(manager, axis).name)]

    @routes.get("/axes/{axis}/models/{model}", response_model=ModelView)
    def one_model(axis: AxisName, model: Id) -> dict[str, Any]:
        """A model with its text."""
        found = by_id(models(manager.configuration.runs, _axis(manager, axis).name), model)
        if found is None:
            raise HTTPException(404, f"axis {axis} has no model {model}")
        return {**found[0], "toml": found[1].read_text(encoding="utf-8")}

    @routes.get("/axes/{axis}/recordings", response_model=list[FileView])
    def list_recordings(axis: AxisName) -> list[dict[str, Any]]:
        """Recordings of an axis, newest first."""
        return [view for view, _ in recordings(manager.configuration.runs, _axis(manager, axis).name)]

    @routes.get("/recordings/{recording}", response_class=FileResponse, responses=_PARQUET)
    def one_recording(recording: Id) -> FileResponse:
        """A recording as Parquet."""
        view, path = _recording(manager, recording)
        name = f"{view['run']}-{view['name']}.parquet"
        return FileResponse(path, media_type="application/vnd.apache.parquet", filename=name)

    @routes.get("/recordings/{recording}/compare", response_model=dict[str, Any], responses=_STUDIES)
    def compare(recording: Id, model: Annotated[str | None, Query(pattern=r"^[0-9a-f]{32}$")] = None) -> Any:
        """How well a model (the newest by default) explains a recording."""
        return _study(manager, "compare", recording, model)

    @routes.get("/recordings/{recording}/diagnose", response_model=dict[str, Any], responses=_STUDIES)
    def diagnose(recording: Id, model: Annotated[str | None, Query(pattern=r"^[0-9a-f]{32}$")] = None) -> Any:
        """Which physical effect a model lacks."""
        return _study(manager, "diagnose", recording, model)

    return routes


def _proposals(manager: Manager) -> APIRouter:
    routes = APIRouter(prefix="/api/proposals", tags=["proposals"], responses=_COMMON)

    @routes.get("", response_model=list[Proposal])
    def proposals(limit: Limit = 50) -> list[Row]:
        """Proved commits that wait, or waited, for a person; newest first."""
        return manager.store.list_proposals(None, limit)

    @routes.post("/{proposal}/approve", status_code=202, response_model=Job, responses=_CONFLICT)
    def approve(proposal: Id) -> dict[str, Any]:
        """Writes what was proved to the drive."""
        row = _proposal(manager, proposal)
        job = manager.approve(proposal)
        if job is None:
            state = _proposal(manager, proposal)["state"]
            under_way = f"a commit of axis {row['axis']} is waiting or running already"
            raise HTTPException(409, under_way if state == "open" else f"this proposal is {state} already")
        return view_job(manager, job)

    @routes.post("/{proposal}/reject", response_model=Proposal, responses=_CONFLICT)
    def reject(proposal: Id) -> Row:
        """Leaves the drive as it is."""
        row = _proposal(manager, proposal)
        if not manager.store.decide_proposal(proposal, "rejected", manager.now()):
            raise HTTPException(409, f"this proposal is {row['state']} already")
        return _proposal(manager, proposal)

    return routes


def _health(manager: Manager) -> APIRouter:
    routes = APIRouter(tags=["health"])

    @routes.get("/healthz", responses={503: {"description": "Something is wrong; says what."}})
    def healthz(response: Response) -> dict[str, Any]:
        """Whether the service does its work."""
        problems = manager.problems()
        late = manager.seconds_since_tick()
        if late > TICKS_LATE:
            problems["rounds"] = f"no round for {late:.0f} s"
        response.status_code = 503 if problems else 200
        return {
            "status": "problem" if problems else "ok",
            "problems": problems,
            "restored": manager.health.restored or None,
            "axes": len(manager.configuration.axes),
            "running": len(manager.running),
        }

    @routes.get("/metrics", response_class=Response, responses=_METRICS)
    def metrics() -> Response:
        """For Prometheus."""
        return Response(exposition(manager), media_type="text/plain; version=0.0.4; charset=utf-8")

    for path, answer in (("/healthz", healthz), ("/metrics", metrics)):
        routes.head(path, include_in_schema=False)(answer)  # the server leaves the body out
    return routes


_PARQUET: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {"application/vnd.apache.parquet": {"schema": {"type": "string", "format": "binary"}}},
        "description": "The recording.",
    }
}
_METRICS: dict[int | str, dict[str, Any]] = {
    200: {"content": {"text/plain": {"schema": {"type": "string"}}}, "description": "Exposition format."}
}
_STUDIES: dict[int | str, dict[str, Any]] = {
    409: {"model": Problem, "description": "The recording cannot be studied; says why."},
    501: {"model": Problem, "description": "This installation cannot do that."},
}


def _axis(manager: Manager, name: str) -> WatchedAxis:
    watched = manager.configuration.axis(name)
    if watched is None:
        raise HTTPException(404, f"the service has no axis {name!r}")
    return watched


def _job(manager: Manager, identifier: str) -> Row:
    row = manager.store.job(identifier)
    if row is None:
        raise HTTPException(404, f"there is no job {identifier}")
    return row


def _recording(manager: Manager, identifier: str) -> tuple[dict[str, Any], Any]:
    for one in manager.configuration.axes:
        found = by_id(recordings(manager.configuration.runs, one.name), identifier)
        if found is not None:
            return found
    raise HTTPException(404, f"there is no recording {identifier}; it may have been removed for room")


def _study(manager: Manager, what: str, recording: str, model: str | None) -> dict[str, Any]:
    view, path = _recording(manager, recording)
    there = models(manager.configuration.runs, view["axis"])
    chosen = by_id(there, model) if model else (there[0] if there else None)
    if chosen is None:
        raise HTTPException(404, f"axis {view['axis']} has no such model")
    found = studies.study(what, path, chosen[1])
    if found.status != 200:
        raise HTTPException(found.status, found.detail)
    return found.content


def _proposal(manager: Manager, identifier: str) -> Row:
    row = manager.store.proposal(identifier)
    if row is None:
        raise HTTPException(404, f"there is no proposal {identifier}")
    return row
