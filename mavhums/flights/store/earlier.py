"""The earlier flights of an aircraft in a store: what a comparison needs of them is asked for by an index."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from itertools import groupby
from typing import Any, Final

from pydantic import TypeAdapter
from sqlalchemy import Connection, select

from mavhums.core.errors import MavhumsError
from mavhums.core.startup import no_collection
from mavhums.flights.aircraft import KnownAircraft
from mavhums.flights.aircraft_table import Since
from mavhums.flights.duplicates import Quality, Recording
from mavhums.flights.history import FlightHistory, PastFlight, is_healthy, kept_records
from mavhums.flights.store.tables import FLIGHT, RECORD, RECORDING, VERDICT
from mavhums.health.decision.baseline import Baselines, PastRecord
from mavhums.health.self_baseline.thresholds import REFERENCE_FLIGHTS
from mavhums.log.base.decoder import Losses
from mavhums.results.assessment import Assessment, LogSummary
from mavhums.results.sections import FlightIdentity
from mavhums.results.verdict import OwnRecord, Suspect, Verdict

RECENT_FLIGHTS: Final = 200
"""Flights that tell how an aircraft stands; a year of flights."""

EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
OF_VERDICT: Final = (RECORD.c.flight_id == VERDICT.c.flight_id) & (RECORD.c.place == VERDICT.c.place)
_SLIM: Final = ("vehicle", "subject", "actuator", "condition", "worst", "suspect")
# More than a baseline takes: a recording may turn out to be of the same flight as a better one.
_WANTED: Final = REFERENCE_FLIGHTS + 5
OWN: Final = TypeAdapter(tuple[OwnRecord, ...])
QUALITY: Final = TypeAdapter(Quality)


def us_of(moment: datetime) -> int:
    """Return a time as the tables have it."""
    return (moment - EPOCH) // timedelta(microseconds=1)


def verdict_of(text: str, own: str | None = None) -> Verdict:
    """Return a stored verdict, with its record if that is given."""
    verdict = Verdict.model_validate_json(text)
    return verdict.model_copy(update={"own": OWN.validate_json(own)}) if own else verdict


def past_flights(
    connection: Connection, aircraft: int, *where: Any, records: bool = False
) -> Iterator[PastFlight]:
    """Yield an aircraft's dated flights in time order, each with its verdicts and the times of its log.

    Parameters
    ----------
    connection
        Of the store.
    aircraft
        Id of the aircraft.
    where
        Conditions on the flights and their verdicts.
    records
        Whether to take of the verdicts what own-scale equations need of earlier flights, and nothing else.
    """
    columns = (FLIGHT.c.id, FLIGHT.c.path, FLIGHT.c.sha256, FLIGHT.c.start_us, FLIGHT.c.airframe)
    shown = [VERDICT.c[name] for name in _SLIM] if records else [VERDICT.c.verdict]
    asked = (
        select(*columns, FLIGHT.c.duration_s, *shown, RECORD.c.own)
        .join(VERDICT, VERDICT.c.flight_id == FLIGHT.c.id)
        .outerjoin(RECORD, OF_VERDICT)
        .where(FLIGHT.c.aircraft_id == aircraft, FLIGHT.c.start_us.is_not(None), *where)
        .order_by(FLIGHT.c.start_us, FLIGHT.c.path, FLIGHT.c.id, VERDICT.c.place)
    )
    # All rows at once: the recordings are asked for meanwhile.
    for (flight_id, path, sha256, start_us, airframe, duration_s), rows in groupby(
        connection.execute(asked).all(), key=lambda row: row[:6]
    ):
        start = EPOCH + timedelta(microseconds=start_us)
        identities, recordings = recordings_in(connection, flight_id)
        log = LogSummary(
            path=path,
            sha256=sha256,
            start_utc=start.isoformat(),
            duration_s=duration_s,
            vehicles=(),
            losses=Losses(),
            flight=identities,
        )
        verdicts = tuple(_slim_verdict(row) if records else verdict_of(row.verdict) for row in rows)
        # not validated again: the verdicts are parsed, or have what is asked for alone
        assessment = Assessment.model_construct(log=log, airframe=airframe, model=None, verdicts=verdicts)
        end = start + timedelta(seconds=duration_s)
        yield PastFlight(assessment, start, end, recordings=recordings)


def recordings_in(
    connection: Connection, flight: int
) -> tuple[tuple[FlightIdentity, ...], tuple[Recording, ...]]:
    """Return a flight's identities, and its recordings: those whose time and board are known."""
    columns = (RECORDING.c.identity, RECORDING.c.quality)
    rows = connection.execute(
        select(*columns).where(RECORDING.c.flight_id == flight).order_by(RECORDING.c.vehicle)
    )
    found = [(FlightIdentity.model_validate_json(identity), quality) for identity, quality in rows]
    recorded = (Recording(one, QUALITY.validate_json(quality)) for one, quality in found if quality)
    return tuple(one for one, _ in found), tuple(recorded)


def _slim_verdict(row: Any) -> Verdict:
    told = {name: getattr(row, name) for name in _SLIM if name != "suspect"}
    suspects = (Suspect.model_construct(fault=row.suspect),) if row.suspect else ()
    own = OWN.validate_json(row.own) if row.own else ()
    return Verdict.model_construct(**told, suspects=suspects, own=own)


class StoredFlights:
    """The earlier flights of an aircraft, as :class:`mavhums.flights.history.EarlierFlights`.

    Parameters
    ----------
    reading
        Returns a connection to the store.
    aircraft
        Id of the aircraft; None for one without flights.
    since
        Returns the dates from which an actuator's flights count at a time, as the store has them.
    name
        What it is called in messages.
    before_us
        Start of the first flight that is not there; None for none.
    """

    errors: tuple[MavhumsError, ...] = ()
    notices: tuple[str, ...] = ()

    def __init__(
        self,
        reading: Callable[[], AbstractContextManager[Connection]],
        aircraft: int | None,
        since: Callable[[datetime], Since],
        *,
        name: str = "the store",
        before_us: int | None = None,
    ) -> None:
        self.name = name
        self._reading, self._aircraft, self.since = reading, aircraft, since
        self._before = before_us
        self._records: list[PastFlight] | None = None
        self._latest: dict[object, Baselines] = {}

    @property
    def flights(self) -> tuple[PastFlight, ...]:
        """All flights that count, in time order."""
        return tuple(self._asked(VERDICT.c.counts))

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

    def baselines(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Baselines:
        """Return the same as :meth:`FlightHistory.baselines` for all flights."""
        if before is None:
            return {}
        dates = self.since(before) if since is None else since
        # Where other dates count than in the store, a baseline may rest on any flight.
        flights = self._references if dict(dates) == dict(self.since(before)) else self._all
        ended = tuple(flight for flight in flights if flight.end <= before)
        key = (airframe, tuple(map(id, ended)), tuple(dates.items()))
        if key not in self._latest:  # the same for all flights after the last reference
            self._latest = {key: FlightHistory(ended).baselines(airframe, before, dates)}
        return self._latest[key]

    def past(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Mapping[tuple[int, str], Sequence[PastRecord]]:
        """Return the same as :meth:`FlightHistory.past` for all flights."""
        if before is None:
            return {}
        dates = self.since(before) if since is None else since
        if self._records is None:
            # With the flights that were judged since the first one that is not there.
            judged = [] if self._before is None else [FLIGHT.c.start_us < us_of(before)]
            self._records = self._asked(*judged, records=True)
        return FlightHistory(tuple(self._records)).past(airframe, before, dates)

    def add(self, flown: PastFlight) -> bool:
        """Take the next flight, and return whether a baseline may rest on it."""
        dates, airframe = self.since(flown.start), flown.assessment.airframe
        ended = FlightHistory(tuple(flight for flight in self._references if flight.end <= flown.start))
        known = ended.references(airframe, flown.start, dates, _WANTED)
        wanted = any(
            len(known.get((verdict.vehicle or 0, verdict.actuator, shown.fault), ())) < _WANTED
            for verdict in flown.assessment.verdicts
            if is_healthy(verdict) and flown.counts(verdict.actuator, dates)
            for shown in verdict.indicators
        )
        if wanted:
            self._references.append(flown.without("evidence", "provenance", "own"))
        if self._records is not None:
            self._records.append(_record_of(flown))
        return wanted

    def owners(self) -> list[KnownAircraft]:
        """Return nothing: whose the flights are is decided when they come into the store."""
        return []

    def near(self, flight: PastFlight) -> list[PastFlight]:
        """Return nothing: other recordings of a flight are found when they come into the store."""
        return []

    def with_flight(self, assessment: Assessment) -> StoredFlights:
        """Return the flights: the store has the new one, too."""
        return self

    @cached_property
    def _references(self) -> list[PastFlight]:
        return self._slim(FLIGHT.c.reference)

    @cached_property
    def _all(self) -> list[PastFlight]:
        return self._slim()

    def _slim(self, *where: Any) -> list[PastFlight]:
        if self._before is not None:
            where = (*where, FLIGHT.c.start_us < self._before)
        return [flight.without("evidence", "provenance") for flight in self._asked(*where)]

    def _asked(self, *where: Any, records: bool = False) -> list[PastFlight]:
        if self._aircraft is None:
            return []
        with no_collection(), self._reading() as connection:
            return [*past_flights(connection, self._aircraft, *where, records=records)]


def _record_of(flight: PastFlight) -> PastFlight:
    """Return what own-scale equations need of a flight."""
    verdicts = tuple(
        Verdict.model_construct(
            **{name: getattr(one, name) for name in (*_SLIM[:-1], "suspects")}, own=kept_records(one)
        )
        for one in flight.assessment.verdicts
    )
    slim = flight.assessment.model_copy(update={"verdicts": verdicts, "usage": ()})
    return replace(flight, assessment=slim)
