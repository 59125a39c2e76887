"""What the browser fetches beside the page: uploads, reports, recordings, the 3-D viewer's files."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import quote

from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, PlainTextResponse, Response

from mavhums.core.errors import MavhumsError
from mavhums.serve.guard import SESSION, UPLOADS
from mavhums.serve.options import Fleet
from mavhums.serve.sessions import Dropped, Sessions
from mavhums.show.html import page
from mavhums.show.html_curves import Gathered
from mavhums.show.viewer_program import WEB_FILES, save_web_viewer

if TYPE_CHECKING:
    from fastapi import FastAPI

__all__ = ["add_routes"]

_STATIC: Final = Path(__file__).parent / "static"
_ASSETS: Final = ("page.css", "page.js", "viewer.js")
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
            name = quote(f"{Path(log.name).stem}-report.html", safe="")
            headers["content-disposition"] = f"attachment; filename*=UTF-8''{name}"
        return FileResponse(log.report, media_type="text/html; charset=utf-8", headers=headers)

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

    @app.get("/fleet/flight")
    async def flight(aircraft: str = "", log: str = "") -> Response:
        if fleet is None:
            return PlainTextResponse(_NONE, status_code=404)
        try:
            wanted = await asyncio.to_thread(fleet.flight, aircraft, log)
        except MavhumsError as error:
            return PlainTextResponse(f"{error.problem}: {error.remedy}", status_code=404)
        text = page(wanted, Gathered())
        return HTMLResponse(text, headers={"content-security-policy": _REPORT})


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
