"""The second pass: compares an aircraft's flights with its earlier ones, in time order, without a log."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from typing import NamedTuple

from mavhums.core.conditions import URGENCY
from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.checkpoint import Copies, Known, NotKeptError
from mavhums.flights.compare import compared, unpacked
from mavhums.flights.history import PastFlight, Since
from mavhums.report.assessment import Assessment

__all__ = ["Part", "Replayed", "replayed", "rows_of"]


class Part(NamedTuple):
    """Some consecutive flights of an aircraft, to be compared with those before.

    Attributes
    ----------
    aircraft
        Its name; flights of an unknown one are compared with no other.
    flights
        The flights judged alone, as the store keeps them, in time order.
    since
        Returns the dates from which an actuator's flights count at a time.
    known
        What is known of the flights before, packed; None for the first ones.
    settled
        Whether the verdicts on the flights before are final.
    whole
        Whether to keep the records of all flights, if these are the first ones.
    """

    aircraft: str
    flights: Sequence[bytes]
    since: Callable[[datetime], Since]
    known: bytes | None = None
    settled: bool = False
    whole: bool = False


class Replayed(NamedTuple):
    """The result of a part.

    Attributes
    ----------
    rows
        The verdicts, as rows of the store.
    copies, open_copies
        Recordings that do not count, of flights to which none can be added any more, and of the others.
    known
        What the next part needs.
    """

    rows: list[dict[str, object]]
    copies: Copies
    open_copies: Copies
    known: bytes


def replayed(part: Part) -> Replayed | None:
    """Return the verdicts of a part; None if they need more of the earlier flights than was kept."""
    if part.known is None:
        known = Known(part.since, whole=part.whole)
    else:
        known = Known.restored(part.known, part.since, settled=part.settled)
    rows: list[dict[str, object]] = []
    try:
        for data in part.flights:
            flight = unpacked(data)
            if part.aircraft == UNKNOWN:
                rows += rows_of(part.aircraft, flight.assessment)
                continue
            assessment = compared(flight, known.baselines, known.past)
            rows += rows_of(part.aircraft, assessment)
            if assessment.log.start_utc is not None:
                known.add(PastFlight.of(assessment))
    except NotKeptError:
        return None
    return Replayed(rows, known.copies, known.open_copies(), known.packed())


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
