"""Puts judged logs into a store, and gives flights to aircraft."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import islice
from typing import Any, Final

from sqlalchemy import Connection, and_, delete, insert, or_, select, update

from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.store.database import FORMAT, LogFile, Row
from mavhums.flights.store.tables import AIRCRAFT, ALIAS, FLIGHT, JUDGEMENT, LOG, RECORDING, VERDICT

_OF_FLIGHT: Final = (VERDICT, RECORDING)

_AT_ONCE: Final = 500  # values in one statement; SQLite takes 32,766

FLOWN: Final = (
    select(AIRCRAFT.c.name)
    .where(AIRCRAFT.c.name != UNKNOWN)
    .where(select(FLIGHT.c.id).where(FLIGHT.c.aircraft_id == AIRCRAFT.c.id).exists())
)
"""The names of the aircraft with flights."""


def now_us() -> int:
    """Return the time, microseconds since 1970."""
    return time.time_ns() // 1000


def in_parts(values: Iterable[Any]) -> Iterator[tuple[Any, ...]]:
    """Yield values in parts that one statement takes."""
    rest = iter(values)
    while part := tuple(islice(rest, _AT_ONCE)):
        yield part


def aircraft_id(connection: Connection, name: str, *, creates: bool = True) -> int | None:
    """Return the id of the aircraft with a name, or that had it; a new one is created unless unwanted."""
    found = connection.scalar(select(ALIAS.c.aircraft_id).where(ALIAS.c.name == name))
    if found is None:
        found = connection.scalar(select(AIRCRAFT.c.id).where(AIRCRAFT.c.name == name))
    if found is None and creates:
        (found,) = connection.execute(insert(AIRCRAFT).values(name=name)).inserted_primary_key or (None,)
    return found


def former_names(connection: Connection) -> dict[str, str]:
    """Return the present name of each aircraft that was renamed, by its former ones."""
    joined = select(ALIAS.c.name, AIRCRAFT.c.name).join(AIRCRAFT)
    return dict(connection.execute(joined).all())


def known_files(connection: Connection, files: Iterable[LogFile]) -> dict[LogFile, str]:
    """Return those of the logs that were scanned, each with the settings of its latest judgement."""
    columns = (LOG.c.path, LOG.c.size, LOG.c.time_ns, LOG.c.settings)
    of_this_format = or_(LOG.c.flight_id.is_(None), FLIGHT.c.format == FORMAT)
    there = select(*columns).outerjoin(FLIGHT, FLIGHT.c.id == LOG.c.flight_id).where(of_this_format)
    return {
        LogFile(*file): settings
        for paths in in_parts({file.path for file in files})
        for *file, settings in connection.execute(there.where(~LOG.c.removed, LOG.c.path.in_(paths)))
    }


def removed_files(connection: Connection) -> set[LogFile]:
    """Return the files that a scan leaves alone, because their logs were removed."""
    rows = connection.execute(select(LOG.c.path, LOG.c.size, LOG.c.time_ns).where(LOG.c.removed))
    return {LogFile(*row) for row in rows}


def add_logs(connection: Connection, rows: Sequence[Row]) -> tuple[int, int]:
    """Add logs, and return how many were judged, and how many could not be.

    A log of the same bytes, wherever it lies, is one flight of one aircraft. A copy of a removed one is
    removed. The verdicts are due afterwards.
    """
    names: dict[str, str] = {}
    for row in sorted(rows, key=lambda row: row.path):
        if row.sha256 and row.aircraft:
            names.setdefault(row.sha256, row.aircraft)
    judged = failed = 0
    for row in rows:
        flight_id, removed = None, False
        if row.flight is None:
            failed += 1
        else:
            flight_id, removed = _add_flight(connection, row, names.get(row.sha256 or "", row.aircraft))
            judged += not removed
        file = and_(LOG.c.path == row.path, LOG.c.size == row.size, LOG.c.time_ns == row.time_ns)
        failure = and_(LOG.c.path == row.path, LOG.c.flight_id.is_(None))
        connection.execute(delete(LOG).where(or_(file, failure)))
        told = {
            name: getattr(row, name) for name in ("path", "size", "time_ns", "settings", "problem", "remedy")
        }
        new = insert(LOG).values(**told, flight_id=flight_id, scanned_us=now_us(), removed=removed)
        connection.execute(new)
    return judged, failed


def _add_flight(connection: Connection, row: Row, name: str) -> tuple[int, bool]:
    """Return the id of a log's flight, and whether it was removed."""
    content = {name: getattr(row, name) for name in ("path", "board", "start_us", "duration_s", "losses")}
    content |= {"format": FORMAT, "due": True}
    there = connection.execute(
        select(FLIGHT.c.id, FLIGHT.c.aircraft_id, FLIGHT.c.start_us, AIRCRAFT.c.name)
        .outerjoin(AIRCRAFT)
        .where(FLIGHT.c.sha256 == row.sha256)
    ).first()
    if there is None:
        new = insert(FLIGHT).values(
            **content, sha256=row.sha256, aircraft_id=aircraft_id(connection, name), came_us=now_us()
        )
        (flight_id,) = connection.execute(new).inserted_primary_key or (0,)
    else:
        flight_id, owner, start_us, known = there
        if owner is None:
            return flight_id, True
        if known == UNKNOWN and name != UNKNOWN:
            give_flights(connection, [flight_id], name)
        elif start_us != row.start_us:
            make_due(connection, [owner])
        connection.execute(update(FLIGHT).where(FLIGHT.c.id == flight_id).values(**content))
        connection.execute(delete(JUDGEMENT).where(JUDGEMENT.c.flight_id == flight_id))
    connection.execute(insert(JUDGEMENT).values(flight_id=flight_id, alone=row.flight))
    return flight_id, False


def give_flights(connection: Connection, flights: Collection[int], name: str | None) -> set[int]:
    """Give flights to an aircraft, or remove them; return the aircraft whose verdicts are due."""
    target = None if name is None else aircraft_id(connection, name)
    touched = {target} if flights else set()
    for part in in_parts(flights):
        several = FLIGHT.c.id.in_(part)
        touched |= {*connection.scalars(select(FLIGHT.c.aircraft_id).where(several).distinct())}
        connection.execute(update(FLIGHT).where(several).values(aircraft_id=target, due=target is not None))
        if target is None:
            for table in _OF_FLIGHT:
                connection.execute(delete(table).where(table.c.flight_id.in_(part)))
    found = {one for one in touched if one is not None}
    make_due(connection, found)
    return found


def make_due(connection: Connection, aircraft: Collection[int]) -> None:
    """Let the verdicts on all flights of some aircraft be made anew."""
    for part in in_parts(aircraft):
        connection.execute(update(FLIGHT).where(FLIGHT.c.aircraft_id.in_(part)).values(due=True))
