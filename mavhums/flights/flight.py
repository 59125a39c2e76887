"""The flights of an aircraft in a store, as assessments with the past."""

from __future__ import annotations

import os

from mavhums.core.errors import MavhumsError
from mavhums.flights.compare import unpacked
from mavhums.flights.queries import past_flights
from mavhums.flights.stores.delta import Store
from mavhums.report.assessment import Assessment, Verdict

__all__ = ["flight", "flights"]


def flights(store: str | os.PathLike[str], aircraft: str) -> list[Assessment]:
    """Return an aircraft's dated flights in time order, with verdicts only: without losses, usage and texts.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    return [flown.assessment for flown in past_flights(Store(store).opened(), aircraft)]


def flight(store: str | os.PathLike[str], aircraft: str, sha256: str) -> Assessment:
    """Return the whole assessment of a log, its verdicts compared with the aircraft's past.

    Raises
    ------
    MavhumsError
        If the store does not exist or does not have the log.
    """
    kept = Store(store).opened()
    row = kept.query(
        "SELECT arg_max(flight, scanned) FROM logs WHERE aircraft = ? AND sha256 = ? AND flight IS NOT NULL",
        aircraft,
        sha256,
    ).fetchone()
    if row is None or row[0] is None:
        raise MavhumsError(f"{store}: no such flight of the aircraft {aircraft!r}", "choose one of its list")
    alone = unpacked(row[0]).assessment
    told = kept.query(
        "SELECT verdict FROM verdicts WHERE aircraft = ? AND sha256 = ?", aircraft, sha256
    ).fetchall()
    if not told:
        return alone
    return alone.model_copy(
        update={"verdicts": tuple(Verdict.model_validate_json(verdict) for (verdict,) in told)}
    )
