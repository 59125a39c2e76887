"""What an operator enters of aircraft: repairs, and installed boards and actuators, with dates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from typing import Final, NamedTuple

from sqlalchemy import Connection, delete, insert, select

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import AircraftTable, Installation, Since, latest
from mavhums.flights.store.earlier import time_of, us_of
from mavhums.flights.store.logs import FLOWN, aircraft_id, make_due
from mavhums.flights.store.tables import AIRCRAFT, BOARD, FLIGHT, REPAIR, VERDICT

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


def since_of(connection: Connection, aircraft: int) -> Callable[[datetime], Since]:
    """Return what gives the dates from which an aircraft's flights count for one at a time.

    They are those of the repairs and of the operator's table of installed actuators, whichever is later.
    """
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
