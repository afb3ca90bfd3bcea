"""The service's pages: axes, jobs and history for people, the workbench, reports, and the API's description."""

from __future__ import annotations

import secrets
import shutil
import tempfile
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, HTTPException, Response

from autotune.core.errors import AutotuneError
from autotune.service.manager import Manager
from autotune.service.views import FileView, by_id, recordings, reports
from autotune.view.web_files import REPORT_HEADERS
from autotune.workbench.engine import Engine
from autotune.workbench.files import Files
from autotune.workbench.routes import REFUSALS, Id, answer_error, page_of, page_routes, workbench_routes

MOST_REPORTS = 200


def add_pages(app: FastAPI, manager: Manager) -> None:
    """Pages and workbench of a service; the workbench's process begins with its first computation."""
    files = Files(Path(tempfile.gettempdir()) / f"autotune-workbench-{secrets.token_hex(8)}")
    engine = Engine()
    app.include_router(page_routes())
    app.include_router(workbench_routes(files, engine, [one.axis for one in manager.configuration.axes]))
    app.include_router(_reports(manager, files))
    app.include_router(_entrance())
    app.add_exception_handler(AutotuneError, answer_error)

    def ended() -> None:
        engine.close()
        shutil.rmtree(files.folder, ignore_errors=True)

    app.state.ended = ended


def _entrance() -> APIRouter:
    routes = APIRouter(include_in_schema=False)

    @routes.get("/")
    def first() -> Response:
        return page_of("service.html")

    @routes.get("/docs")
    def docs() -> Response:
        return page_of("docs.html")

    return routes


def _reports(manager: Manager, files: Files) -> APIRouter:
    routes = APIRouter(prefix="/api", tags=["pages"], responses=REFUSALS)

    def of(axis: str) -> list[tuple[dict[str, Any], Path]]:
        return reports(manager.configuration.runs, axis)[:MOST_REPORTS]

    @routes.get("/reports", response_model=list[FileView])
    def listed() -> list[dict[str, Any]]:
        """Reports of all axes' runs, newest first."""
        found = [view for one in manager.configuration.axes for view, _ in of(one.name)]
        return sorted(found, key=lambda view: str(view["run"]), reverse=True)[:MOST_REPORTS]

    @routes.get("/reports/{report}", response_class=Response)
    def report(report: Id) -> Response:
        """A run's report, as a page that can do nothing but show itself."""
        for one in manager.configuration.axes:
            found = by_id(of(one.name), report)
            if found is not None:
                return Response(found[1].read_bytes(), media_type="text/html", headers=REPORT_HEADERS)
        raise HTTPException(404, f"there is no report {report}; it may have been removed for room")

    @routes.post("/workbench/from-run/{recording}")
    def adopt(recording: Id) -> dict[str, Any]:
        """A recording of a run, taken to the workbench."""
        for one in manager.configuration.axes:
            found = by_id(recordings(manager.configuration.runs, one.name), recording)
            if found is not None:
                held = files.add_path(found[1])
                return {"id": held.id, "name": f"{found[0]['run']} {found[0]['name']}", **held.about}
        raise HTTPException(404, f"there is no recording {recording}; it may have been removed for room")

    return routes
