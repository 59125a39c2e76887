"""The earlier flights of an aircraft in a store: what a comparison needs of them is asked for by an index."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from datetime import datetime, timedelta
from functools import cache, cached_property, partial
from itertools import groupby
from typing import Any, Final, NamedTuple

from pydantic import TypeAdapter
from sqlalchemy import Connection, func, select

from mavhums.core.startup import no_collection
from mavhums.flights.aircraft import Since, latest
from mavhums.flights.history import (
    FlightRecording,
    PastFlight,
    Quality,
    baselines_of,
    is_healthy,
    kept_records,
    records_of,
    references,
)
from mavhums.flights.store.database import FLIGHT, RECORD, RECORDING, VERDICT, time_of, us_of
from mavhums.flights.store.logs import in_parts
from mavhums.health.decision.baseline import Baselines, PastRecord
from mavhums.health.estimation.thresholds import REFERENCE_FLIGHTS
from mavhums.log.base.decoder import Losses
from mavhums.results.assessment import Assessment, LogSummary
from mavhums.results.sections import CLOCKS_APART_S, FlightIdentity
from mavhums.results.verdict import OwnRecord, Verdict

RECENT_FLIGHTS: Final = 200
"""Flights that tell how an aircraft stands; a year of flights."""

# Twice, because a recording may be as far from the one before it as that one is from the first.
_NEAR_US: Final = round(2e6 * CLOCKS_APART_S)
OF_VERDICT: Final = (RECORD.c.flight_id == VERDICT.c.flight_id) & (RECORD.c.place == VERDICT.c.place)
_SLIM: Final = ("vehicle", "subject", "actuator", "condition", "worst", "suspect")
# More than a baseline takes: a recording may turn out to be of the same flight as a better one.
_WANTED: Final = REFERENCE_FLIGHTS + 5
OWN: Final = TypeAdapter(tuple[OwnRecord, ...])
_LOG: Final = LogSummary(path=None, sha256=None, start_utc=None, duration_s=0.0, vehicles=(), losses=Losses())
_BLOCK: Final = 32  # flights whose records are read together; a baseline takes 20

Reading = Callable[[], AbstractContextManager[Connection]]
QUALITY: Final = TypeAdapter(Quality)


def verdict_of(text: str, own: str | None = None) -> Verdict:
    """Return a stored verdict, with its record if that is given."""
    verdict = Verdict.model_validate_json(text)
    return verdict.model_copy(update={"own": OWN.validate_json(own)}) if own else verdict


def past_flights(
    connection: Connection, aircraft: int, *where: Any, records: Reading | None = None
) -> Iterator[PastFlight]:
    """Yield an aircraft's dated flights in time order, each with its verdicts and the times of its log.

    The verdicts have no records: only own-scale equations need them.

    Parameters
    ----------
    connection
        Of the store.
    aircraft
        Id of the aircraft.
    where
        Conditions on the flights and their verdicts.
    records
        Takes of the verdicts what own-scale equations need of earlier flights, and nothing else; it returns a
        connection by which the records are read when they are asked for.
    """
    columns = (FLIGHT.c.id, FLIGHT.c.path, FLIGHT.c.sha256, FLIGHT.c.start_us, FLIGHT.c.airframe)
    asked = select(*columns, FLIGHT.c.duration_s).join(VERDICT, VERDICT.c.flight_id == FLIGHT.c.id)
    if records is None:
        asked = asked.add_columns(VERDICT.c.verdict)
    else:
        asked = asked.add_columns(VERDICT.c.place, *(VERDICT.c[name] for name in _SLIM))
    asked = asked.where(FLIGHT.c.aircraft_id == aircraft, FLIGHT.c.start_us.is_not(None), *where).order_by(
        FLIGHT.c.start_us, FLIGHT.c.path, FLIGHT.c.id, VERDICT.c.place
    )
    found = connection.execute(asked).all()
    ids = [*dict.fromkeys(row.id for row in found)]
    known, kept = _recordings_in(connection, ids), _kept_in(records, ids) if records else {}
    for (flight_id, path, sha256, start_us, airframe, duration_s), rows in groupby(
        found, key=lambda row: row[:6]
    ):
        start = time_of(start_us)
        recorded = known.get(flight_id, ())
        times = {"path": path, "sha256": sha256, "start_utc": start.isoformat(), "duration_s": duration_s}
        log = _LOG.model_copy(update=times | {"flight": tuple(identity for identity, _ in recorded)})
        if records:
            # after the flight's six columns and the place: what _SLIM names
            verdicts: Any = tuple(
                _PastVerdict._make((*row[7:12], row.suspect or (), _Kept(kept[row.id], (row.id, row.place))))
                for row in rows
            )
        else:
            verdicts = tuple(verdict_of(row.verdict) for row in rows)
        # not validated again: the verdicts are parsed, or have what is asked for alone
        assessment = Assessment.model_construct(log=log, airframe=airframe, model=None, verdicts=verdicts)
        end = start + timedelta(seconds=duration_s)
        recordings = tuple(FlightRecording(identity, quality) for identity, quality in recorded if quality)
        yield PastFlight(assessment, start, end, recordings=recordings)


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


class _PastVerdict(NamedTuple):
    """What a comparison needs of a verdict, in its place: whole ones are slow to make."""

    vehicle: int | None
    subject: str
    actuator: str
    condition: str
    worst: str
    suspects: Collection[object]
    own: Sequence[OwnRecord]


class _Kept(Sequence[OwnRecord]):
    """The records of a verdict, which are read when they are asked for: a comparison takes a few flights."""

    def __init__(self, block: Callable[[], dict[tuple[int, int], str]], place: tuple[int, int]) -> None:
        self._block, self._place = block, place

    @cached_property
    def _own(self) -> tuple[OwnRecord, ...]:
        text = self._block().get(self._place)
        return OWN.validate_json(text) if text else ()

    def __getitem__(self, index: Any) -> Any:
        return self._own[index]

    def __len__(self) -> int:
        return len(self._own)


def _kept_in(reading: Reading, flights: Sequence[int]) -> dict[int, Callable[[], dict[tuple[int, int], str]]]:
    """Return what reads the records of each flight, and keeps those of the flights around it."""
    blocks: dict[int, Callable[[], dict[tuple[int, int], str]]] = {}
    for first in range(0, len(flights), _BLOCK):
        part = flights[first : first + _BLOCK]
        blocks |= dict.fromkeys(part, cache(partial(_read_records, reading, part)))
    return blocks


def _read_records(reading: Reading, flights: Sequence[int]) -> dict[tuple[int, int], str]:
    asked = select(RECORD.c.flight_id, RECORD.c.place, RECORD.c.own).where(RECORD.c.flight_id.in_(flights))
    with reading() as connection:
        return {(flight, place): own for flight, place, own in connection.execute(asked)}


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
        self._latest: dict[object, Baselines] = {}

    def since(self, moment: datetime) -> Since:
        """Return the dates from which flights count for one at a time."""
        return latest(self._since(moment), self._given(moment))

    def all(self) -> list[PastFlight]:
        """Return all flights that count, in time order."""
        return self._asked(VERDICT.c.counts)

    def recent(self) -> Sequence[PastFlight]:
        """Return the latest flights that count."""
        newest = (
            select(FLIGHT.c.start_us)
            .where(FLIGHT.c.aircraft_id == self._aircraft, FLIGHT.c.start_us.is_not(None))
            .order_by(FLIGHT.c.start_us.desc())
            .offset(RECENT_FLIGHTS - 1)
            .limit(1)
        )
        with self._reading() as connection:
            first = connection.scalar(newest)
        return self._asked(VERDICT.c.counts, *([] if first is None else [FLIGHT.c.start_us >= first]))

    def baselines(self, airframe: str | None, before: datetime | None) -> Baselines:
        """Return each actuator's baseline from all flights, as of :func:`baselines_of`.

        Without ``before``, the start of the flight under evaluation, there is no baseline.
        """
        if before is None:
            return {}
        dates = self.since(before)
        # Where other dates count than in the store, a baseline may rest on any flight.
        flights = self._references if dates == self._since(before) else self._all
        ended = tuple(flight for flight in flights if flight.end <= before)
        key = (airframe, tuple(map(id, ended)), tuple(dates.items()))
        if key not in self._latest:  # the same for all flights after the last reference
            self._latest = {key: baselines_of(ended, airframe, before, dates)}
        return self._latest[key]

    def past(
        self, airframe: str | None, before: datetime | None
    ) -> Mapping[tuple[int, str], Sequence[PastRecord]]:
        """Return the data of all flights for own-scale equations, by vehicle and actuator."""
        if before is None:
            return {}
        if self._records is None:
            # With the flights that were judged since the first one that is not there.
            judged = [] if self._before is None else [FLIGHT.c.start_us < us_of(before)]
            self._records = self._asked(*judged, records=True)
        return records_of(self._records, airframe, before, self.since(before))

    def add(self, flown: PastFlight) -> list[str]:
        """Take the next flight; return the logs on which a baseline may rest from now on.

        Other recordings of such a flight are among them: a better one that shows a fault replaces it.
        """
        dates, airframe = self.since(flown.start), flown.assessment.airframe
        ended = [flight for flight in self._references if flight.end <= flown.start]
        known = references(ended, airframe, flown.start, dates, _WANTED)
        wanted = any(
            len(known.get((verdict.vehicle or 0, verdict.actuator, shown.fault), ())) < _WANTED
            for verdict in flown.assessment.verdicts
            if is_healthy(verdict) and flown.counts(verdict.actuator, dates)
            for shown in verdict.indicators
        )
        if self._records is not None:
            self._records.append(_record_of(flown))
        near = [each for each in self.near(flown) if each.start <= flown.start]
        logs = {each.log for each in self._references}
        if not wanted and not any(each.log in logs for each in near):
            return []
        new = [flown, *(each for each in near if each.log not in logs)]
        self._references += [each.slim() for each in new]
        return [each.log for each in new]

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
        same_profile = FLIGHT.c.airframe.is_not_distinct_from(flight.assessment.airframe)
        own = flight.assessment.log.sha256 or ""
        return self._asked(FLIGHT.c.id.in_(other), FLIGHT.c.sha256 != own, same_profile)

    def count(self, flight: PastFlight) -> int:
        """Return how many flights by the same profile were before a flight; one in several logs is one."""
        counted = select(VERDICT.c.place).where(VERDICT.c.flight_id == FLIGHT.c.id, VERDICT.c.counts)
        before = select(func.count()).where(
            FLIGHT.c.aircraft_id == self._aircraft,
            FLIGHT.c.start_us < us_of(flight.start),
            FLIGHT.c.sha256 != (flight.assessment.log.sha256 or ""),
            FLIGHT.c.airframe.is_not_distinct_from(flight.assessment.airframe),
            counted.exists(),
        )
        with self._reading() as connection:
            return connection.scalar(before) or 0

    @cached_property
    def _references(self) -> list[PastFlight]:
        return self._slim(FLIGHT.c.reference)

    @cached_property
    def _all(self) -> list[PastFlight]:
        return self._slim()

    def _slim(self, *where: Any) -> list[PastFlight]:
        if self._before is not None:
            where = (*where, FLIGHT.c.start_us < self._before)
        return [flight.slim() for flight in self._asked(*where)]

    def _asked(self, *where: Any, records: bool = False) -> list[PastFlight]:
        if self._aircraft is None:
            return []
        with no_collection(), self._reading() as connection:
            records_by = self._reading if records else None
            return [*past_flights(connection, self._aircraft, *where, records=records_by)]


def _record_of(flight: PastFlight) -> PastFlight:
    """Return what own-scale equations need of a flight."""
    verdicts = tuple(
        _PastVerdict._make((*(getattr(one, name) for name in (*_SLIM[:-1], "suspects")), kept_records(one)))
        for one in flight.assessment.verdicts
    )
    slim = flight.assessment.model_copy(update={"verdicts": verdicts, "usage": ()})
    return replace(flight, assessment=slim)
