"""The page for programs: a log in, its assessment out; a fleet's store asked; described by OpenAPI."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any, Final

from fastapi import FastAPI, Query, Request, Response, Security
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.security import HTTPBearer
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from mavhums.core.about import EPILOG, NOTICE, __version__
from mavhums.core.errors import MavhumsError
from mavhums.core.models import Contract
from mavhums.results.assessment import SCHEMA, Assessment, without_record
from mavhums.results.standing import TrendReport
from mavhums.results.store import LastFlightOf, StoreStatus
from mavhums.serve.options import Fleet
from mavhums.serve.sessions import Sessions

if TYPE_CHECKING:
    from pydantic import BaseModel

__all__ = ["api"]

_MOST: Final = 4000
_TRIES: Final = {"retry-after": "10", "connection": "close"}
_LOG: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}
_ASK: Final = "GET /api/openapi.json describes what can be asked; /api/fleet needs `mavhums serve STORE`"
_Aircraft = Annotated[str, Query(description="Name of an aircraft.")]


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


def api(sessions: Sessions, fleet: Fleet | None) -> FastAPI:
    """Return the application for programs, which stands behind the page's guard.

    Parameters
    ----------
    sessions
        They judge logs by the page's processes, limits and turns.
    fleet
        The store that is asked; None without one.
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
        return Version(mavhums=__version__, assessment=SCHEMA, notice=NOTICE, store=fleet is not None)

    if fleet is not None:
        _add_store(app, fleet)
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
            return _problem(415, "the body is a form", remedy)
        if sessions.is_full:
            return _problem(503, "too many logs at a time", "send it again in a moment", _TRIES)
        user = f"api {request.client.host if request.client else ''}"  # behind a proxy, all are one user
        try:
            return _json(await sessions.assess(user, name, request.stream()))
        except ClientDisconnect:
            return Response(status_code=400)


def _add_store(app: FastAPI, fleet: Fleet) -> None:
    async def asked(question: Callable[[], Any]) -> Any:
        try:
            return await asyncio.to_thread(question)
        except MavhumsError as error:
            raise HTTPException(404, (error.problem, error.remedy)) from error  # type: ignore[arg-type]

    @app.get("/fleet/status", **_gives(StoreStatus))
    async def status() -> Response:
        """Say what the store holds, and what failed, as `mavhums fleet status --json` does."""
        return _json((await asked(fleet.status)).model_dump_json())

    @app.get("/fleet/worst", **_gives(list[LastFlightOf]))
    async def worst(most: Annotated[int, Query(ge=1, le=_MOST)] = 20) -> Response:
        """List the actuators of all aircraft, the worst first, as `mavhums fleet worst --json` does."""
        rows = await asked(lambda: fleet.worst(most))
        return _json(f"[{','.join(row.published().to_json() for row in rows)}]")

    @app.get("/fleet/trend", **_gives(TrendReport))
    async def trend(aircraft: _Aircraft) -> Response:
        """Return an aircraft's trends, as `mavhums fleet trend --json` does."""
        return _json((await asked(lambda: fleet.trend(aircraft))).to_json(indent=None))

    @app.get("/fleet/flights", **_gives(list[Assessment]))
    async def flights(aircraft: _Aircraft) -> Response:
        """List an aircraft's flights in time order, with their verdicts."""
        flown = await asked(lambda: fleet.flights(aircraft))
        return _json(f"[{','.join(flight.to_json(indent=None) for flight in flown)}]")

    @app.get("/fleet/flight", **_gives(Assessment))
    async def flight(
        aircraft: _Aircraft,
        log: Annotated[str, Query(description="SHA-256 of its log, as /api/fleet/flights has it.")],
    ) -> Response:
        """Return the whole assessment of a flight."""
        return _json((await asked(lambda: fleet.flight(aircraft, log))).to_json(indent=None))


def _answer_problems(app: FastAPI) -> None:
    """Answer every error with problem and remedy."""

    @app.exception_handler(MavhumsError)
    async def refused(_: Request, error: MavhumsError) -> Response:
        # the rest of a log that is refused on its way is not read
        return _problem(422, error.problem, error.remedy, {"connection": "close"})

    @app.exception_handler(RequestValidationError)
    async def wrong(_: Request, error: RequestValidationError) -> Response:
        said = "; ".join(f"{one['loc'][-1]}: {one['msg'].lower()}" for one in error.errors())
        return _problem(422, said, _ASK)

    @app.exception_handler(HTTPException)
    async def other(_: Request, error: HTTPException) -> Response:
        told: Any = error.detail
        return _problem(error.status_code, *(told if isinstance(told, tuple) else (str(told).lower(), _ASK)))


def _gives(model: type[BaseModel] | Any) -> dict[str, Any]:
    """Return how a route is described whose answer is written as JSON by its model."""
    return {"response_model": None, "responses": {200: {"model": model}}}


def _json(content: str | bytes) -> Response:
    return Response(content, media_type="application/json", headers={"cache-control": "no-store"})


def _problem(status: int, problem: str, remedy: str, headers: dict[str, str] | None = None) -> Response:
    return JSONResponse({"problem": problem, "remedy": remedy}, status, headers)
