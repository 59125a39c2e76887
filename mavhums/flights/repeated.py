"""Names the other logs of a flight that is recorded more than once."""

from __future__ import annotations

from typing import Protocol

from mavhums.flights.history import PastFlight, UndatedError, untaken
from mavhums.report.assessment import Assessment
from mavhums.report.flight import FlightCopy

__all__ = ["Flown", "with_copies"]


class Flown(Protocol):
    """Earlier flights, as :class:`mavhums.flights.history.FlightHistory` has them."""

    def near(self, flight: PastFlight) -> list[PastFlight]:
        """Return the flights in other logs that may be the same flight."""


def with_copies(assessment: Assessment, history: Flown) -> Assessment:
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
    left_out = untaken([*near, flight])
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
