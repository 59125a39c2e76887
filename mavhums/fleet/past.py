"""The second pass: compares each aircraft's flights with its earlier ones, in time order, without a log."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime

from mavhums.core.conditions import URGENCY
from mavhums.fleet.aircraft import UNKNOWN
from mavhums.fleet.store import Store
from mavhums.health.baseline import Baselines
from mavhums.health.own.past import PastRecord
from mavhums.history.comparison import LoneFlight, compared, unpacked
from mavhums.history.flights import REFERENCE_FLIGHTS, FlightHistory, PastFlight, is_healthy
from mavhums.report.assessment import Assessment

__all__ = ["hold_against_past", "in_order", "rows_of"]


def hold_against_past(store: Store, aircraft: str) -> None:
    """Judge all flights of an aircraft by its past, and commit the verdicts."""
    flights = (unpacked(data) for data in _stored(store, aircraft))
    held = (flight.assessment for flight in flights) if aircraft == UNKNOWN else in_order(flights)
    store.replace_verdicts(aircraft, [row for assessment in held for row in rows_of(aircraft, assessment)])


def in_order(flights: Iterable[LoneFlight]) -> Iterator[Assessment]:
    """Yield the assessments of one aircraft's flights, given in time order, compared with their past."""
    known = _Known()
    for flight in flights:
        assessment = compared(flight, known.baselines, known.past)
        yield assessment
        if assessment.log.start_utc is not None:
            known.add(PastFlight.of(assessment))


class _Known:
    """The flights so far: those that can still be references, and the own-scale data of all."""

    def __init__(self) -> None:
        self._references: list[PastFlight] = []
        self._ends: dict[tuple[object, ...], list[datetime]] = defaultdict(list)
        self._slim: list[PastFlight] = []

    def baselines(self, airframe: str | None, before: datetime | None) -> Baselines:
        return FlightHistory(tuple(self._references)).baselines(airframe, before)

    def past(
        self, airframe: str | None, before: datetime | None
    ) -> Mapping[tuple[int, str], Sequence[PastRecord]]:
        return FlightHistory(tuple(self._slim)).past(airframe, before)

    def add(self, flown: PastFlight) -> None:
        ends = (self._ends[key] for key in _shown(flown.assessment))
        wanted = [
            several for several in ends if sum(end <= flown.start for end in several) < REFERENCE_FLIGHTS
        ]
        if wanted:
            self._references.append(flown)
        for several in wanted:
            several.append(flown.end)
        self._slim.append(replace(flown, assessment=_slim(flown.assessment)))


def _slim(assessment: Assessment) -> Assessment:
    """Return an assessment with only the data that the own-scale equations need from it."""
    nothing: dict[str, object] = {"evidence": (), "indicators": (), "provenance": {}}
    slim = tuple(verdict.model_copy(update=nothing) for verdict in assessment.verdicts)
    return assessment.model_copy(update={"verdicts": slim})


def rows_of(aircraft: str, assessment: Assessment) -> Iterator[dict[str, object]]:
    """Yield a row of the store for each verdict."""
    log = assessment.log
    start_us = None
    if log.start_utc is not None:
        start_us = round(datetime.fromisoformat(log.start_utc).timestamp() * 1e6)
    for verdict in assessment.verdicts:
        yield {
            "aircraft": aircraft,
            "path": log.path,
            "sha256": log.sha256,
            "start_us": start_us,
            "vehicle": verdict.vehicle,
            "actuator": verdict.actuator,
            "condition": verdict.condition,
            "worst": verdict.worst,
            "urgency": float(URGENCY[verdict.gravest]),
            "friction_nm": verdict.friction_nm.estimate if verdict.friction_nm else None,
            "airframe": assessment.airframe,
            "verdict": verdict.model_dump_json(),
        }


def _shown(assessment: Assessment) -> Iterator[tuple[object, ...]]:
    for verdict in assessment.verdicts:
        if is_healthy(verdict):
            for shown in verdict.indicators:
                yield assessment.airframe, verdict.vehicle, verdict.actuator, shown.fault


def _stored(store: Store, aircraft: str) -> Iterator[bytes]:
    """Yield an aircraft's flights in time order: each log once, in its latest judgement."""
    rows = store.query(
        "SELECT arg_max(flight, scanned) FROM logs WHERE aircraft = ? AND flight IS NOT NULL"
        " GROUP BY sha256 ORDER BY min(start_us), min(path)",
        aircraft,
    )
    while several := rows.fetchmany(100):
        yield from (data for (data,) in several)
