"""What a replay keeps of an aircraft's flights: those that can still be references, and a little of all.

It can be packed, and the replay continued from there: on another process, or when the next flight lands.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta

from mavhums.flights.checkpoint_state import State, unpacked_state
from mavhums.flights.history import FlightHistory, PastFlight, Since, is_healthy
from mavhums.health.decision.baseline import Baselines
from mavhums.health.self_baseline.past import REFERENCE_FLIGHTS, PastRecord
from mavhums.report.flight import CLOCKS_APART_S

__all__ = ["Copies", "Known", "NotKeptError"]

_ENDED = timedelta(seconds=2 * CLOCKS_APART_S)
"""A flight that ended so long before the next one began has no further recording."""

_Key = tuple[str | None, int | None, str, str, datetime | None]

Copies = dict[tuple[str | None, str, int], str | None]
"""For each airframe, log and vehicle that does not count, the path of the log that does."""


class NotKeptError(Exception):
    """A flight needs more of the earlier flights than was kept; all must be replayed."""


@dataclass(slots=True)
class _Group:
    """The recordings of what may be one flight, whether they can be references, and have verdicts."""

    flights: list[PastFlight] = field(default_factory=list)
    wanted: bool = False
    settled: bool = False


class Known:
    """The flights so far, in time order.

    Parameters
    ----------
    since
        Returns the dates from which an actuator's flights count at a time; None for none.
    whole
        Whether to keep the records of all flights, which own-scale equations need.
    """

    def __init__(self, since: Callable[[datetime], Since] | None = None, *, whole: bool = True) -> None:
        self._since = since or (lambda _: {})
        self._references: list[PastFlight] = []
        self._open: list[_Group] = []
        self._counts: Counter[_Key] = Counter()
        self._slim: list[PastFlight] | None = [] if whole else None
        self._latest: dict[object, Baselines] = {}
        self._copies: Copies = {}

    @classmethod
    def restored(
        cls, data: bytes, since: Callable[[datetime], Since] | None = None, *, settled: bool = False
    ) -> Known:
        """Return what :meth:`packed` has packed.

        Parameters
        ----------
        data
            The packed flights.
        since
            As for the first flights.
        settled
            Whether the verdicts on these flights are final; then another recording of one is refused.
        """
        state = unpacked_state(data)
        known = cls(since)
        known._references = [*state.references]
        known._open = [_Group([*flights], wanted, settled) for flights, wanted in state.open]
        known._counts.update(dict(state.counts))
        known._slim = None if state.slim is None else [*state.slim]
        return known

    def packed(self) -> bytes:
        """Return the flights so far as bytes."""
        return State(
            references=tuple(self._references),
            open=tuple((tuple(group.flights), group.wanted) for group in self._open),
            counts=tuple(self._counts.items()),
            slim=None if self._slim is None else tuple(self._slim),
        ).packed()

    def baselines(self, airframe: str | None, before: datetime | None) -> Baselines:
        """Return the same as :meth:`mavhums.flights.history.FlightHistory.baselines` for all flights."""
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
        """Return the same as :meth:`mavhums.flights.history.FlightHistory.past` for all flights.

        Raises
        ------
        NotKeptError
            If the records of all flights were not kept.
        """
        if self._slim is None:
            raise NotKeptError
        return FlightHistory(tuple(self._slim)).past(airframe, before, self._dates(before))

    def add(self, flown: PastFlight) -> None:
        """Take the next flight.

        Raises
        ------
        NotKeptError
            If it may be another recording of a flight whose verdicts are final.
        """
        self._close(flown.start - _ENDED)
        same = [group for group in self._open if _is_near(flown, group.flights)]
        if any(group.settled for group in same):
            raise NotKeptError
        group = _Group([flown.without("evidence", "provenance", "own")])
        group.wanted = any(self._counts[key] < REFERENCE_FLIGHTS for key in self._shown(flown))
        for other in same:
            group.flights += other.flights
            group.wanted |= other.wanted
            self._open.remove(other)
        self._open.append(group)
        if self._slim is not None:
            self._slim.append(flown.without("evidence", "provenance", "indicators"))

    @property
    def copies(self) -> Copies:
        """The recordings that do not count, of the flights to which none can be added any more."""
        return self._copies

    def open_copies(self) -> Copies:
        """Return the recordings that do not count so far, of the other flights."""
        return {key: path for group in self._open for key, path in _untaken(group.flights).items()}

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
        for group in [each for each in self._open if all(_end(flight) < ended for flight in each.flights)]:
            self._open.remove(group)
            # Only indicators that all recordings show are certain to be references.
            self._counts.update(set.intersection(*(set(self._shown(flight)) for flight in group.flights)))
            self._references += group.flights if group.wanted else ()
            if not group.settled:
                self._copies |= _untaken(group.flights)


def _end(flight: PastFlight) -> datetime:
    """Return the end of a log, and of what its vehicles say of theirs."""
    told = (each.flight.end_utc for each in flight.recordings)
    return max([flight.end, *(datetime.fromisoformat(end) for end in told if end is not None)])


def _untaken(flights: Sequence[PastFlight]) -> Copies:
    if len(flights) == 1:
        return {}
    paths = {flight.log: flight.assessment.log.path for flight in flights}
    return {key: paths[taken] for key, taken in FlightHistory(tuple(flights)).untaken().items()}


def _is_near(flown: PastFlight, others: Iterable[PastFlight]) -> bool:
    """Return whether a flight may be the same as one of the others."""
    return any(
        own.flight.is_same(each.flight)
        for other in others
        for own in flown.recordings
        for each in other.recordings
    )
