"""What the pages show: a fleet's aircraft, worst first, their flights and trends, and sessions in flight."""

from __future__ import annotations

import json
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePath
from typing import IO, Final, NamedTuple, Self
from urllib.parse import urlencode

from markupsafe import Markup, escape
from pydantic import TypeAdapter, ValidationError

from mavhums.core.conditions import SEVERITY, URGENCY
from mavhums.core.errors import MavhumsError, UnreadableLogError
from mavhums.core.packed import opened_file
from mavhums.flights.aircraft import board_of
from mavhums.flights.history import PastFlight
from mavhums.flights.trends import trend_report
from mavhums.results.assessment import Assessment
from mavhums.results.live import (
    AlertObject,
    ConditionObject,
    EndObject,
    LiveObject,
    StartObject,
    StatusObject,
)
from mavhums.results.standing import LastFlightOf, TrendReport
from mavhums.serve.sessions import Dropped
from mavhums.show.blocks import Anchor, Block, Cell, Column, Headline, Listing, Mark, Note, Part, TableBlock
from mavhums.show.headline import headline
from mavhums.show.now import latest_line, status_blocks
from mavhums.show.standing import found_in, mark_of
from mavhums.show.trend import TrendView, trend_shown
from mavhums.show.words import subject_of

FEWEST_FLIGHTS: Final = 3
"""Of one aircraft: two points are no trend."""


class ActuatorView(NamedTuple):
    """An actuator or axis on an aircraft's page: the trends to see first, and the others.

    ``curves`` and ``more`` are their curves as JSON for the browser.
    """

    name: str
    mark: Mark
    first: list[TrendView]
    others: list[TrendView]
    curves: Markup
    more: Markup


def aircraft_table(rows: Iterable[LastFlightOf]) -> TableBlock:
    """Return a row per aircraft; the verdicts come worst first, and so do the aircraft."""
    groups: dict[tuple[str | None, str], list[LastFlightOf]] = {}
    for row in rows:
        groups.setdefault((row.aircraft, "" if row.aircraft else row.log), []).append(row)
    columns = [
        Column("aircraft"),
        Column("condition", "word"),
        Column("worst finding"),
        Column("actuators and axes"),
        Column("last flight", "figure"),
    ]
    return TableBlock("", columns, [_aircraft(several) for several in groups.values()])


def _aircraft(rows: Sequence[LastFlightOf]) -> list[Cell]:
    first = rows[0]
    found = [_mark(row) for row in rows]
    marks = sorted(dict.fromkeys(found), key=lambda mark: URGENCY[mark.condition], reverse=True)
    verdict, file = first.verdict, PurePath(first.log).name
    subject = subject_of(verdict.subject, verdict.actuator)
    well = SEVERITY[found[0].condition] == SEVERITY["normal"]
    address = f"/fleet/aircraft?{urlencode({'name': first.aircraft})}" if first.aircraft else ""
    return [
        [Anchor(first.aircraft or f"unknown aircraft ({file})", address)],
        [found[0]],
        "" if well else ": ".join(filter(None, (subject, found_in(verdict, first.standing)))),
        ", ".join(f"{found.count(mark)} {mark.word or mark.condition}" for mark in marks),
        _date(first.start_utc),
    ]


def tally(shown: TableBlock) -> list[tuple[Mark, int]]:
    """Return how many rows have which condition in the second column, the gravest first."""
    counts = Counter(cell[0] for _, cell, *_ in shown.rows if isinstance(cell[0], Mark))
    return sorted(counts.items(), key=lambda item: -URGENCY[item[0].condition])


def _mark(row: LastFlightOf) -> Mark:
    return mark_of(row.standing) if row.standing is not None else Mark(row.verdict.gravest)


def _date(start_utc: str | None) -> str:
    return f"{start_utc[:10]} {start_utc[11:16]} UTC" if start_utc else "date not known"


def flight_pages(aircraft: str, flights: Iterable[PastFlight]) -> dict[str, str]:
    """Return the address of each flight's page, by its start."""
    return {one.start.isoformat(): _address(aircraft, one.sha256) for one in flights}


def flight_table(aircraft: str, flights: Sequence[Assessment]) -> TableBlock:
    """Return a row per flight, the latest first."""
    rows = [_flight(aircraft, one) for one in reversed(flights)]
    columns = [Column("flight"), Column("condition", "word"), Column("finding"), Column("log")]
    return TableBlock("Flights", columns, rows)


def _flight(aircraft: str, flight: Assessment) -> list[Cell]:
    brief, when = headline(flight), _date(flight.log.start_utc)
    mark: list[Part] = [brief.mark] if brief.mark else []
    return [
        [Anchor(when, _address(aircraft, flight.log.sha256))],
        mark,
        brief.text,
        PurePath(flight.log.path or "").name,
    ]


def _address(aircraft: str, sha256: str | None) -> str:
    return f"/fleet/flight?{urlencode({'aircraft': aircraft, 'log': sha256 or ''})}"


def trends_shown(report: TrendReport, starts: Iterable[str]) -> list[ActuatorView]:
    """Return each actuator's trends with their curves, the worst first.

    Parameters
    ----------
    report
        Of one aircraft.
    starts
        Of the flights that have pages, to whose places the points of the curves link.
    """
    places = {start: place for place, start in enumerate(starts)}
    several = len({one.vehicle for one in report.trends}) > 1
    found: dict[str, list[TrendView]] = {}
    marks: dict[str, Mark] = {}
    states = {(one.vehicle, one.actuator): one for one in report.standings}
    for one in report.trends:
        shown = trend_shown(one, f"{one.vehicle}: " if several else "", report.repairs)
        shown.chart["links"] = [*map(places.get, one.points.start_utc)]
        found.setdefault(shown.actuator, []).append(shown)
        standing = states.get((one.vehicle, one.actuator))
        marks[shown.actuator] = mark_of(standing) if standing else Mark(one.condition)
    several_shown = []
    for name, trends in found.items():
        first = [one for one in trends if one.first]
        if not first and SEVERITY[marks[name].condition] > 0:
            first = trends  # whoever reads that something is wrong sees what there is
        others = [one for one in trends if one not in first]
        curves = _curves(first), _curves(others)
        several_shown.append(ActuatorView(name, marks[name], first, others, *curves))
    return several_shown


def _curves(trends: Iterable[TrendView]) -> Markup:
    """Return trends as JSON for an attribute."""
    return escape(json.dumps({"charts": [one.chart for one in trends]}))


class AircraftTrend(NamedTuple):
    """The flights of an aircraft among the dropped logs."""

    board: str
    flights: int
    report: TrendReport


def dropped_trends(logs: Iterable[Dropped]) -> tuple[list[AircraftTrend], int]:
    """Return the trends of each aircraft, and how many of the judged logs are of none of these.

    An aircraft is known by its board: a log that reports no board, or no date, is of none.
    """
    several: dict[str, dict[str, PastFlight]] = defaultdict(dict)
    judged = 0
    for log in logs:
        if log.state != "done":
            continue
        judged += 1
        try:
            assessment = Assessment.model_validate_json(log.assessment.read_bytes())
            if board := board_of(assessment):
                flight = PastFlight.of(assessment)
                several[board][flight.log] = flight
        except (OSError, ValueError, MavhumsError):  # removed by now, or without a date
            continue
    found = []
    for board, flights in sorted(several.items()):
        if len(flights) >= FEWEST_FLIGHTS:
            found.append(AircraftTrend(board, len(flights), trend_report(flights.values())))
    return found, judged - sum(one.flights for one in found)


_FIRST: Final = 1 << 16
_READ: Final = 1 << 20
_LINE: Final = 1 << 22
_CHANGES: Final = 12
_SILENT_S: Final = 5.0
_OBJECT: Final[TypeAdapter[LiveObject]] = TypeAdapter(LiveObject)


class LiveFile:
    """A session's file, read on as it grows; of a long one, only the beginning and the last MiB.

    Parameters
    ----------
    path
        The file; it may not exist yet.

    Attributes
    ----------
    note
        Why the state may not be the present one; empty while the session runs.
    start, status, end
        The latest objects of these kinds; None before any.
    changes
        The latest changes of conditions and alerts, the newest first.
    """

    def __init__(self, path: Path) -> None:
        self.note = ""
        self._path = path
        self._forget()

    def _forget(self) -> None:
        self._at = 0
        self._rest = b""
        self._first = True
        self.start: StartObject | None = None
        self.status: StatusObject | None = None
        self.end: EndObject | None = None
        self.changes: tuple[ConditionObject | AlertObject, ...] = ()

    def seen(self) -> Self:
        """Read what was added, and return the session as it is now."""
        self.note = ""
        try:
            status = self._path.stat()
            if status.st_size < self._at:
                self._forget()
            with opened_file(self._path) as file:
                self._read(file, status.st_size)
            silent_s = time.time() - status.st_mtime
            if self.end is None and silent_s > _SILENT_S:
                self.note = (
                    f"no line for {silent_s:,.0f} s: the session has stopped, or its output is not read"
                )
        except OSError as error:
            self.note = f"cannot be read: {error.strerror}"
        except UnreadableLogError as error:
            self.note = f"{error.problem}: let the session write to a file: mavhums live --json > FILE"
        return self

    def blocks(self) -> list[Block]:
        """Return what is shown of the session."""
        state = " (ended)" if self.end else " (running)" if self.status and not self.note else ""
        title, start = f"{self._path.name}{state}", self.start
        shown = status_blocks(self.status, title) if self.status else [Headline(title)]
        about = []
        if start:
            facts = [", ".join(start.links), start.airframe, start.record and f"recorded to {start.record}"]
            about = [Note([" · ".join(filter(None, facts))], quiet=True)]
        notes = [Note([self.note or "No state yet."])] if self.note or not self.status else []
        changes = [Listing("Latest changes", [*map(latest_line, self.changes)])] if self.changes else []
        return [shown[0], *notes, *about, *shown[1:], *changes]

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
            self.start, self.end = found, None
        elif isinstance(found, StatusObject):
            self.status = found
        elif isinstance(found, EndObject):
            self.end = found
        elif isinstance(found, ConditionObject | AlertObject) and found not in self.changes:
            self.changes = (found, *self.changes)[:_CHANGES]
