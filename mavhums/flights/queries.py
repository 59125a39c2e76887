"""Queries on a store."""

from __future__ import annotations

import os
from functools import partial
from typing import Any

from sqlalchemy import Connection, select

from mavhums.core.conditions import Condition
from mavhums.core.errors import ExitCode, MavhumsError
from mavhums.core.startup import no_collection
from mavhums.flights.aircraft import UNKNOWN, AircraftTable
from mavhums.flights.compare import unpacked
from mavhums.flights.history import PastFlight
from mavhums.flights.store import Store
from mavhums.flights.store.earlier import OF_VERDICT, StoredFlights, flights_within, verdict_of
from mavhums.flights.store.logs import aircraft_id, in_parts, since_of
from mavhums.flights.store.tables import AIRCRAFT, FLIGHT, JUDGEMENT, LOG, RECORD, STANDING, VERDICT, time_of
from mavhums.flights.store.verdicts import STANDINGS
from mavhums.log.base.decoder import Losses
from mavhums.results.assessment import Assessment, LogSummary
from mavhums.results.standing import (
    LastFlightOf,
    Standing,
    exit_code_of,
)
from mavhums.results.verdict import Verdict

Place = str | os.PathLike[str]


def worst(store: Place, *, most: int | None = None) -> list[LastFlightOf]:
    """Return every actuator as of its aircraft's last flight, the worst first.

    Parameters
    ----------
    store
        The store.
    most
        Maximum number of actuators; None for all.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    with Store(store).opened().reading() as connection:
        chosen = _ranked(connection)[:most]
        verdicts = {
            (flight, place): verdict_of(text)
            for part in in_parts(dict.fromkeys(one.flight_id for one, _ in chosen))
            for flight, place, text in connection.execute(
                select(RECORD.c.flight_id, RECORD.c.place, RECORD.c.verdict).where(
                    RECORD.c.flight_id.in_(part)
                )
            )
        }
    return [
        LastFlightOf(
            aircraft=one.aircraft or None,
            log=one.path,
            start_utc=None if one.start_us is None else time_of(one.start_us).isoformat(),
            verdict=verdicts[one.flight_id, one.place],
            standing=standing,
        )
        for one, standing in chosen
    ]


def actuators_in(store: Place) -> int:
    """Return how many actuators and axes :func:`worst` has; its errors are the same."""
    with Store(store).opened().reading() as connection:
        return len(_ranked(connection))


def _ranked(connection: Connection) -> list[tuple[Any, Standing | None]]:
    """Return the row of each actuator in its last flight and its state, the worst first."""
    states = {
        (aircraft, one.vehicle, one.actuator): one
        for aircraft, several in standings(connection).items()
        for one in sorted(several, key=lambda one: one.last_utc)
    }
    asked = (
        select(
            *(VERDICT.c[name] for name in ("flight_id", "place", "vehicle", "actuator", "start_us")),
            *(VERDICT.c[name] for name in ("condition", "worst", "urgency")),
            AIRCRAFT.c.name.label("aircraft"),
            FLIGHT.c.path,
        )
        .select_from(VERDICT)
        .join(FLIGHT, FLIGHT.c.id == VERDICT.c.flight_id)
        .join(AIRCRAFT, AIRCRAFT.c.id == VERDICT.c.aircraft_id)
        .where(VERDICT.c.last)
        .order_by(
            VERDICT.c.urgency.desc(),
            VERDICT.c.friction_nm.desc().nulls_last(),
            *(AIRCRAFT.c.name, FLIGHT.c.path, VERDICT.c.vehicle.nulls_last(), VERDICT.c.actuator),
        )
    )
    found: dict[object, tuple[Any, Standing | None]] = {}
    for row in connection.execute(asked):
        whose = row.aircraft, row.vehicle, row.actuator
        # two flights that begin at once are one place in the list
        key = whose if row.aircraft != UNKNOWN else (row.path, *whose)
        found.setdefault(key, (row, states.get((row.aircraft, row.vehicle or 0, row.actuator))))

    def rank(one: tuple[Any, Standing | None]) -> tuple[float, float]:
        row, standing = one
        return (-float(row.urgency), float("inf")) if standing is None else standing.rank[:2]

    return sorted(found.values(), key=rank)


def standings(
    connection: Connection, aircraft: str | None = None, *, until_us: int | None = None
) -> dict[str, tuple[Standing, ...]]:
    """Return the states of each named aircraft, or of one, now or at a time; worst first within each."""
    newest = select(STANDING.c.id).where(STANDING.c.aircraft_id == AIRCRAFT.c.id)
    if until_us is not None:
        newest = newest.where(STANDING.c.stored_us <= until_us)
    newest = newest.order_by(STANDING.c.stored_us.desc(), STANDING.c.id.desc()).limit(1)
    rows = select(AIRCRAFT.c.name, STANDING.c.standings).join(
        STANDING, STANDING.c.id == newest.correlate(AIRCRAFT).scalar_subquery()
    )
    if aircraft is not None:
        rows = rows.where(AIRCRAFT.c.name == aircraft)
    return {
        name: found
        for name, text in connection.execute(rows.order_by(AIRCRAFT.c.name))
        if (found := STANDINGS.validate_json(text))
    }


def exit_code(store: Place) -> ExitCode:
    """Return the exit code of ``fleet worst``: for the states and last flights, and the failures."""
    with Store(store).opened().reading() as connection:
        rows = _ranked(connection)
        failed = connection.scalar(
            select(LOG.c.id).where(LOG.c.problem.is_not(None), ~LOG.c.removed).limit(1)
        )
    found: list[Condition] = []
    for row, standing in rows:
        found += [row.condition, row.worst]
        if standing is not None:
            found += [standing.condition, "degraded" if standing.growth else "normal"]
    code = exit_code_of(found)
    if code not in (ExitCode.EMERGENCY, ExitCode.DEGRADED) and failed:
        return ExitCode.ERROR
    return code if rows else ExitCode.UNDECIDED


def verdicts(store: Place, aircraft: str) -> list[tuple[str, Verdict]]:
    """Return an aircraft's verdicts with its past, each with its log, in time order."""
    with Store(store).opened().reading() as connection:
        whose = aircraft_id(connection, aircraft, creates=False)
        return _verdicts(connection, VERDICT.c.aircraft_id == whose, VERDICT.c.counts)


def stored_verdicts(connection: Connection, sha256: str) -> tuple[Verdict, ...]:
    """Return the verdicts on a log, compared with its aircraft's past."""
    return tuple(verdict for _, verdict in _verdicts(connection, FLIGHT.c.sha256 == sha256))


def _verdicts(connection: Connection, *where: Any) -> list[tuple[str, Verdict]]:
    """Return whole verdicts in time order, each with the path of its log."""
    asked = (
        select(FLIGHT.c.path, RECORD.c.verdict, RECORD.c.own)
        .join(VERDICT, VERDICT.c.flight_id == FLIGHT.c.id)
        .join(RECORD, OF_VERDICT)
        .where(*where)
        .order_by(FLIGHT.c.start_us.nulls_last(), FLIGHT.c.path, FLIGHT.c.id, VERDICT.c.place)
    )
    return [(path, verdict_of(text, own)) for path, text, own in connection.execute(asked)]


def flights(store: Place, aircraft: str, *, most: int | None = None) -> list[Assessment]:
    """Return an aircraft's dated flights in time order, with verdicts only: without losses, usage and texts.

    Parameters
    ----------
    store
        The store.
    aircraft
        Name of the aircraft.
    most
        Maximum number of flights, of the latest ones; None for all.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    with Store(store).opened().reading() as connection, no_collection():
        whose = aircraft_id(connection, aircraft, creates=False)
        return [*map(_assessment, flights_within(connection, whose).latest(most))]


def _assessment(flight: PastFlight) -> Assessment:
    log = LogSummary(
        path=flight.path,
        sha256=flight.sha256,
        start_utc=flight.start.isoformat(),
        duration_s=(flight.end - flight.start).total_seconds(),
        vehicles=(),
        losses=Losses(),
        flight=flight.flights,
    )
    verdicts = tuple(one.whole() for one in flight.verdicts)
    # not validated again: the parts are
    return Assessment.model_construct(log=log, airframe=flight.airframe, model=None, verdicts=verdicts)


def earlier_flights(store: Store, aircraft: str | None, given: AircraftTable | None = None) -> StoredFlights:
    """Return an aircraft's flights, none without a name, for comparisons as a given table dates them, too."""
    with store.reading() as connection:
        whose = None if aircraft is None else aircraft_id(connection, aircraft, creates=False)
        since = since_of(connection, whose)
    table = given or AircraftTable()
    return StoredFlights(store.reading, whose, since, given=partial(table.since, aircraft))


def flight(store: Place, aircraft: str, sha256: str) -> Assessment:
    """Return the whole assessment of a log, its verdicts compared with the aircraft's past.

    Raises
    ------
    MavhumsError
        If the store does not exist or does not have the log.
    """
    with Store(store).opened().reading() as connection:
        own = FLIGHT.c.aircraft_id == aircraft_id(connection, aircraft, creates=False)
        row = connection.execute(
            select(JUDGEMENT.c.alone)
            .join(FLIGHT, FLIGHT.c.id == JUDGEMENT.c.flight_id)
            .where(FLIGHT.c.sha256 == sha256, own)
        ).first()
        if row is None:
            problem = f"{store}: no such flight of the aircraft {aircraft!r}"
            raise MavhumsError(problem, "choose one of its list")
        alone = unpacked(row.alone).assessment
        found = stored_verdicts(connection, sha256)
    return alone.model_copy(update={"verdicts": found}) if found else alone
