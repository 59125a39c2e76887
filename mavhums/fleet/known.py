"""What a replay keeps of an aircraft's flights: those that can still be references, and a little of all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Any

from mavhums.health.baseline import Baselines
from mavhums.health.own.past import REFERENCE_FLIGHTS, PastRecord
from mavhums.history.flights import FlightHistory, PastFlight, Since, is_healthy
from mavhums.report.flight import CLOCKS_APART_S

__all__ = ["Known"]

_ENDED = timedelta(seconds=2 * CLOCKS_APART_S)
"""A flight that ended so long before the next one began has no further recording."""

_Key = tuple[object, ...]
_Row = dict[str, object]


@dataclass(slots=True)
class _Group:
    """The recordings of what may be one flight, and whether they can be references."""

    flights: list[PastFlight] = field(default_factory=list)
    wanted: bool = False


class Known:
    """The flights so far, in time order.

    Parameters
    ----------
    since
        Returns the dates from which an actuator's flights count at a time; None for none.
    """

    def __init__(self, since: Callable[[datetime], Since] | None = None) -> None:
        self._since = since or (lambda _: {})
        self._references: list[PastFlight] = []
        self._open: list[_Group] = []
        self._counts: Counter[_Key] = Counter()
        self._slim: list[PastFlight] = []
        self._latest: dict[_Key, Baselines] = {}

    def baselines(self, airframe: str | None, before: datetime | None) -> Baselines:
        """Return the same as :meth:`mavhums.history.flights.FlightHistory.baselines` for all flights."""
        if before is None:
            return {}
        since = self._since(before)
        recent = (flight for group in self._open if group.wanted for flight in group.flights)
        ended = tuple(flight for flight in (*self._references, *recent) if flight.end <= before)
        key = (airframe, tuple(map(id, ended)), tuple(since.items()))
        if key not in self._latest:  # the same for all flights after the last reference
            self._latest = {key: FlightHistory(ended).baselines(airframe, before, since)}
        return self._latest[key]

    def past(
        self, airframe: str | None, before: datetime | None
    ) -> Mapping[tuple[int, str], Sequence[PastRecord]]:
        """Return the same as :meth:`mavhums.history.flights.FlightHistory.past` for all flights."""
        return FlightHistory(tuple(self._slim)).past(airframe, before, self._dates(before))

    def add(self, flown: PastFlight) -> None:
        """Take the next flight."""
        self._close(flown.start - _ENDED)
        same = [group for group in self._open if _is_near(flown, group.flights)]
        group = _Group([flown])
        group.wanted = any(self._counts[key] < REFERENCE_FLIGHTS for key in self._shown(flown))
        for other in same:
            group.flights += other.flights
            group.wanted |= other.wanted
            self._open.remove(other)
        self._open.append(group)
        self._slim.append(flown.slim())

    def divided(self, rows: Iterable[_Row]) -> tuple[list[_Row], list[_Row]]:
        """Return the rows of the recordings that count, and one row for each log with one that does not."""
        left_out = FlightHistory(tuple(self._slim)).untaken()
        paths = {flight.log: flight.assessment.log.path for flight in self._slim}
        counted: list[_Row] = []
        copies: dict[Any, _Row] = {}
        for row in rows:
            key: Any = row["airframe"], row["sha256"], row["vehicle"]
            if key not in left_out:
                counted.append(row)
                continue
            taken = {"counted": paths[left_out[key]]}
            copies[key] = {name: row[name] for name in ("aircraft", "path", "sha256", "vehicle")} | taken
        return counted, [*copies.values()]

    def _dates(self, moment: datetime | None) -> Since:
        return {} if moment is None else self._since(moment)

    def _shown(self, flown: PastFlight) -> Iterator[_Key]:
        """Yield the indicators of healthy actuators, each with the date from which they count."""
        dates = self._since(flown.start)
        for verdict in flown.assessment.verdicts:
            if is_healthy(verdict):
                date = dates.get(verdict.actuator, dates.get(None))
                for shown in verdict.indicators:
                    yield flown.assessment.airframe, verdict.vehicle, verdict.actuator, shown.fault, date

    def _close(self, ended: datetime) -> None:
        """Keep or drop the flights to which no recording can be added."""
        for group in [each for each in self._open if all(flight.end < ended for flight in each.flights)]:
            self._open.remove(group)
            # Only indicators that all recordings show are certain to be references.
            self._counts.update(set.intersection(*(set(self._shown(flight)) for flight in group.flights)))
            self._references += group.flights if group.wanted else ()


def _is_near(flown: PastFlight, others: Iterable[PastFlight]) -> bool:
    """Return whether a flight may be the same as one of the others."""
    return any(
        own.flight.is_same(each.flight)
        for other in others
        for own in flown.recordings
        for each in other.recordings
    )
