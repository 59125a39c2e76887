"""Stores of flights that nobody flew."""

from __future__ import annotations

from pathlib import Path

from mavhums.engine.events import StandaloneAssessment
from mavhums.fleet.second_pass import rows_of
from mavhums.flights.compare import packed
from mavhums.flights.history import PastFlight
from mavhums.flights.store import Row, Store
from mavhums.flights.store_tables import VERDICTS
from mavhums.results.assessment import Assessment


def row_of(assessment: Assessment, aircraft: str, flight: StandaloneAssessment | None = None) -> Row:
    """Return a log's row, as a worker gives it; without the flight's records if it is not given."""
    log = assessment.log
    start = PastFlight.of(assessment).start if log.start_utc else None
    return Row(
        path=log.path or "",
        size=1,
        time_ns=1,
        settings="",
        sha256=log.sha256,
        aircraft=aircraft,
        board=None,
        start_us=round(start.timestamp() * 1e6) if start else None,
        duration_s=log.duration_s,
        losses=False,
        flight=packed(flight or StandaloneAssessment(assessment, {}, {})),
        problem=None,
        remedy=None,
    )


def write_store(folder: Path, flown: dict[str, list[Assessment]]) -> None:
    """Write the flights of each aircraft, judged already."""
    store = Store(folder)
    for aircraft, flights in flown.items():
        store.add_logs([row_of(flight, aircraft) for flight in flights])
        store.replace(VERDICTS, aircraft, [row for flight in flights for row in rows_of(aircraft, flight)])
