"""Puts judged logs, repairs and installed parts into a store, and gives flights to aircraft."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from datetime import datetime
from itertools import islice
from typing import Any, Final, NamedTuple

from sqlalchemy import Connection, and_, delete, insert, or_, select, update

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import UNKNOWN, AircraftTable, Installation, Since, latest
from mavhums.flights.store.database import FORMAT, LogFile, Row
from mavhums.flights.store.tables import (
    AIRCRAFT,
    ALIAS,
    BOARD,
    FLIGHT,
    JUDGEMENT,
    LOG,
    RECORDING,
    REPAIR,
    VERDICT,
    time_of,
    us_of,
)

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
        columns = {
            name: getattr(row, name) for name in ("path", "size", "time_ns", "settings", "problem", "remedy")
        }
        new = insert(LOG).values(**columns, flight_id=flight_id, scanned_us=now_us(), removed=removed)
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


_ENTRY: Final = ("board", "actuator", "serial", "begins", "ends")
_SHOWN: Final = 20


class Repair(NamedTuple):
    """A repair: flights that begin on or after it are not compared with flights before it.

    Attributes
    ----------
    aircraft
        Name of the aircraft; None for all.
    actuator
        Name of the actuator; None for all.
    at
        Date, with a time zone.
    """

    aircraft: str | None
    actuator: str | None
    at: datetime

    def __str__(self) -> str:
        at = self.at.isoformat().removesuffix("+00:00").removesuffix("T00:00:00")
        if self.aircraft is None:
            return f"{self.actuator}={at}" if self.actuator else at
        return f"{self.aircraft}/{self.actuator or ''}={at}"


Repairs = Sequence[Repair]


def repairs_of(connection: Connection, aircraft: int | None = None) -> list[Repair]:
    """Return the repairs of an aircraft, or all, by aircraft and date."""
    rows = (
        select(AIRCRAFT.c.name, REPAIR.c.actuator, REPAIR.c.since_us).select_from(REPAIR).outerjoin(AIRCRAFT)
    )
    if aircraft is not None:
        rows = rows.where(REPAIR.c.aircraft_id.is_(None) | (REPAIR.c.aircraft_id == aircraft))
    found = (Repair(name, actuator, time_of(since)) for name, actuator, since in connection.execute(rows))
    return sorted(found, key=lambda one: (one.aircraft or "", one.at, one.actuator or ""))


def enter_repairs(
    connection: Connection, place: str, *, add: Iterable[Repair] = (), remove: Iterable[Repair] = ()
) -> None:
    """Add and remove repairs; the verdicts of their aircraft are due.

    Raises
    ------
    MavhumsError
        If one that is to be removed is not there.
    """
    there = repairs_of(connection)
    for repair in remove:
        if repair not in there:
            others = ", ".join(map(str, there)) or "none"
            raise MavhumsError(f"{place}: no repair {repair}", f"the store has: {others}")
    for repair in {*remove, *(one for one in add if one not in there)}:
        whose = None if repair.aircraft is None else aircraft_id(connection, repair.aircraft)
        row = {"aircraft_id": whose, "actuator": repair.actuator, "since_us": us_of(repair.at)}
        if repair in there:
            same = (REPAIR.c[name].is_not_distinct_from(value) for name, value in row.items())
            connection.execute(delete(REPAIR).where(*same))
        else:
            connection.execute(insert(REPAIR).values(**row))
        every = select(FLIGHT.c.aircraft_id).distinct().where(FLIGHT.c.aircraft_id.is_not(None))
        make_due(connection, [whose] if whose is not None else connection.scalars(every).all())


def check_flown(connection: Connection, place: str, repairs: Repairs) -> None:
    """Refuse repairs of aircraft or actuators that no flight in the store has.

    Raises
    ------
    MavhumsError
        If there is one.
    """
    for repair in repairs:
        whose, aircraft = None, {*connection.scalars(FLOWN)}
        if repair.aircraft is not None:
            whose = aircraft_id(connection, repair.aircraft, creates=False)
            if repair.aircraft not in aircraft:
                raise MavhumsError(f"{place}: no aircraft {repair.aircraft}", _there(aircraft))
        if repair.actuator is not None:
            several = select(VERDICT.c.actuator).distinct()
            if whose is not None:
                several = several.where(VERDICT.c.aircraft_id == whose)
            actuators = {*connection.scalars(several)}
            if repair.actuator not in actuators:
                of = f" of {repair.aircraft}" if repair.aircraft else ""
                raise MavhumsError(f"{place}: no actuator {repair.actuator}{of}", _there(actuators))


def _there(names: set[str]) -> str:
    several = sorted(names)
    more = ", …" if len(several) > _SHOWN else ""
    return f"the store has: {', '.join(several[:_SHOWN]) or 'none'}{more}"


def there_are(connection: Connection) -> str:
    """Return which aircraft a store has, in words."""
    return _there({*connection.scalars(FLOWN)}).replace(" none", " none with a name")


def since_of(connection: Connection, aircraft: int | None) -> Callable[[datetime], Since]:
    """Return what gives the dates from which an aircraft's flights count for one at a time; None has none.

    They are those of the repairs and of the operator's table of installed actuators, whichever is later.
    """
    if aircraft is None:
        return lambda _: {}
    repairs, table = repairs_of(connection, aircraft), installed(connection, aircraft)
    name = connection.scalar(select(AIRCRAFT.c.name).where(AIRCRAFT.c.id == aircraft))

    def since(moment: datetime) -> Since:
        begun = sorted((repair for repair in repairs if repair.at <= moment), key=lambda repair: repair.at)
        repaired: Since = {repair.actuator: repair.at for repair in begun}
        return latest(repaired, table.since(name, moment))

    return since


def installed(connection: Connection, aircraft: int | None = None) -> AircraftTable:
    """Return what is installed in an aircraft, or in all, as of the last table that was given."""
    entries = select(AIRCRAFT.c.name.label("aircraft"), *(BOARD.c[name] for name in _ENTRY)).join(BOARD)
    if aircraft is not None:
        entries = entries.where(BOARD.c.aircraft_id == aircraft)
    rows = connection.execute(entries.order_by(BOARD.c.id)).mappings()
    return AircraftTable(
        Installation.model_validate({_ALIAS.get(k, k): v for k, v in row.items()}) for row in rows
    )


_ALIAS: Final = {"begins": "from", "ends": "to"}


def install(connection: Connection, table: AircraftTable) -> None:
    """Keep a table: its boards replace all others, and its actuators those of their aircraft.

    The verdicts of aircraft whose actuators change are due. An empty table changes nothing.
    """
    before = installed(connection)
    for name in sorted({each.aircraft for each in table.installed}):
        whose = aircraft_id(connection, name) or 0
        was = [each for each in before.installed if each.actuator and each.aircraft == name]
        now = [each for each in table.installed if each.actuator and each.aircraft == name]
        if was != now:
            connection.execute(
                delete(BOARD).where(BOARD.c.aircraft_id == whose, BOARD.c.actuator.is_not(None))
            )
            _enter(connection, now)
            make_due(connection, [whose])
    boards = [each for each in table.installed if each.board]
    if boards and boards != [each for each in before.installed if each.board]:
        connection.execute(delete(BOARD).where(BOARD.c.board.is_not(None)))
        _enter(connection, boards)


def _enter(connection: Connection, entries: Iterable[Installation]) -> None:
    for each in entries:
        entry = {name: value for name, value in each.model_dump(mode="json").items() if name in _ENTRY}
        connection.execute(insert(BOARD).values(**entry, aircraft_id=aircraft_id(connection, each.aircraft)))
