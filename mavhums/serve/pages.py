"""The pages: drop a log, the fleet, an aircraft, live sessions."""

from __future__ import annotations

import asyncio
import json
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Final, NamedTuple
from urllib.parse import urlencode

from markupsafe import Markup
from nicegui import ui
from pydantic import TypeAdapter, ValidationError
from starlette.requests import Request

from mavhums.core.conditions import URGENCY
from mavhums.core.errors import MavhumsError, UnreadableLogError
from mavhums.core.packed import opened_file
from mavhums.results.live import (
    AlertObject,
    ConditionObject,
    EndObject,
    LiveObject,
    StartObject,
    StatusObject,
)
from mavhums.results.standing import TrendReport
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
from mavhums.serve.options import Fleet, ServeOptions
from mavhums.serve.sessions import Sessions
from mavhums.show.evidence import EvidenceCollector
from mavhums.show.html import parts
from mavhums.show.trend import headline

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
        where = (
            "nothing leaves it"
            if is_loopback(options.host) and options.public is None
            else "where mavhums runs"
        )
        Home(sessions, request.scope[SESSION], options.fleet, where)

    @ui.page("/trends", title="mavhums: trends over the dropped logs", response_timeout=_PATIENCE_S)
    async def trends_page(request: Request) -> None:
        begin("/")
        logs = list(sessions.get(request.scope[SESSION]).logs.values())
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
            problem = str(error)
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
            markup(render("aircraft.html", name=name, problem=str(error)))
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
            values["problem"] = str(error)
            markup(render("flight.html", **values))
            return
        shown = await asyncio.to_thread(parts, wanted, EvidenceCollector(), "h1")
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


_FIRST: Final = 1 << 16
_READ: Final = 1 << 20
_LINE: Final = 1 << 22
_CHANGES: Final = 12
_SILENT_S: Final = 5.0
_OBJECT: Final[TypeAdapter[LiveObject]] = TypeAdapter(LiveObject)


class Seen(NamedTuple):
    """A session as its file describes it.

    Attributes
    ----------
    note
        Why the state may not be the present one; empty while the session runs.
    changes
        The latest changes of conditions and alerts, the newest first.
    """

    name: str
    note: str
    start: StartObject | None
    status: StatusObject | None
    end: EndObject | None
    changes: tuple[ConditionObject | AlertObject, ...]


class LiveFile:
    """A session's file, read on as it grows; of a long one, only the beginning and the last MiB.

    Parameters
    ----------
    path
        The file; it may not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._forget()

    def _forget(self) -> None:
        self._at = 0
        self._rest = b""
        self._first = True
        self._start: StartObject | None = None
        self._status: StatusObject | None = None
        self._end: EndObject | None = None
        self._changes: list[ConditionObject | AlertObject] = []

    def seen(self) -> Seen:
        """Read what was added, and return the state."""
        note = ""
        try:
            status = self._path.stat()
            if status.st_size < self._at:
                self._forget()
            with opened_file(self._path) as file:
                self._read(file, status.st_size)
            silent_s = time.time() - status.st_mtime
            if self._end is None and silent_s > _SILENT_S:
                note = f"no line for {silent_s:,.0f} s: the session has stopped, or its output is not read"
        except OSError as error:
            note = f"cannot be read: {error.strerror}"
        except UnreadableLogError as error:
            note = f"{error.problem}: let the session write to a file: mavhums live --json > FILE"
        changes = tuple(reversed(self._changes))
        return Seen(self._path.name, note, self._start, self._status, self._end, changes)

    def _read(self, file: IO[bytes], size: int) -> None:
        if self._first and size:
            self._take(file.read(_FIRST).split(b"\n")[0])
            self._at = max(0, size - _READ)
            self._first = False
        file.seek(self._at)
        while self._at < size and (data := file.read(min(_READ, size - self._at))):
            self._at += len(data)
            *lines, self._rest = (self._rest + data).split(b"\n")
            self._rest = self._rest if len(self._rest) <= _LINE else b""
            for line in lines:
                self._take(line)

    def _take(self, line: bytes) -> None:
        """Take a line; one that is cut or of another format is skipped."""
        try:
            found = _OBJECT.validate_python(json.loads(line), strict=False)
        except (ValidationError, ValueError, RecursionError):
            return
        if isinstance(found, StartObject):
            self._start, self._end = found, None
        elif isinstance(found, StatusObject):
            self._status = found
        elif isinstance(found, EndObject):
            self._end = found
        elif isinstance(found, ConditionObject | AlertObject) and found not in self._changes:
            self._changes = [*self._changes, found][-_CHANGES:]
