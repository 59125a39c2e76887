"""What the pages show of aircraft: a fleet's, worst first, one aircraft's flights, trends of dropped logs."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import PurePath
from typing import Final, NamedTuple
from urllib.parse import urlencode

from markupsafe import Markup, escape

from mavhums.core.conditions import SEVERITY, URGENCY, Condition
from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import board_of
from mavhums.flights.history import FlightHistory, PastFlight
from mavhums.flights.trends import trend_report
from mavhums.results.assessment import Assessment
from mavhums.results.standing import TrendReport
from mavhums.serve.options import LastVerdict
from mavhums.serve.sessions import Dropped
from mavhums.show.html import in_brief
from mavhums.show.standing import mark_of, sentences
from mavhums.show.trend import TrendView, trend_shown

FEWEST_FLIGHTS: Final = 3
"""Of one aircraft: two points are no trend."""


class AircraftLine(NamedTuple):
    """An aircraft in the fleet's list: its worst subject, and how many of it are in which condition.

    ``word`` is what the list calls the condition; what grows is not called normal.
    """

    name: str
    address: str
    condition: Condition
    word: str
    worst: str
    detail: str
    last_flight: str
    counts: tuple[tuple[str, int], ...]


class FlightLine(NamedTuple):
    """A flight in an aircraft's list."""

    start: str
    start_utc: str
    log: str
    address: str
    condition: Condition
    headline: str


class ActuatorView(NamedTuple):
    """An actuator or axis on an aircraft's page: the trends to see first, and the others.

    ``curves`` and ``more`` are their curves as JSON for the browser.
    """

    name: str
    condition: Condition
    word: str
    first: list[TrendView]
    others: list[TrendView]
    curves: Markup
    more: Markup


def aircraft_lines(rows: Iterable[LastVerdict]) -> list[AircraftLine]:
    """Return a line per aircraft; the rows come worst first, and so do the lines."""
    groups: dict[tuple[str, str], list[LastVerdict]] = {}
    for row in rows:
        groups.setdefault((row.aircraft, "" if row.aircraft else row.path), []).append(row)
    return [_aircraft(several) for several in groups.values()]


def _aircraft(rows: Sequence[LastVerdict]) -> AircraftLine:
    first = rows[0]
    found = [_mark(row) for row in rows]
    marks = sorted(dict.fromkeys(found), key=lambda one: URGENCY[one[0]], reverse=True)
    condition, word = found[0]
    verdict, file = first.verdict, PurePath(first.path).name
    subject = f"{verdict.actuator} control" if verdict.subject == "axis" else verdict.actuator
    well = SEVERITY[condition] == SEVERITY["normal"]
    return AircraftLine(
        name=first.aircraft or f"unknown aircraft ({file})",
        address=f"/fleet/aircraft?{urlencode({'name': first.aircraft})}" if first.aircraft else "",
        condition=condition,
        word=word,
        worst="" if well else subject,
        detail="" if well else _detail(first),
        last_flight=_date(first.start_us),
        counts=tuple((one[1], found.count(one)) for one in marks),
    )


def _mark(row: LastVerdict) -> tuple[Condition, str]:
    if row.standing is not None:
        return mark_of(row.standing)
    return row.verdict.gravest, row.verdict.gravest


def _detail(row: LastVerdict) -> str:
    standing, verdict = row.standing, row.verdict
    if standing is not None and standing.is_finding:
        return "; ".join(sentences(standing))
    return ", ".join(one.fault.replace("_", " ") for one in verdict.suspects) or verdict.reason or ""


def _date(start_us: int | None) -> str:
    if start_us is None:
        return "date not known"
    return datetime.fromtimestamp(start_us / 1e6, tz=UTC).strftime("%Y-%m-%d %H:%M UTC")


def flight_lines(aircraft: str, flights: Iterable[Assessment]) -> list[FlightLine]:
    """Return a line per flight, the latest first."""
    return [_flight(aircraft, one) for one in reversed(list(flights))]


def _flight(aircraft: str, flight: Assessment) -> FlightLine:
    brief = in_brief(flight)
    start = flight.log.start_utc
    return FlightLine(
        start=f"{start[:10]} {start[11:16]} UTC" if start else "date not known",
        start_utc=start or "",
        log=PurePath(flight.log.path or "").name,
        address=f"/fleet/flight?{urlencode({'aircraft': aircraft, 'log': flight.log.sha256 or ''})}",
        condition=brief.condition,
        headline=brief.headline,
    )


def trends_shown(report: TrendReport, addresses: Mapping[str, str]) -> list[ActuatorView]:
    """Return each actuator's trends with their curves, the worst first.

    Parameters
    ----------
    report
        Of one aircraft.
    addresses
        Of the flights' pages, by the start of the flight.
    """
    several = len({one.vehicle for one in report.trends}) > 1
    found: dict[str, list[TrendView]] = {}
    marks: dict[str, tuple[Condition, str]] = {}
    stands = {(one.vehicle, one.actuator): one for one in report.standings}
    for one in report.trends:
        shown = trend_shown(one, f"{one.vehicle}: " if several else "", report.repairs)
        found.setdefault(shown.actuator, []).append(shown)
        standing = stands.get((one.vehicle, one.actuator))
        marks[shown.actuator] = mark_of(standing) if standing else (one.condition, one.condition)
    several_shown = []
    for name, trends in found.items():
        first, others = [one for one in trends if one.first], [one for one in trends if not one.first]
        curves = _curves(first, addresses), _curves(others, addresses)
        several_shown.append(ActuatorView(name, *marks[name], first, others, *curves))
    return several_shown


def _curves(trends: Iterable[TrendView], addresses: Mapping[str, str]) -> Markup:
    """Return trends as JSON that can stand in an attribute; each point knows its flight's page."""
    charts = [
        one.chart | {"life": one.life, "links": [addresses.get(start, "") for start in one.chart["starts"]]}
        for one in trends
    ]
    return escape(json.dumps({"charts": charts}))


class AircraftTrend(NamedTuple):
    """The flights of an aircraft among the dropped logs."""

    board: str
    flights: int
    report: TrendReport


def dropped_trends(logs: Iterable[Dropped]) -> tuple[list[AircraftTrend], int]:
    """Return the trends of each aircraft, and how many of the judged logs are of none of these.

    An aircraft is known by its board: a log that reports no board, or no date, is of none.
    """
    several: dict[str, list[PastFlight]] = defaultdict(list)
    judged = 0
    for log in logs:
        if log.state != "done":
            continue
        judged += 1
        try:
            assessment = Assessment.model_validate_json(log.assessment.read_bytes())
            if board := board_of(assessment):
                several[board].append(PastFlight.of(assessment))
        except (OSError, ValueError, MavhumsError):  # removed by now, or without a date
            continue
    found = []
    for board, flights in sorted(several.items()):
        history = FlightHistory(tuple(flights), name=f"board {board}")
        if len(history.flights) >= FEWEST_FLIGHTS:
            found.append(AircraftTrend(board, len(history.flights), trend_report(history)))
    return found, judged - sum(one.flights for one in found)
