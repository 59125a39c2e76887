"""The pages: drop a log, its answer, the fleet, an aircraft, live sessions; each is HTML from a template."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlencode

from fastapi import FastAPI
from markupsafe import Markup
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from mavhums.app.settings import Options
from mavhums.core.conditions import URGENCY
from mavhums.core.errors import MavhumsError
from mavhums.core.packed import ARCHIVES, COMPRESSED
from mavhums.flights.aircraft import UnnamedAircraftError
from mavhums.results.standing import TrendReport
from mavhums.serve.guard import SESSION, is_loopback
from mavhums.serve.routes import LogOf
from mavhums.serve.sessions import Dropped, ServeOptions, Sessions, UserSession
from mavhums.serve.uploads import keep
from mavhums.serve.views import (
    FEWEST_FLIGHTS,
    LiveFile,
    aircraft_table,
    dropped_trends,
    flight_pages,
    flight_table,
    tally,
    trends_shown,
)
from mavhums.show.curves import EvidenceCollector
from mavhums.show.html import draw, environment, parts
from mavhums.show.trend import trend_blocks

_SUBJECTS: Final = 4000
_AIRCRAFT: Final = 300
_FLIGHTS: Final = 300
_FEW: Final = 3  # logs with all their buttons, above an answer
_BUSY_MS, _QUIET_MS = 300, 1000
"""Time after which an open page asks for the list of logs again: while something is judged, and else."""

Page = Callable[..., Response]


def render(template: str, **values: object) -> str:
    """Return a template of this room with its values; every text in it is escaped."""
    return environment("mavhums.serve").get_template(template).render(**values)


def add_pages(app: FastAPI, sessions: Sessions, options: ServeOptions, log_of: LogOf) -> None:
    """Add the pages to an application.

    Parameters
    ----------
    app
        The application.
    sessions
        The dropped logs.
    options
        Store and live files, without which their pages are absent.
    log_of
        Returns the log of a request, of which a part was made.
    """
    pages = [("Logs", "/")]
    pages += [("Fleet", "/fleet")] if options.store else []
    pages += [("Live", "/live")] if options.live else []

    def page(template: str, title: str, here: str, **values: object) -> Response:
        return HTMLResponse(render(template, title=title, here=here, pages=pages, **values))

    alone = is_loopback(options.host) and options.public is None
    where = "nothing leaves it" if alone else "where mavhums runs"
    limit = sessions.limits.log_bytes
    limits = {"limit_bytes": limit, "limit_mb": f"{limit // 1_000_000:,}", "packed": (*COMPRESSED, *ARCHIVES)}

    @app.get("/")
    def home() -> Response:
        return page("home.html", "drop a log", "/", where=where, **limits)

    @app.get("/trends")
    async def trends_page(request: Request) -> Response:
        logs = list(_session(sessions, request).logs.values())
        found, others = await asyncio.to_thread(dropped_trends, logs)
        aircraft = [
            {"board": board, "flights": flights, "trends": trends(report, {})}
            for board, flights, report in found
        ]
        values = {"aircraft": aircraft, "others": others, "fewest": FEWEST_FLIGHTS}
        return page("dropped_trends.html", "trends over the dropped logs", "/", **values)

    _add_logs(app, sessions, options, log_of)
    if options.store:
        _add_fleet(app, options.store, page)
    if options.live:
        _add_live(app, options.live, page)


def _session(sessions: Sessions, request: Request) -> UserSession:
    return sessions.get(request.scope[SESSION])


def _add_logs(app: FastAPI, sessions: Sessions, options: ServeOptions, log_of: LogOf) -> None:
    """Add the parts of the first page that change: the list of logs, and the answer or the view of one."""

    @app.get("/logs")
    def logs(request: Request, log: str = "", shown: str = "", beside: str = "") -> Response:
        session = _session(sessions, request)
        session.touch()
        below = {"shown_id": log, "shown": shown, "beside": beside, "keeps": options.store is not None}
        return HTMLResponse(render("logs.html", **_log_list(session), **below))

    @app.get("/logs/{log_id}/answer")
    def answer(request: Request, log_id: str) -> Response:
        log = log_of(request, log_id, "shown")
        return HTMLResponse(render("answer.html", log=log, parts=json.loads(log.shown.read_bytes())))

    @app.get("/logs/{log_id}/view")
    async def view(request: Request, log_id: str) -> Response:
        log = log_of(request, log_id, "assessment")
        if not log.recording:
            sessions.record(_session(sessions, request), log)
        recording = f"{str(request.base_url).rstrip('/')}/logs/{log.id}/flight.rrd"
        query = urlencode({"url": recording, "hide_welcome_screen": 1, "persist": 0})
        failed = log.recording not in ("making", "ready")
        return HTMLResponse(render("view.html", log=log, query=query), status_code=409 if failed else 200)

    @app.post("/logs/{log_id}/remove")
    async def remove(request: Request, log_id: str) -> Response:
        sessions.remove(_session(sessions, request), log_of(request, log_id, "path"))
        return Response(status_code=204)

    if options.store is not None:

        @app.post("/logs/{log_id}/keep")
        async def keep_log(request: Request, log_id: str, aircraft: str = "") -> Response:
            await _keep(options.judging, log_of(request, log_id, "assessment"), aircraft.strip() or None)
            return Response(status_code=204)


def _log_list(session: UserSession) -> dict[str, Any]:
    """Return what the list of a session's logs shows, the worst first."""
    logs = sorted(session.logs.values(), key=_rank)
    done = [log for log in logs if log.state == "done"]
    several = Counter(log.condition for log in done)
    return {
        "logs": logs,
        "worst": done[0].id if done else "",
        "tally": sorted(several.items(), key=lambda one: -URGENCY[one[0]]),
        "rest": len(logs) - len(done),
        "trends": len(done) >= FEWEST_FLIGHTS,
        "few": _FEW,
        "every_ms": _BUSY_MS if any(log.is_busy for log in logs) else _QUIET_MS,
    }


def _rank(log: Dropped) -> int:
    """Return what sorts the worst first: what was judged, what could not be, what is not yet."""
    return {"done": -URGENCY[log.condition], "failed": 100}.get(log.state, 101)


async def _keep(judging: Options, log: Dropped, aircraft: str | None) -> None:
    """Keep a log in the store; where the store cannot identify its aircraft, the list asks the user."""
    log.kept, log.asked = "being kept in the store, after any scan that runs …", None
    try:
        log.kept = await asyncio.to_thread(keep, judging, log.path, aircraft)
    except UnnamedAircraftError as error:
        log.kept, log.asked = error.problem, error.proposed
    except MavhumsError as error:
        log.kept = f"not kept: {error}"


def trends(report: TrendReport, addresses: Mapping[str, str]) -> Markup:
    """Return what is said of an aircraft's trends, and their curves, whose points open the flights' pages."""
    said, shown = Markup(draw(trend_blocks(report), "h2")), trends_shown(report, [*addresses])
    return Markup(render("_trends.html", said=said, trends=shown, pages=[*addresses.values()]))


def _add_fleet(app: FastAPI, store: str, page: Page) -> None:
    from mavhums.flights import queries, reports

    @app.get("/fleet")
    def fleet_page() -> Response:
        aircraft, problem = aircraft_table(()), ""
        try:
            aircraft = aircraft_table(queries.worst(store, most=_SUBJECTS))
        except MavhumsError as error:
            problem = str(error)
        shown = aircraft._replace(rows=aircraft.rows[:_AIRCRAFT])
        values = {"aircraft": shown, "tally": tally(aircraft), "more": len(aircraft.rows) > _AIRCRAFT}
        return page("fleet.html", "the fleet", "/fleet", problem=problem, **values)

    @app.get("/fleet/aircraft")
    def aircraft_page(name: str = "") -> Response:
        values: dict[str, Any] = {"name": name, "problem": ""}
        try:
            report, flown = reports.trend_and_flights(store, name)
            flights = queries.flights(store, name, most=_FLIGHTS)
        except MavhumsError as error:
            values["problem"] = str(error)
        else:
            values |= {
                "trends": trends(report, flight_pages(name, flown)),
                "flights": flight_table(name, flights),
                "more": len(flown) > len(flights),
                "query": urlencode({"aircraft": name}),
            }
        return page("aircraft.html", "an aircraft", "/fleet", **values)

    @app.get("/fleet/flight")
    def flight_page(aircraft: str = "", log: str = "") -> Response:
        query = urlencode({"aircraft": aircraft, "log": log})
        values: dict[str, Any] = {"name": aircraft, "back": urlencode({"name": aircraft}), "query": query}
        try:
            flight = queries.flight(store, aircraft, log)
            values |= {"parts": parts(flight, EvidenceCollector(), "h1"), "problem": ""}
        except MavhumsError as error:
            values["problem"] = str(error)
        return page("flight.html", "a flight", "/fleet", **values)


def _add_live(app: FastAPI, paths: Sequence[Path], page: Page) -> None:
    files = [LiveFile(path) for path in paths]

    @app.get("/live")
    async def live_page() -> Response:
        return page("live.html", "live sessions", "/live", sessions=Markup(await _seen(files)))

    @app.get("/live/now")
    async def live_now() -> Response:
        return HTMLResponse(await _seen(files))

    lock = asyncio.Lock()  # two pages read the same files

    async def _seen(files: Sequence[LiveFile]) -> str:
        async with lock:
            seen = await asyncio.to_thread(lambda: [file.seen().blocks() for file in files])
        return "".join(draw(blocks, "h2") for blocks in seen)
