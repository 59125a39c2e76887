"""The second pass: compares each aircraft's flights with its earlier ones, in time order, without a log."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import datetime

from mavhums.core.conditions import URGENCY
from mavhums.fleet.known import Known
from mavhums.fleet.repairs import since_of
from mavhums.fleet.store import OF_THIS_FORMAT, Store
from mavhums.history.aircraft import UNKNOWN
from mavhums.history.comparison import LoneFlight, compared, unpacked
from mavhums.history.flights import PastFlight
from mavhums.report.assessment import Assessment

__all__ = ["hold_against_past", "in_order", "rows_of"]


def hold_against_past(store: Store, aircraft: str) -> None:
    """Judge all flights of an aircraft by its past, and commit the verdicts.

    A flight that several logs record has the verdicts of the best one; the others are stored as its copies.
    """
    flights = (unpacked(data) for data in _stored(store, aircraft))
    known = Known(since_of(store, aircraft))
    held = (flight.assessment for flight in flights) if aircraft == UNKNOWN else in_order(flights, known)
    rows = [row for assessment in held for row in rows_of(aircraft, assessment)]
    counted, copies = known.divided(rows)
    store.replace_verdicts(aircraft, counted)
    store.replace_copies(aircraft, copies)


def in_order(flights: Iterable[LoneFlight], known: Known | None = None) -> Iterator[Assessment]:
    """Yield the assessments of one aircraft's flights, given in time order, compared with their past."""
    known = known or Known()
    for flight in flights:
        assessment = compared(flight, known.baselines, known.past)
        yield assessment
        if assessment.log.start_utc is not None:
            known.add(PastFlight.of(assessment))


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


def _stored(store: Store, aircraft: str) -> Iterator[bytes]:
    """Yield an aircraft's flights in time order: each log once, in its latest judgement."""
    rows = store.query(
        "SELECT arg_max(flight, scanned) FROM logs WHERE aircraft = ? AND flight IS NOT NULL"
        f" AND {OF_THIS_FORMAT}"
        " GROUP BY sha256 ORDER BY min(start_us), min(path)",
        aircraft,
    )
    while several := rows.fetchmany(100):
        yield from (data for (data,) in several)
