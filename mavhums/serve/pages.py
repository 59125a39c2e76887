"""The pages: drop a log, the fleet, an aircraft, live sessions."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final
from urllib.parse import urlencode

from markupsafe import Markup
from nicegui import ui
from starlette.requests import Request

from mavhums.core.conditions import URGENCY
from mavhums.core.errors import MavhumsError
from mavhums.results.trend import TrendReport
from mavhums.serve.fleet_view import (
    FEWEST_FLIGHTS,
    AircraftLine,
    aircraft_lines,
    dropped_trends,
    flight_lines,
    trends_shown,
)
from mavhums.serve.guard import SESSION, is_loopback
from mavhums.serve.home import Home, markup, render, show_parts
from mavhums.serve.live_lines import LiveFile
from mavhums.serve.options import Fleet, ServeOptions
from mavhums.serve.sessions import Sessions
from mavhums.show.html import parts
from mavhums.show.html_curves import Gathered
from mavhums.show.trend import headline

__all__ = ["add_pages"]

_SUBJECTS: Final = 4000
_AIRCRAFT: Final = 300
_PATIENCE_S: Final = 120.0
_LIVE_S: Final = 1.0


def add_pages(sessions: Sessions, options: ServeOptions) -> None:
    """Add the pages to NiceGUI's application."""
    pages = [("Logs", "/")]
    pages += [("Fleet", "/fleet")] if options.fleet else []
    pages += [("Live", "/live")] if options.live else []

    def begin(here: str) -> None:
        ui.add_head_html(render("head.html"))
        if len(pages) > 1:
            markup(render("nav.html", pages=pages, here=here))

    @ui.page("/", title="mavhums: drop a log")
    def home(request: Request) -> None:
        begin("/")
        try:
            session = sessions.get(request.scope[SESSION])
        except MavhumsError as error:
            markup(render("problem.html", problem=f"{error.problem}: {error.remedy}"))
            return
        where = (
            "nothing leaves it"
            if is_loopback(options.host) and options.public is None
            else "where mavhums runs"
        )
        Home(sessions, session, options.fleet, where)

    @ui.page("/trends", title="mavhums: trends over the dropped logs", response_timeout=_PATIENCE_S)
    async def trends_page(request: Request) -> None:
        begin("/")
        try:
            logs = list(sessions.get(request.scope[SESSION]).logs.values())
        except MavhumsError as error:
            markup(render("problem.html", problem=f"{error.problem}: {error.remedy}"))
            return
        found, others = await asyncio.to_thread(dropped_trends, logs)
        aircraft = [
            {"board": board, "flights": flights, "headline": headline(report), "trends": _trends(report)}
            for board, flights, report in found
        ]
        markup(render("dropped_trends.html", aircraft=aircraft, others=others, fewest=FEWEST_FLIGHTS))

    if options.fleet:
        _add_fleet(options.fleet, begin)
    if options.live:
        _add_live(options.live, begin)


def _trends(report: TrendReport) -> Markup:
    """Return the curves of trends whose points open nothing."""
    return Markup(render("_trends.html", trends=trends_shown(report, {}), report=report, flights=()))


def _add_fleet(fleet: Fleet, begin: Callable[[str], None]) -> None:
    @ui.page("/fleet", title="mavhums: the fleet", response_timeout=_PATIENCE_S)
    async def fleet_page() -> None:
        begin("/fleet")
        lines: list[AircraftLine] = []
        problem = ""
        try:
            lines = aircraft_lines(await asyncio.to_thread(fleet.worst, _SUBJECTS))
        except MavhumsError as error:
            problem = f"{error.problem}: {error.remedy}"
        tally = Counter((line.condition, line.word) for line in lines)
        order = sorted(tally.items(), key=lambda one: -URGENCY[one[0][0]])
        more = len(lines) > _AIRCRAFT
        markup(render("fleet.html", lines=lines[:_AIRCRAFT], tally=order, problem=problem, more=more))

    @ui.page("/fleet/aircraft", title="mavhums: an aircraft", response_timeout=_PATIENCE_S)
    async def aircraft_page(name: str = "") -> None:
        begin("/fleet")
        try:
            report = await asyncio.to_thread(fleet.trend, name)
            flights = await asyncio.to_thread(fleet.flights, name)
        except MavhumsError as error:
            markup(render("aircraft.html", name=name, problem=f"{error.problem}: {error.remedy}"))
            return
        lines = flight_lines(name, flights)
        values = {
            "report": report,
            "headline": headline(report),
            "trends": trends_shown(report, {line.start_utc: line.address for line in lines}),
            "flights": lines,
            "query": urlencode({"aircraft": name}),
        }
        markup(render("aircraft.html", name=name, problem="", **values))

    @ui.page("/fleet/flight", title="mavhums: a flight", response_timeout=_PATIENCE_S)
    async def flight_page(aircraft: str = "", log: str = "") -> None:
        begin("/fleet")
        query = urlencode({"aircraft": aircraft, "log": log})
        values = {"name": aircraft, "back": urlencode({"name": aircraft}), "query": query, "problem": ""}
        try:
            wanted = await asyncio.to_thread(fleet.flight, aircraft, log)
        except MavhumsError as error:
            values["problem"] = f"{error.problem}: {error.remedy}"
            markup(render("flight.html", **values))
            return
        shown = await asyncio.to_thread(parts, wanted, Gathered(), "h1")
        markup(render("flight.html", **values))
        show_parts(shown, f"/fleet/curves?{query}")


def _add_live(paths: Sequence[Path], begin: Callable[[str], None]) -> None:
    @ui.page("/live", title="mavhums: live sessions")
    def live_page() -> None:
        begin("/live")
        markup("Live sessions", "h1")
        files = [LiveFile(path) for path in paths]
        place = markup("")

        async def look() -> None:
            seen = await asyncio.to_thread(lambda: [file.seen() for file in files])
            place.set_content(render("live.html", sessions=seen))

        ui.timer(_LIVE_S, look)
