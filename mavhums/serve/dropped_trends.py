"""Trends over the logs that a user dropped, of each aircraft that several of them name."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import Final, NamedTuple

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import board_of
from mavhums.flights.history import FlightHistory, PastFlight
from mavhums.flights.trends import trend_report
from mavhums.results.assessment import Assessment
from mavhums.results.trend import TrendReport
from mavhums.serve.sessions import Dropped

__all__ = ["FEWEST_FLIGHTS", "AircraftTrend", "dropped_trends"]

FEWEST_FLIGHTS: Final = 3
"""Of one aircraft: two points are no trend."""


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
