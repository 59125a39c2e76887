"""What the browser fetches beside the page: uploads, reports, recordings, the 3-D viewer's files."""

from __future__ import annotations

import asyncio
import csv
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote

from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response

from mavhums.core.errors import MavhumsError
from mavhums.results.standing import to_frame
from mavhums.serve.guard import SESSION, UPLOADS
from mavhums.serve.options import Fleet
from mavhums.serve.sessions import Dropped, Sessions
from mavhums.show.viewer_program import WEB_FILES, save_web_viewer

if TYPE_CHECKING:
    from fastapi import FastAPI

__all__ = ["add_routes"]

_STATIC: Final = Path(__file__).parent / "static"
# The example: mavhums-sim flight --friction elevator=0.2..1.2 --seed 11 --duration 45 --rate 10
# --tier instrumented
_ASSETS: Final = ("charts.js", "example.tlog.xz", "page.css", "page.js", "viewer.js")
_REPORT: Final = (
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)
_BEFORE: Final = '<head><script src="/static/viewer.js"></script>'
_NONE: Final = "there is nothing here; the log may have been removed at the end of its session"


def add_routes(app: FastAPI, sessions: Sessions, fleet: Fleet | None) -> None:
    """Add the routes to an application."""
    viewer = _Viewer(sessions.folder)

    @app.post(UPLOADS)
    async def upload(request: Request) -> Response:
        try:
            session = sessions.get(request.scope[SESSION])
            name = request.query_params.get("name", "")
            log = await sessions.add(session, name, request.stream())
        except MavhumsError as error:
            answer = {"problem": error.problem, "remedy": error.remedy}
            return JSONResponse(answer, status_code=422, headers={"connection": "close"})
        except ClientDisconnect:
            return Response(status_code=400)
        return JSONResponse({"id": log.id})

    @app.get("/logs/{log_id}/report")
    async def report(request: Request, log_id: str, save: bool = False) -> Response:
        log = _found(sessions, request, log_id)
        if log is None or not log.report.exists():
            return PlainTextResponse(_NONE, status_code=404)
        headers = {"content-security-policy": _REPORT, "cache-control": "no-store"}
        if save:
            headers |= _saved_as(f"{Path(log.name).stem}-report.html")
        return FileResponse(log.report, media_type="text/html; charset=utf-8", headers=headers)

    @app.get("/logs/{log_id}/assessment.json")
    async def assessment(request: Request, log_id: str) -> Response:
        log = _found(sessions, request, log_id)
        if log is None or not log.assessment.exists():
            return PlainTextResponse(_NONE, status_code=404)
        headers = _saved_as(f"{Path(log.name).stem}.json")
        return FileResponse(log.assessment, media_type="application/json", headers=headers)

    @app.get("/logs/{log_id}/curves")
    async def curves(request: Request, log_id: str, save: bool = False) -> Response:
        log = _found(sessions, request, log_id)
        if log is None or not log.shown.exists():
            return PlainTextResponse(_NONE, status_code=404)
        found = json.loads(await asyncio.to_thread(log.shown.read_bytes))["curves"]
        if save:
            headers = _saved_as(f"{Path(log.name).stem}-curves.csv")
            return Response(_csv(found), media_type="text/csv", headers=headers)
        return JSONResponse(found)

    @app.get("/logs/{log_id}/flight.rrd")
    async def recording(request: Request, log_id: str) -> Response:
        log = _found(sessions, request, log_id)
        if log is None or not log.rrd.exists():
            return PlainTextResponse(_NONE, status_code=404)
        return FileResponse(log.rrd, media_type="application/octet-stream")

    @app.get("/viewer/{name}")
    async def viewer_file(name: str) -> Response:
        if name not in WEB_FILES:
            return PlainTextResponse(_NONE, status_code=404)
        try:
            return FileResponse(await viewer.file(name))
        except MavhumsError as error:
            return PlainTextResponse(f"{error.problem}: {error.remedy}", status_code=503)

    @app.get("/static/{name}")
    async def asset(name: str) -> Response:
        known = name in _ASSETS
        return FileResponse(_STATIC / name) if known else PlainTextResponse(_NONE, status_code=404)

    if fleet is not None:
        _add_stored(app, sessions, fleet)


def _add_stored(app: FastAPI, sessions: Sessions, fleet: Fleet) -> None:
    @app.get("/fleet/curves")
    async def stored_curves(request: Request, aircraft: str = "", log: str = "") -> Response:
        try:
            flight = await asyncio.to_thread(fleet.flight, aircraft, log)
            path = Path(flight.log.path or "")
            return JSONResponse(await sessions.curves(request.scope[SESSION], path, log))
        except MavhumsError as error:
            return JSONResponse({"problem": error.problem, "remedy": error.remedy})

    @app.get("/fleet/trend.csv")
    async def trend(aircraft: str = "") -> Response:
        try:
            report = await asyncio.to_thread(fleet.trend, aircraft)
        except MavhumsError as error:
            return PlainTextResponse(f"{error.problem}: {error.remedy}", status_code=404)
        text = await asyncio.to_thread(lambda: to_frame(report.trends).to_csv(index=False))
        return Response(text, media_type="text/csv", headers=_saved_as(f"{aircraft}-trend.csv"))


def _csv(curves: dict[str, Any]) -> str:
    """Return curves as a table with a row per time."""
    text = io.StringIO()
    table = csv.writer(text)
    names = ("low", "value", "high", "demanded")
    table.writerow(("curve", "time_s", *names))
    for curve in curves["charts"]:
        columns = [curve.get(name) or [None] * len(curve["time"]) for name in names]
        for row in zip(curve["time"], *columns, strict=True):
            if row[2] is not None:  # no gap
                table.writerow((curve["title"], *row))
    return text.getvalue()


def _saved_as(name: str) -> dict[str, str]:
    return {"content-disposition": f"attachment; filename*=UTF-8''{quote(name, safe='')}"}


def _found(sessions: Sessions, request: Request, log_id: str) -> Dropped | None:
    return sessions.log(request.scope[SESSION], log_id)


class _Viewer:
    """The files of the 3-D viewer, taken out of its program at the first use."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder / "viewer"
        self._lock = asyncio.Lock()

    async def file(self, name: str) -> Path:
        async with self._lock:
            if not (self._folder / WEB_FILES[-1]).exists():
                self._folder.mkdir(exist_ok=True)
                await asyncio.to_thread(save_web_viewer, self._folder)
                index = self._folder / "index.html"
                text = index.read_text(encoding="utf-8")
                index.write_text(text.replace("<head>", _BEFORE, 1), encoding="utf-8")
        return self._folder / name
