"""Checkpoint of an aircraft's flights: reference flights in full, sums of the others, open duplicates.

A comparison goes on from it when the next flight lands, without the flights before. A folder of one
aircraft's flights keeps it.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from functools import cache
from typing import Any, Final, NamedTuple

from pydantic import TypeAdapter, ValidationError

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft_table import Since
from mavhums.flights.duplicates import Recording
from mavhums.flights.history import FlightHistory, PastFlight, is_healthy, kept_records
from mavhums.health.decision.baseline import Baselines, PastRecord
from mavhums.health.self_baseline.thresholds import REFERENCE_FLIGHTS
from mavhums.results.assessment import Assessment
from mavhums.results.sections import CLOCKS_APART_S

# A flight that ended so long before the next one began has no further recording: twice, because a recording
# may be as far from the one before it as that one is from the first.
_ENDED: Final = timedelta(seconds=2 * CLOCKS_APART_S)
_LARGEST: Final = 1 << 30

_Key = tuple[str | None, int | None, str, str, datetime | None]

Superseded = dict[tuple[str | None, str, int], str | None]
"""For each airframe, log and vehicle that does not count, the path of the log that does."""


class TooLateError(Exception):
    """A flight needs more of the earlier flights than the checkpoint has; all must be compared again."""


@dataclass(slots=True)
class _Group:
    """The recordings of what may be one flight, whether they can be references, and have final verdicts."""

    flights: list[PastFlight] = field(default_factory=list)
    wanted: bool = False
    final: bool = False


class _FlightSummary(NamedTuple):
    assessment: Assessment
    recordings: tuple[Recording, ...]


class _StoredCheckpoint(NamedTuple):
    """What is stored of a checkpoint; ``sums`` is None where the sums of the flights were not kept."""

    references: tuple[_FlightSummary, ...]
    open: tuple[tuple[tuple[_FlightSummary, ...], bool], ...]
    counts: tuple[tuple[_Key, int], ...]
    sums: tuple[_FlightSummary, ...] | None


class Checkpoint:
    """The flights so far, in time order.

    Parameters
    ----------
    since
        Returns the dates from which an actuator's flights count at a time; None for none.
    whole
        Whether to keep the sums of all flights, which own-scale equations need.
    """

    def __init__(self, since: Callable[[datetime], Since] | None = None, *, whole: bool = True) -> None:
        self._since = since or (lambda _: {})
        self._references: list[PastFlight] = []
        self._open: list[_Group] = []
        self._counts: Counter[_Key] = Counter()
        self._sums: list[PastFlight] | None = [] if whole else None
        self._latest: dict[object, Baselines] = {}
        self._superseded: Superseded = {}

    @classmethod
    def restored(
        cls, data: bytes, since: Callable[[datetime], Since] | None = None, *, final: bool = False
    ) -> Checkpoint:
        """Return what :meth:`packed` has packed.

        Parameters
        ----------
        data
            The packed flights.
        since
            As for the first flights.
        final
            Whether the verdicts on these flights are final; then another recording of one is refused.

        Raises
        ------
        MavhumsError
            If the bytes are damaged, or from another version.
        """
        try:
            state = _adapter().validate_json(zlib.decompressobj().decompress(data, _LARGEST))
        except (zlib.error, ValidationError) as error:
            raise MavhumsError("the checkpoint is damaged", "remove it, and judge again") from error
        checkpoint = cls(since)
        checkpoint._references = _flights(state.references)
        checkpoint._open = [_Group(_flights(flights), wanted, final) for flights, wanted in state.open]
        checkpoint._counts.update(dict(state.counts))
        checkpoint._sums = None if state.sums is None else _flights(state.sums)
        return checkpoint

    def packed(self) -> bytes:
        """Return the flights so far as bytes; numbers are preserved exactly."""
        state = _StoredCheckpoint(
            _stored(self._references),
            tuple((_stored(group.flights), group.wanted) for group in self._open),
            tuple(self._counts.items()),
            None if self._sums is None else _stored(self._sums),
        )
        return zlib.compress(_adapter().dump_json(state, by_alias=True), 1)

    def baselines(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Baselines:
        """Return the same as :meth:`mavhums.flights.history.FlightHistory.baselines` for all flights.

        ``since`` are the dates from which flights count; by default those of the time ``before``.
        """
        if before is None:
            return {}
        dates = self._since(before) if since is None else since
        recent = (flight for group in self._open if group.wanted for flight in group.flights)
        ended = tuple(flight for flight in (*self._references, *recent) if flight.end <= before)
        key = (airframe, tuple(map(id, ended)), tuple(dates.items()))
        if key not in self._latest:  # the same for all flights after the last reference
            self._latest = {key: FlightHistory(ended).baselines(airframe, before, dates)}
        return self._latest[key]

    def past(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Mapping[tuple[int, str], Sequence[PastRecord]]:
        """Return the same as :meth:`mavhums.flights.history.FlightHistory.past` for all flights.

        Raises
        ------
        TooLateError
            If the sums of all flights were not kept.
        """
        if before is None:
            return {}
        if self._sums is None:
            raise TooLateError
        dates = self._since(before) if since is None else since
        return FlightHistory(tuple(self._sums)).past(airframe, before, dates)

    def add(self, flown: PastFlight) -> None:
        """Take the next flight.

        Raises
        ------
        TooLateError
            If it may be another recording of a flight whose verdicts are final.
        """
        self._close(flown.start - _ENDED)
        same = [group for group in self._open if _is_near(flown, group.flights)]
        if any(group.final for group in same):
            raise TooLateError
        group = _Group([flown.without("evidence", "provenance", "own")])
        group.wanted = any(self._counts[key] < REFERENCE_FLIGHTS for key in self._healthy_indicators(flown))
        for other in same:
            group.flights += other.flights
            group.wanted |= other.wanted
            self._open.remove(other)
        self._open.append(group)
        if self._sums is not None:
            self._sums.append(_with_kept_records(flown.without("evidence", "provenance", "indicators")))

    @property
    def is_whole(self) -> bool:
        """Whether the sums of all flights are kept."""
        return self._sums is not None

    @property
    def open_flights(self) -> list[PastFlight]:
        """The flights of which another recording can still come."""
        return [flight for group in self._open for flight in group.flights]

    @property
    def superseded(self) -> Superseded:
        """The recordings that do not count, of the flights to which none can be added any more."""
        return self._superseded

    def open_superseded(self) -> Superseded:
        """Return the recordings that do not count so far, of the other flights."""
        return {key: path for group in self._open for key, path in _superseded(group.flights).items()}

    def _healthy_indicators(self, flown: PastFlight) -> Iterator[_Key]:
        """Yield the indicators of healthy actuators, each with the date from which they count."""
        dates = self._since(flown.start)
        for verdict in flown.assessment.verdicts:
            # What began before the date makes no reference: counted, it would crowd out one that does.
            if is_healthy(verdict) and flown.counts(verdict.actuator, dates):
                date = dates.get(verdict.actuator, dates.get(None))
                for shown in verdict.indicators:
                    yield flown.assessment.airframe, verdict.vehicle, verdict.actuator, shown.fault, date

    def _close(self, ended: datetime) -> None:
        """Keep or drop the flights to which no recording can be added."""
        for group in [each for each in self._open if all(_end(flight) < ended for flight in each.flights)]:
            self._open.remove(group)
            # Only indicators that all recordings show are certain to be references.
            self._counts.update(
                set.intersection(*(set(self._healthy_indicators(flight)) for flight in group.flights))
            )
            self._references += group.flights if group.wanted else ()
            if not group.final:
                self._superseded |= _superseded(group.flights)


def _with_kept_records(flight: PastFlight) -> PastFlight:
    kept = [one.model_copy(update={"own": kept_records(one)}) for one in flight.assessment.verdicts]
    return replace(flight, assessment=flight.assessment.model_copy(update={"verdicts": tuple(kept)}))


def _end(flight: PastFlight) -> datetime:
    """Return the end of a log, and of what its vehicles report of theirs."""
    ends = (each.flight.end_utc for each in flight.recordings)
    return max([flight.end, *(datetime.fromisoformat(end) for end in ends if end is not None)])


def _superseded(flights: Sequence[PastFlight]) -> Superseded:
    paths = {flight.log: flight.assessment.log.path for flight in flights}
    found = FlightHistory(tuple(flights)).superseded_recordings()
    return {key: paths[best] for key, best in found.items()}


def _is_near(flown: PastFlight, others: Iterable[PastFlight]) -> bool:
    """Return whether a flight may be the same as one of the others."""
    return any(
        own.flight.is_same(each.flight)
        for other in others
        for own in flown.recordings
        for each in other.recordings
    )


def _stored(flights: Sequence[PastFlight]) -> tuple[_FlightSummary, ...]:
    return tuple(_FlightSummary(flight.assessment, flight.recordings) for flight in flights)


def _flights(stored: tuple[_FlightSummary, ...]) -> list[PastFlight]:
    return [replace(PastFlight.of(flight.assessment), recordings=flight.recordings) for flight in stored]


@cache
def _adapter() -> TypeAdapter[Any]:
    return TypeAdapter(_StoredCheckpoint)
