"""Checkpoint of an aircraft's flights: reference flights in full, sums of the others, open duplicates.

A comparison goes on from it, in another process, or when the next flight lands, without the flights before.
A store of a fleet and a folder of one aircraft's flights keep it alike; in a store it lies beside a stamp of
what the verdicts depend on.
"""

from __future__ import annotations

import hashlib
import json
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from functools import cache
from typing import Any, Final, NamedTuple

from pydantic import TypeAdapter, ValidationError

from mavhums.core.about import __version__
from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.aircraft_table import Since
from mavhums.flights.corrections import installed_in, repairs_of
from mavhums.flights.duplicates import Recording
from mavhums.flights.history import FlightHistory, PastFlight, is_healthy, kept_records
from mavhums.flights.store import FORMAT, OF_THIS_FORMAT, Store
from mavhums.flights.store_tables import SETTLED
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
            raise MavhumsError("a store's table 'settled' is damaged", "remove it, and scan again") from error
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


_VERSION: Final = 1
_MOST_NEW: Final = 1_000


class FlightEntry(NamedTuple):
    """A flight of an aircraft: its log, the time of its latest judgement, its start and its path."""

    sha256: str
    scanned: int
    start_us: int | None
    path: str


def listed(store: Store, aircraft: str) -> list[FlightEntry]:
    """Return an aircraft's flights in time order, each log once; those without a date are last."""
    rows = store.query(
        "SELECT sha256, max(scanned), min(start_us), min(path) FROM logs WHERE aircraft = ?"
        f" AND sha256 IS NOT NULL AND {OF_THIS_FORMAT} GROUP BY sha256 ORDER BY min(start_us), min(path)",
        aircraft,
    ).fetchall()
    return [FlightEntry(*row) for row in rows]


def stamp_of(store: Store, aircraft: str) -> str:
    """Return what the verdicts of an aircraft depend on besides its flights, as text."""
    dates = repairs_of(store, aircraft)
    repairs = sorted(json.dumps([repair.actuator, repair.at.isoformat()]) for repair in dates)
    table = sorted(each.model_dump_json(by_alias=True) for each in installed_in(store, aircraft).installed)
    return json.dumps([_VERSION, FORMAT, __version__, aircraft, repairs, table])


def read_checkpoint(
    store: Store, aircraft: str, flights: Sequence[FlightEntry], stamp: str
) -> tuple[bytes, list[FlightEntry]] | None:
    """Return what is known of the settled flights, and the new ones; None if all must be judged again.

    Parameters
    ----------
    store
        The store.
    aircraft
        Name of the aircraft.
    flights
        All its flights, in time order.
    stamp
        What its verdicts depend on besides.
    """
    row = store.query(
        "SELECT scanned, digest, known FROM settled WHERE aircraft = ? ORDER BY stored DESC LIMIT 1", aircraft
    ).fetchone()
    if row is None or row[2] is None:
        return None
    scanned, digest, known = row
    settled = [flight for flight in flights if flight.scanned <= scanned]
    new = [flight for flight in flights if flight.scanned > scanned]
    if len(new) > _MOST_NEW or _digest(settled, stamp) != digest or not _follow(settled, new, aircraft):
        return None
    if _without_verdicts(store, aircraft) != {flight.sha256 for flight in new}:
        return None
    return known, new


def store_checkpoint(
    store: Store, aircraft: str, flights: Sequence[FlightEntry], stamp: str, known: bytes | None
) -> None:
    """Commit what is known of an aircraft's flights; None if the next one shall be judged with all."""
    row: dict[str, object] = {
        "aircraft": aircraft,
        "scanned": max((flight.scanned for flight in flights), default=0),
        "digest": _digest(flights, stamp),
        "known": known,
        "stored": time.time_ns(),
    }
    store.append(SETTLED, [row])


def _follow(settled: Sequence[FlightEntry], new: Sequence[FlightEntry], aircraft: str) -> bool:
    """Return whether all new flights with a date come after those that are settled."""
    if aircraft == UNKNOWN:
        return True
    before = [(flight.start_us, flight.path) for flight in settled if flight.start_us is not None]
    after = [(flight.start_us, flight.path) for flight in new if flight.start_us is not None]
    return not before or not after or before[-1] < after[0]


def _without_verdicts(store: Store, aircraft: str) -> set[str]:
    rows = store.query(
        f"SELECT DISTINCT sha256 FROM logs WHERE aircraft = $1 AND sha256 IS NOT NULL AND {OF_THIS_FORMAT}"
        " AND sha256 NOT IN (SELECT sha256 FROM verdicts WHERE aircraft = $1"
        " UNION ALL SELECT sha256 FROM copies WHERE aircraft = $1)",
        aircraft,
    ).fetchall()
    return {sha256 for (sha256,) in rows}


def _digest(flights: Sequence[FlightEntry], stamp: str) -> str:
    return hashlib.sha256(json.dumps([stamp, flights]).encode()).hexdigest()
