"""Requests beside the pages: uploads, reports, recordings, the viewer's files, and ``/api`` for programs."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final
from urllib.parse import quote

from fastapi import FastAPI, Query, Security
from fastapi.exceptions import RequestValidationError
from fastapi.security import HTTPBearer
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.staticfiles import StaticFiles

from mavhums.core.about import EPILOG, NOTICE, __version__
from mavhums.core.errors import MavhumsError
from mavhums.core.models import Contract
from mavhums.results.assessment import SCHEMA, Assessment, without_record
from mavhums.results.standing import LastFlightOf, StoreStatus, TrendReport
from mavhums.serve.guard import SESSION, UPLOADS
from mavhums.serve.sessions import Dropped, Sessions
from mavhums.show.html_plot import curve_table
from mavhums.show.viewer import WEB_FILES, save_web_viewer

if TYPE_CHECKING:
    from pydantic import BaseModel

_STATIC: Final = Path(__file__).parent / "static"
# The example: mavhums-sim flight --friction elevator=0.2..1.2 --seed 11 --duration 45 --rate 10
# --tier instrumented
_PLOTLY: Final = "plotly.min.js"
_REPORT: Final = (
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)
_VIEWER: Final = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; "
    "style-src 'unsafe-inline'; img-src 'self' data: blob:; worker-src 'self' blob:; "
    "frame-ancestors 'self'; base-uri 'none'; object-src 'none'"
)
"""The viewer begins with a script in its page, and is WebAssembly."""
_BEFORE: Final = '<head><script src="/static/viewer.js"></script>'
_NONE: Final = "there is nothing here; the log may have been removed at the end of its session"
_MOST: Final = 4000
_TRIES: Final = {"retry-after": "10", "connection": "close"}
_LOG: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}
_ASK: Final = "GET /api/openapi.json describes the requests; /api/fleet needs `mavhums serve --store STORE`"
_Aircraft = Annotated[str, Query(description="Name of an aircraft.")]


class _MissingError(Exception):
    """The session has no such log, or nothing of this kind was made of it."""


LogOf = Callable[[Request, str, str], Dropped]
"""Returns the log of a request by its id, of which a part was made: its report, say."""


def add_routes(app: FastAPI, sessions: Sessions, store: str | None) -> LogOf:
    """Add the routes to an application; return how they find a log."""
    viewer = _Viewer(sessions.folder)

    @app.exception_handler(_MissingError)
    async def missing(_: Request, error: _MissingError) -> Response:
        return PlainTextResponse(_NONE, status_code=404)

    def found(request: Request, log_id: str, part: str) -> Dropped:
        log = sessions.log(request.scope[SESSION], log_id)
        if log is None or not getattr(log, part).exists():
            raise _MissingError
        return log

    @app.post(UPLOADS)
    async def upload(request: Request) -> Response:
        try:
            name = request.query_params.get("name", "")
            log = await sessions.add(request.scope[SESSION], name, request.stream())
        except MavhumsError as error:
            answer = {"problem": error.problem, "remedy": error.remedy}
            return JSONResponse(answer, status_code=422, headers={"connection": "close"})
        except ClientDisconnect:
            return Response(status_code=400)
        return JSONResponse({"id": log.id})

    @app.get("/logs/{log_id}/report")
    async def report(request: Request, log_id: str, save: bool = False) -> Response:
        log = found(request, log_id, "report")
        headers = {"content-security-policy": _REPORT, "cache-control": "no-store"}
        if save:
            headers |= _saved_as(f"{Path(log.name).stem}-report.html")
        return FileResponse(log.report, media_type="text/html; charset=utf-8", headers=headers)

    @app.get("/logs/{log_id}/assessment.json")
    async def assessment(request: Request, log_id: str) -> Response:
        log = found(request, log_id, "assessment")
        headers = _saved_as(f"{Path(log.name).stem}.json")
        return FileResponse(log.assessment, media_type="application/json", headers=headers)

    @app.get("/logs/{log_id}/curves")
    async def curves(request: Request, log_id: str, save: bool = False) -> Response:
        log = found(request, log_id, "shown")
        content = json.loads(await asyncio.to_thread(log.shown.read_bytes))["curves"]
        if save:
            headers = _saved_as(f"{Path(log.name).stem}-curves.csv")
            text = await asyncio.to_thread(lambda: curve_table(content["charts"]).to_csv(index=False))
            return Response(text, media_type="text/csv", headers=headers)
        return JSONResponse(content)

    @app.get("/logs/{log_id}/flight.rrd")
    async def recording(request: Request, log_id: str) -> Response:
        return FileResponse(found(request, log_id, "rrd").rrd, media_type="application/octet-stream")

    @app.get("/viewer/{name}")
    async def viewer_file(name: str) -> Response:
        if name not in WEB_FILES:
            raise _MissingError
        try:
            file = await viewer.file(name)
            return FileResponse(file, headers={"content-security-policy": _VIEWER})
        except MavhumsError as error:
            return PlainTextResponse(str(error), status_code=503)

    @app.get(f"/static/{_PLOTLY}")
    async def plotly() -> Response:
        return FileResponse(_plotly() / _PLOTLY)

    app.mount("/static", StaticFiles(directory=_STATIC))
    if store is not None:
        _add_stored(app, sessions, store)
    return found


def _add_stored(app: FastAPI, sessions: Sessions, store: str) -> None:
    from mavhums.flights import queries, reports

    @app.get("/fleet/curves")
    async def stored_curves(request: Request, aircraft: str = "", log: str = "") -> Response:
        try:
            flight = await asyncio.to_thread(queries.flight, store, aircraft, log)
            path = Path(flight.log.path or "")
            return JSONResponse(await sessions.curves(request.scope[SESSION], path, log))
        except MavhumsError as error:
            return JSONResponse({"problem": error.problem, "remedy": error.remedy})

    @app.get("/fleet/trend.csv")
    async def trend(aircraft: str = "") -> Response:
        try:
            report = await asyncio.to_thread(reports.trend, store, aircraft)
        except MavhumsError as error:
            return PlainTextResponse(str(error), status_code=404)
        text = await asyncio.to_thread(lambda: report.to_frame().to_csv(index=False))
        return Response(text, media_type="text/csv", headers=_saved_as(f"{aircraft}-trend.csv"))


def _saved_as(name: str) -> dict[str, str]:
    return {"content-disposition": f"attachment; filename*=UTF-8''{quote(name, safe='')}"}


def _plotly() -> Path:
    """Return the folder with Plotly's program for the browser; its Python is not imported."""
    found = find_spec("plotly")
    assert found
    assert found.origin
    return Path(found.origin).with_name("package_data")


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


class Problem(Contract):
    """Why there is no answer, and what to do."""

    problem: str
    remedy: str


class Version(Contract):
    """Version of mavhums, schema of an assessment, the notice of results, and whether there is a store."""

    mavhums: str
    assessment: str
    notice: str
    store: bool


def api(sessions: Sessions, store: str | None) -> FastAPI:
    """Return the application for programs, which runs behind the page's guard.

    Parameters
    ----------
    sessions
        They judge logs with the processes, limits and queue of the page.
    store
        The store to be queried; None without one.
    """
    app = FastAPI(
        title="mavhums",
        version=__version__,
        description=f"Health of a UAV's actuators and control from its logs. {EPILOG}",
        docs_url=None,  # these pages fetch their scripts from elsewhere
        redoc_url=None,
        responses={code: {"model": Problem} for code in ("4XX", "5XX")},
        dependencies=[Security(HTTPBearer(auto_error=False, description="The token that serve printed."))],
    )
    _answer_problems(app)
    _add_logs(app, sessions)

    @app.get("/version", response_model=Version)
    async def version() -> Version:
        """Say which version this is."""
        return Version(mavhums=__version__, assessment=SCHEMA, notice=NOTICE, store=store is not None)

    if store is not None:
        _add_store(app, store)
    described = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            without_record(described()["components"]["schemas"])
        return described()

    app.openapi = openapi  # type: ignore[method-assign]
    return app


def _add_logs(app: FastAPI, sessions: Sessions) -> None:
    @app.post("/logs", openapi_extra=_LOG, **_gives(Assessment))
    async def logs(
        request: Request, name: Annotated[str, Query(description="Name of the file.")] = "log"
    ) -> Response:
        """Judge a log, the body of the request, as `mavhums analyse --json` does; nothing of it is kept."""
        if request.headers.get("content-type", "").startswith("multipart/"):
            remedy = "send the bytes of the log alone: curl --data-binary @flight.tlog"
            return _problem(415, "the body is a form", remedy, {"connection": "close"})
        if sessions.is_full:
            return _problem(503, "too many logs at a time", "send it again in a moment", _TRIES)
        user = f"api {request.client.host if request.client else ''}"  # behind a proxy, all are one user
        try:
            return _json(await sessions.assess(user, name, request.stream()))
        except ClientDisconnect:
            return Response(status_code=400)


def _add_store(app: FastAPI, store: str) -> None:
    from mavhums.flights import queries, reports

    async def asked(question: Callable[[], Any]) -> Any:
        try:
            return await asyncio.to_thread(question)
        except MavhumsError as error:
            raise HTTPException(404, (error.problem, error.remedy)) from error  # type: ignore[arg-type]

    @app.get("/fleet/status", **_gives(StoreStatus))
    async def status() -> Response:
        """Say what the store holds, and what failed, as `mavhums fleet status --json` does."""
        return _json((await asked(lambda: reports.status(store))).model_dump_json())

    @app.get("/fleet/worst", **_gives(list[LastFlightOf]))
    async def worst(most: Annotated[int, Query(ge=1, le=_MOST)] = 20) -> Response:
        """List the actuators of all aircraft, the worst first, as `mavhums fleet worst --json` does."""
        rows = await asked(lambda: queries.worst(store, most=most))
        return _json(f"[{','.join(row.to_json() for row in rows)}]")

    @app.get("/fleet/trend", **_gives(TrendReport))
    async def trend(aircraft: _Aircraft) -> Response:
        """Return an aircraft's trends, as `mavhums trend --json` does."""
        return _json((await asked(lambda: reports.trend(store, aircraft))).to_json(indent=None))

    @app.get("/fleet/flights", **_gives(list[Assessment]))
    async def flights(aircraft: _Aircraft) -> Response:
        """List an aircraft's flights in time order, with their verdicts."""
        flown = await asked(lambda: queries.flights(store, aircraft))
        return _json(f"[{','.join(flight.to_json(indent=None) for flight in flown)}]")

    @app.get("/fleet/flight", **_gives(Assessment))
    async def flight(
        aircraft: _Aircraft,
        log: Annotated[str, Query(description="SHA-256 of its log, as /api/fleet/flights has it.")],
    ) -> Response:
        """Return the whole assessment of a flight."""
        return _json((await asked(lambda: queries.flight(store, aircraft, log))).to_json(indent=None))


def _answer_problems(app: FastAPI) -> None:
    """Answer every error with problem and remedy."""

    @app.exception_handler(MavhumsError)
    async def refused(_: Request, error: MavhumsError) -> Response:
        # the rest of a log that is refused on its way is not read
        return _problem(422, error.problem, error.remedy, {"connection": "close"})

    @app.exception_handler(RequestValidationError)
    async def wrong(_: Request, error: RequestValidationError) -> Response:
        problems = "; ".join(f"{one['loc'][-1]}: {one['msg'].lower()}" for one in error.errors())
        return _problem(422, problems, _ASK)

    @app.exception_handler(HTTPException)
    async def other(_: Request, error: HTTPException) -> Response:
        detail: Any = error.detail
        reason = detail if isinstance(detail, tuple) else (str(detail).lower(), _ASK)
        return _problem(error.status_code, reason[0], reason[1], error.headers)


def _gives(model: type[BaseModel] | Any) -> dict[str, Any]:
    """Return how a route is described whose answer is written as JSON by its model."""
    return {"response_model": None, "responses": {200: {"model": model}}}


def _json(content: str | bytes) -> Response:
    return Response(content, media_type="application/json", headers={"cache-control": "no-store"})


def _problem(status: int, problem: str, remedy: str, headers: Mapping[str, str] | None = None) -> Response:
    return JSONResponse({"problem": problem, "remedy": remedy}, status, headers)
