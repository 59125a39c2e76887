"""The earlier flights of an aircraft in a store: what a comparison needs of them is asked for by an index."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from datetime import datetime, timedelta
from functools import cache, cached_property, partial
from itertools import groupby
from typing import Any, Final, NamedTuple

from pydantic import TypeAdapter
from sqlalchemy import Connection, func, select

from mavhums.core.startup import no_collection
from mavhums.flights.aircraft import Since, latest
from mavhums.flights.history import (
    PastFlight,
    PastIndicator,
    PastVerdict,
    baselines_on,
    records_of,
    references,
)
from mavhums.flights.recordings import FlightRecording, Quality
from mavhums.flights.store.logs import in_parts, since_of
from mavhums.flights.store.tables import FLIGHT, INDICATOR, RECORD, RECORDING, VERDICT, time_of, us_of
from mavhums.health.decision.baseline import Baselines, PastRecord
from mavhums.health.estimation.thresholds import REFERENCE_FLIGHTS
from mavhums.results.sections import CLOCKS_APART_S, FlightIdentity
from mavhums.results.verdict import Indicator, OwnRecord, Verdict

RECENT_FLIGHTS: Final = 200
"""Flights that show an aircraft's state; a year of flights."""

# Twice, because a recording may be as far from the one before it as that one is from the first.
_NEAR_US: Final = round(2e6 * CLOCKS_APART_S)
OF_VERDICT: Final = (RECORD.c.flight_id == VERDICT.c.flight_id) & (RECORD.c.place == VERDICT.c.place)
_OF_FLIGHT: Final = [
    FLIGHT.c[name] for name in ("id", "path", "sha256", "airframe", "start_us", "duration_s")
]
_OF_VERDICT: Final = [VERDICT.c[name] for name in ("place", *PastVerdict._fields[:7])]
_OF_INDICATOR: Final = [INDICATOR.c[{"limit": "degraded"}.get(name, name)] for name in PastIndicator._fields]
# More than a baseline takes: a recording may turn out to be of the same flight as a better one.
_WANTED: Final = REFERENCE_FLIGHTS + 5
OWN: Final = TypeAdapter(tuple[OwnRecord, ...])
_BLOCK: Final = 32  # flights whose verdicts are read together; a baseline takes 20

Reading = Callable[[], AbstractContextManager[Connection]]
QUALITY: Final = TypeAdapter(Quality)


def verdict_of(text: str, own: str | None = None) -> Verdict:
    """Return a stored verdict, with its record if that is given."""
    verdict = Verdict.model_validate_json(text)
    return verdict.model_copy(update={"own": OWN.validate_json(own)}) if own else verdict


def past_flights(reading: Reading, aircraft: int, *where: Any, shown: bool = False) -> list[PastFlight]:
    """Return an aircraft's dated flights in time order, each with its verdicts and the times of its log.

    Parameters
    ----------
    reading
        Returns a connection to the store; by it whole verdicts and their records are read later, too.
    aircraft
        Id of the aircraft.
    where
        Conditions on the flights and their verdicts.
    shown
        Whether the verdicts have their indicators.
    """
    own = (FLIGHT.c.aircraft_id == aircraft, FLIGHT.c.start_us.is_not(None), *where)
    asked = select(*_OF_FLIGHT, *_OF_VERDICT).join(VERDICT, VERDICT.c.flight_id == FLIGHT.c.id).where(*own)
    asked = asked.order_by(FLIGHT.c.start_us, FLIGHT.c.path, FLIGHT.c.id, VERDICT.c.place)
    with no_collection(), reading() as connection:
        rows = connection.execute(asked).all()
        ids = [*dict.fromkeys(row[0] for row in rows)]
        known = _recordings_in(connection, ids)
        indicators = _indicators(connection, ids) if shown else {}
        blocks = _blocks(reading, ids)
        flights = []
        for (flight, path, sha256, airframe, start_us, duration_s), several in groupby(
            rows, key=lambda row: row[:6]
        ):
            verdicts: list[PastVerdict] = []
            for row in several:
                at = flight, row.place
                kept = _Kept(blocks[flight], at)
                verdicts.append(PastVerdict._make((*row[7:], indicators.get(at, ()), kept, kept.whole)))
            start, recorded = time_of(start_us), known.get(flight, ())
            flown = PastFlight(
                path=path,
                sha256=sha256,
                airframe=airframe,
                start=start,
                end=start + timedelta(seconds=duration_s),
                verdicts=tuple(verdicts),
                flights=tuple(identity for identity, _ in recorded),
                recordings=tuple(FlightRecording(one, quality) for one, quality in recorded if quality),
            )
            flights.append(flown)
    return flights


def _indicators(connection: Connection, flights: Iterable[int]) -> dict[Any, list[PastIndicator]]:
    """Return the indicators of the verdicts on some flights, by flight and place."""
    asked = select(INDICATOR.c.flight_id, INDICATOR.c.place, *_OF_INDICATOR)
    found: dict[Any, list[PastIndicator]] = defaultdict(list)
    for part in in_parts(flights):
        for row in connection.execute(asked.where(INDICATOR.c.flight_id.in_(part))).all():
            found[row[:2]].append(PastIndicator._make(row[2:]))
    return found


def _recordings_in(
    connection: Connection, flights: Iterable[int]
) -> dict[int, list[tuple[FlightIdentity, Quality | None]]]:
    """Return the identities in some flights, with the quality of those whose time and board are known."""
    columns = (RECORDING.c.flight_id, RECORDING.c.identity, RECORDING.c.quality)
    found: dict[int, list[tuple[FlightIdentity, Quality | None]]] = {}
    for part in in_parts(flights):
        own = select(*columns).where(RECORDING.c.flight_id.in_(part)).order_by(RECORDING.c.vehicle)
        for flight, identity, quality in connection.execute(own):
            known = QUALITY.validate_json(quality) if quality else None
            found.setdefault(flight, []).append((FlightIdentity.model_validate_json(identity), known))
    return found


class _Kept(Sequence[OwnRecord]):
    """The records of a verdict, read with the verdict when one is asked for: a comparison takes a few."""

    def __init__(self, block: _Block, at: tuple[int, int]) -> None:
        self._block, self._at = block, at
        self._verdict: Verdict | None = None

    def whole(self) -> Verdict:
        """Return the verdict."""
        if self._verdict is None:
            self._verdict = verdict_of(*self._block()[self._at])
        return self._verdict

    def __getitem__(self, index: Any) -> Any:
        return self.whole().own[index]

    def __len__(self) -> int:
        return len(self.whole().own)


_Block = Callable[[], dict[tuple[int, int], tuple[str, str | None]]]


def _blocks(reading: Reading, flights: Sequence[int]) -> dict[int, _Block]:
    """Return what reads the verdicts of each flight, and keeps those of the flights around it."""
    blocks: dict[int, _Block] = {}
    for first in range(0, len(flights), _BLOCK):
        part = flights[first : first + _BLOCK]
        blocks |= dict.fromkeys(part, cache(partial(_read, reading, part)))
    return blocks


def _read(reading: Reading, flights: Sequence[int]) -> dict[tuple[int, int], tuple[str, str | None]]:
    asked = select(RECORD.c.flight_id, RECORD.c.place, RECORD.c.verdict, RECORD.c.own)
    with reading() as connection:
        rows = connection.execute(asked.where(RECORD.c.flight_id.in_(flights)))
        return {(flight, place): (text, own) for flight, place, text, own in rows}


class _References(NamedTuple):
    """What baselines rest on, by vehicle, actuator and fault, of an airframe at a time, and the baselines."""

    key: object
    known: dict[tuple[int, str, str], list[Indicator]]
    baselines: Baselines


def flights_within(
    connection: Connection, aircraft: int | None, *, before_us: int | None = None
) -> StoredFlights:
    """Return the earlier flights of an aircraft, read by a connection that stays open meanwhile."""
    since = since_of(connection, aircraft)
    return StoredFlights(lambda: nullcontext(connection), aircraft, since, before_us=before_us)


class StoredFlights:
    """The earlier flights of an aircraft.

    Parameters
    ----------
    reading
        Returns a connection to the store.
    aircraft
        Id of the aircraft; None for one without flights.
    since
        Returns the dates from which an actuator's flights count at a time, as the store has them.
    given
        Returns the same as a table has them that the operator gives; the later date of both counts.
    before_us
        Start of the first flight that is not there; None for none.
    """

    def __init__(
        self,
        reading: Reading,
        aircraft: int | None,
        since: Callable[[datetime], Since],
        *,
        given: Callable[[datetime], Since] = lambda _: {},
        before_us: int | None = None,
    ) -> None:
        self._reading, self._aircraft, self._since, self._given = reading, aircraft, since, given
        self._before = before_us
        self._records: list[PastFlight] | None = None
        self._latest: dict[str | None, _References] = {}

    def since(self, moment: datetime) -> Since:
        """Return the dates from which flights count for one at a time."""
        return latest(self._since(moment), self._given(moment))

    def recent(self) -> list[PastFlight]:
        """Return the flights that show the aircraft's state, with their indicators."""
        return self.latest(RECENT_FLIGHTS, shown=True)

    def latest(self, most: int | None, *, shown: bool = False) -> list[PastFlight]:
        """Return the latest flights that count, or all; ``shown`` as of :func:`past_flights`."""
        if most is None:
            return self._asked(VERDICT.c.counts, shown=shown)
        newest = (
            select(FLIGHT.c.start_us)
            .where(FLIGHT.c.aircraft_id == self._aircraft, FLIGHT.c.start_us.is_not(None))
            .order_by(FLIGHT.c.start_us.desc())
            .offset(most - 1)
            .limit(1)
        )
        with self._reading() as connection:
            first = connection.scalar(newest)
        since = [] if first is None else [FLIGHT.c.start_us >= first]
        return self._asked(VERDICT.c.counts, *since, shown=shown)

    def baselines(self, airframe: str | None, before: datetime | None) -> Baselines:
        """Return each actuator's baseline from all flights, as of :func:`baselines_of`.

        Without ``before``, the start of the flight under evaluation, there is no baseline.
        """
        if before is None:
            return {}
        return self._rests_on(airframe, before).baselines

    def _rests_on(self, airframe: str | None, before: datetime) -> _References:
        dates = self.since(before)
        # Where other dates count than in the store, a baseline may rest on any flight.
        flights = self._references if dates == self._since(before) else self._all
        ended = tuple(flight for flight in flights if flight.end <= before)
        key = tuple(map(id, ended)), tuple(dates.items())
        latest = self._latest.get(airframe)
        if latest is None or latest.key != key:  # the same for all flights after the last reference
            known = references(ended, airframe, before, dates, _WANTED)
            latest = self._latest[airframe] = _References(key, known, baselines_on(known))
        return latest

    def past(
        self, airframe: str | None, before: datetime | None
    ) -> Mapping[tuple[int, str], Sequence[PastRecord]]:
        """Return the data of all flights for own-scale equations, by vehicle and actuator."""
        if before is None:
            return {}
        if self._records is None:
            # With the flights that were judged since the first one that is not there.
            judged = [] if self._before is None else [FLIGHT.c.start_us < us_of(before)]
            self._records = self._asked(*judged)
        return records_of(self._records, airframe, before, self.since(before))

    def add(self, flown: PastFlight, near: Iterable[PastFlight]) -> list[str]:
        """Take the next flight, and those near it; return the logs on which a baseline may rest from now on.

        Other recordings of such a flight are among them: a better one that shows a fault replaces it.
        """
        dates = self.since(flown.start)
        known = self._rests_on(flown.airframe, flown.start).known
        wanted = any(
            len(known.get((verdict.vehicle or 0, verdict.actuator, shown.fault), ())) < _WANTED
            for verdict in flown.verdicts
            if verdict.is_healthy and flown.counts(verdict.actuator, dates)
            for shown in verdict.indicators
        )
        if self._records is not None:
            self._records.append(flown.slim())
        near = [each for each in near if each.start <= flown.start]
        logs = {each.log for each in self._references}
        if not wanted and not any(each.log in logs for each in near):
            return []
        new = [flown, *(each for each in near if each.log not in logs)]
        self._references += new
        return [each.log for each in new]

    def forget_after(self, start: datetime, path: str = "") -> None:
        """Forget on which flights after one a baseline rests: they are compared again."""
        known = self._references
        self._references = [each for each in known if (each.start, each.path or "") <= (start, path)]

    def near(self, flight: PastFlight) -> list[PastFlight]:
        """Return the flights in other logs, judged by the same profile, that may be the same flight."""
        boots = [us_of(datetime.fromisoformat(each.flight.boot_utc or "")) for each in flight.recordings]
        if not boots:
            return []
        boards = {each.flight.board for each in flight.recordings}
        other = select(RECORDING.c.flight_id).where(
            RECORDING.c.board.in_(boards),
            RECORDING.c.boot_us.between(min(boots) - _NEAR_US, max(boots) + _NEAR_US),
        )
        same_profile = FLIGHT.c.airframe.is_not_distinct_from(flight.airframe)
        own = flight.sha256 or ""
        return self._asked(FLIGHT.c.id.in_(other), FLIGHT.c.sha256 != own, same_profile)

    def count(self, flight: PastFlight) -> int:
        """Return how many flights by the same profile were before a flight; one in several logs is one."""
        counted = select(VERDICT.c.place).where(VERDICT.c.flight_id == FLIGHT.c.id, VERDICT.c.counts)
        before = select(func.count()).where(
            FLIGHT.c.aircraft_id == self._aircraft,
            FLIGHT.c.start_us < us_of(flight.start),
            FLIGHT.c.sha256 != (flight.sha256 or ""),
            FLIGHT.c.airframe.is_not_distinct_from(flight.airframe),
            counted.exists(),
        )
        with self._reading() as connection:
            return connection.scalar(before) or 0

    @cached_property
    def _references(self) -> list[PastFlight]:
        return self._asked(FLIGHT.c.reference, ~FLIGHT.c.due)

    @cached_property
    def _all(self) -> list[PastFlight]:
        return self._asked()

    def _asked(self, *where: Any, shown: bool = False) -> list[PastFlight]:
        if self._aircraft is None:
            return []
        return past_flights(self._reading, self._aircraft, *where, shown=shown)
