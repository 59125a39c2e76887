"""What the pages show of aircraft: a fleet's, worst first, one aircraft's flights, trends of dropped logs."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Final, NamedTuple
from urllib.parse import urlencode

from markupsafe import Markup, escape

from mavhums.core.conditions import SEVERITY, URGENCY
from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import board_of
from mavhums.flights.history import PastFlight
from mavhums.flights.trends import trend_report
from mavhums.results.assessment import Assessment
from mavhums.results.standing import TrendReport
from mavhums.results.store import LastFlightOf
from mavhums.serve.sessions import Dropped
from mavhums.show.blocks import Cell, Column, Link, Mark, Part, Table
from mavhums.show.headline import headline
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


def aircraft_table(rows: Iterable[LastFlightOf]) -> Table:
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
    return Table("", columns, [_aircraft(several) for several in groups.values()])


def _aircraft(rows: Sequence[LastFlightOf]) -> list[Cell]:
    first = rows[0]
    found = [_mark(row) for row in rows]
    marks = sorted(dict.fromkeys(found), key=lambda mark: URGENCY[mark.condition], reverse=True)
    verdict, file = first.verdict, PurePath(first.log).name
    subject = subject_of(verdict.subject, verdict.actuator)
    well = SEVERITY[found[0].condition] == SEVERITY["normal"]
    address = f"/fleet/aircraft?{urlencode({'name': first.aircraft})}" if first.aircraft else ""
    return [
        [Link(first.aircraft or f"unknown aircraft ({file})", address)],
        [found[0]],
        "" if well else ": ".join(filter(None, (subject, found_in(verdict, first.standing)))),
        ", ".join(f"{found.count(mark)} {mark.word or mark.condition}" for mark in marks),
        _date(first.start_utc),
    ]


def tally(shown: Table) -> list[tuple[Mark, int]]:
    """Return how many rows have which condition in the second column, the gravest first."""
    counts = Counter(cell[0] for _, cell, *_ in shown.rows if isinstance(cell[0], Mark))
    return sorted(counts.items(), key=lambda item: -URGENCY[item[0].condition])


def _mark(row: LastFlightOf) -> Mark:
    return mark_of(row.standing) if row.standing is not None else Mark(row.verdict.gravest)


def _date(start_utc: str | None) -> str:
    return f"{start_utc[:10]} {start_utc[11:16]} UTC" if start_utc else "date not known"


def flight_pages(aircraft: str, flights: Iterable[Assessment]) -> dict[str, str]:
    """Return the address of each flight's page, by its start."""
    return {one.log.start_utc or "": _address(aircraft, one) for one in flights}


def flight_table(aircraft: str, flights: Sequence[Assessment]) -> Table:
    """Return a row per flight, the latest first."""
    rows = [_flight(aircraft, one) for one in reversed(flights)]
    columns = [Column("flight"), Column("condition", "word"), Column("finding"), Column("log")]
    return Table("Flights", columns, rows)


def _flight(aircraft: str, flight: Assessment) -> list[Cell]:
    brief, when = headline(flight), _date(flight.log.start_utc)
    mark: list[Part] = [brief.mark] if brief.mark else []
    return [[Link(when, _address(aircraft, flight))], mark, brief.text, PurePath(flight.log.path or "").name]


def _address(aircraft: str, flight: Assessment) -> str:
    return f"/fleet/flight?{urlencode({'aircraft': aircraft, 'log': flight.log.sha256 or ''})}"


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
    marks: dict[str, Mark] = {}
    stands = {(one.vehicle, one.actuator): one for one in report.standings}
    for one in report.trends:
        shown = trend_shown(one, f"{one.vehicle}: " if several else "", report.repairs)
        found.setdefault(shown.actuator, []).append(shown)
        standing = stands.get((one.vehicle, one.actuator))
        marks[shown.actuator] = mark_of(standing) if standing else Mark(one.condition)
    several_shown = []
    for name, trends in found.items():
        first = [one for one in trends if one.first]
        if not first and SEVERITY[marks[name].condition] > 0:
            first = trends  # whoever reads that something is wrong sees what there is
        others = [one for one in trends if one not in first]
        curves = _curves(first, addresses), _curves(others, addresses)
        several_shown.append(ActuatorView(name, marks[name], first, others, *curves))
    return several_shown


def _curves(trends: Iterable[TrendView], addresses: Mapping[str, str]) -> Markup:
    """Return trends as JSON that can stand in an attribute; each point knows its flight's page."""
    charts = [
        one.chart | {"links": [addresses.get(start, "") for start in one.chart["starts"]]} for one in trends
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
