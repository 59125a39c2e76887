"""Places to keep flights, a folder of one aircraft or the tables of a fleet, and what all of them answer."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Protocol

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import Owner
from mavhums.flights.aircraft_table import Since
from mavhums.flights.history import PastFlight, UndatedError, superseded
from mavhums.health.decision.baseline import Baselines
from mavhums.health.self_baseline.past import PastRecord
from mavhums.results.assessment import Assessment
from mavhums.results.sections import FlightCopy

__all__ = ["EarlierFlights", "is_store", "with_duplicate_flights"]


class EarlierFlights(Protocol):
    """An aircraft's flights, in memory (:class:`mavhums.flights.history.FlightHistory`) or in a folder.

    Each place answers alike; what it reads to do so differs.
    """

    @property
    def name(self) -> str:
        """What the history is called in messages."""

    @property
    def flights(self) -> tuple[PastFlight, ...]:
        """All flights in time order."""

    @property
    def errors(self) -> tuple[MavhumsError, ...]:
        """Files that could not be read."""

    @property
    def notices(self) -> tuple[str, ...]:
        """Files that were ignored without loss of data."""

    def baselines(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Baselines:
        """Return the baseline of each actuator's indicators from the flights that ended before a time."""

    def past(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Mapping[tuple[int, str], Sequence[PastRecord]]:
        """Return the data of those flights for own-scale equations, by vehicle and actuator."""

    def recent(self) -> Sequence[PastFlight]:
        """Return the flights that tell how the aircraft stands: the latest ones, where there are many."""

    def owners(self) -> list[Owner]:
        """Return what is known of the aircraft of the flights."""

    def near(self, flight: PastFlight) -> list[PastFlight]:
        """Return the flights in other logs that may be the same flight."""

    def with_flight(self, assessment: Assessment) -> EarlierFlights:
        """Return the flights with one more."""


def is_store(place: str | os.PathLike[str]) -> bool:
    """Return whether a place is a fleet's store: a folder with its tables, or an object store's address.

    Examples
    --------
    >>> is_store("s3://bucket/fleet"), is_store("flights")
    (True, False)
    """
    return "://" in os.fspath(place) or Path(place, "logs", "_delta_log").exists()


def with_duplicate_flights(assessment: Assessment, history: EarlierFlights) -> Assessment:
    """Return the assessment with the names of the history's other logs of the same flight.

    Parameters
    ----------
    assessment
        Of the log.
    history
        The earlier flights; assessments of this log among them do not matter.
    """
    try:
        flight = PastFlight.of(assessment)
    except UndatedError:
        return assessment
    near = history.near(flight) if flight.recordings else []
    left_out = superseded([*near, flight])
    named = tuple(
        FlightCopy(
            vehicle=vehicle,
            log=other.assessment.log.path,
            sha256=other.assessment.log.sha256,
            counts=(other.log, vehicle) not in left_out,
        )
        for own in flight.recordings
        for other in near
        for each in other.recordings
        if own.flight.is_same(each.flight) and (vehicle := own.flight.vehicle)
    )
    if not named:
        return assessment
    return assessment.model_copy(update={"log": assessment.log.model_copy(update={"copies": named})})
