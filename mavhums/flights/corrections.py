"""Corrects a store: removes logs, moves them to another aircraft, renames an aircraft, and undoes that.

Each correction is a row of a journal. It, and the verdicts that it changes, are one transaction; no log is
opened. Later scans leave what was corrected.
"""

from __future__ import annotations

import getpass
import json
import os
import socket
from collections import defaultdict
from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

from sqlalchemy import Connection, delete, func, insert, or_, select, update

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.store import Store
from mavhums.flights.store.logs import (
    FLOWN,
    Repair,
    Repairs,
    aircraft_id,
    check_flown,
    enter_repairs,
    give_flights,
    in_parts,
    make_due,
    now_us,
    repairs_of,
    there_are,
)
from mavhums.flights.store.tables import AIRCRAFT, ALIAS, BOARD, FLIGHT, JOURNAL, LOG, REPAIR, time_of
from mavhums.flights.store.verdicts import make_verdicts

Place = str | os.PathLike[str]

_LEAST_HASH: Final = 8
_SHOWN: Final = 5


class CorrectedLog(NamedTuple):
    """A log before its correction; one that could not be judged has no hash and no aircraft."""

    path: str
    sha256: str | None
    aircraft: str
    pinned: bool


class Correction(NamedTuple):
    """A correction of a store.

    Attributes
    ----------
    number
        By which it can be undone.
    kind
        ``remove``, ``move`` (to another aircraft) or ``rename`` (an aircraft).
    logs
        The logs; those of both aircraft where two became one, and none where one was renamed.
    before, after
        Names of the renamed aircraft; of moved logs, ``after`` is the aircraft that has them.
    who, note, at
        Who made it, why, and when.
    undone
        Whether it was undone.
    """

    number: int
    kind: str
    logs: tuple[CorrectedLog, ...]
    before: str | None
    after: str | None
    who: str
    note: str | None
    at: datetime
    undone: bool = False

    def __str__(self) -> str:
        first = self.logs[0].path if self.logs else ""
        logs = first if len(self.logs) == 1 else f"{len(self.logs)} logs, {first} and others,"
        whose = " and ".join(sorted({one.aircraft or "an unknown aircraft" for one in self.logs}))
        done = {
            "remove": f"removed {logs} from {whose}",
            "move": f"moved {logs} from {whose} to {self.after}",
            "rename": f"renamed {self.before} to {self.after}",
        }
        note, undone = f": {self.note}" if self.note else "", " (undone)" if self.undone else ""
        return f"{self.number}: {self.at:%Y-%m-%d %H:%M} UTC, {self.who}: {done[self.kind]}{note}{undone}"


def journal(store: Place) -> list[Correction]:
    """Return the corrections of a store, the first one first.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    with Store(store).opened().reading() as connection:
        return [_correction(row) for row in connection.execute(select(JOURNAL).order_by(JOURNAL.c.id))]


def remove(
    store: Place, logs: Sequence[Place], *, who: str | None = None, note: str | None = None
) -> Correction | None:
    """Remove logs from a store; later scans leave them alone, under other paths, too.

    Parameters
    ----------
    store
        The store.
    logs
        Paths or addresses of logs or folders as the store has them, ends of paths, or digits of hashes.
    who, note
        Who corrects it, by default the user, and why.

    Returns
    -------
    Correction
        What was changed; None if the logs were removed already.

    Raises
    ------
    MavhumsError
        If the store has no such log, does not exist or cannot be written.
    """
    kept = Store(store).opened()
    with kept.writing() as connection:
        found = [one for log in logs for one in _found(connection, kept, log)]
        rows = [row for row in dict.fromkeys(found) if not row.removed]
        done = _entered(connection, "remove", rows, who=who, note=note)
        _remove(connection, rows)
    return done


def move(
    store: Place, logs: Sequence[Place], aircraft: str, *, who: str | None = None, note: str | None = None
) -> Correction | None:
    """Give logs to another aircraft; later scans leave them there, whatever rule or table they are given.

    Parameters
    ----------
    aircraft
        Its name; a new one founds it. The one that they have already confirms it, whatever their board says.
        The other parameters, the result and the errors are those of :func:`remove`.
    """
    _check_name(aircraft)
    kept = Store(store).opened()
    with kept.writing() as connection:
        rows = [
            row
            for log in logs
            for row in _found(connection, kept, log)
            if row.flight_id is not None and not row.removed and (row.name != aircraft or not row.pinned)
        ]
        rows = [*dict.fromkeys(rows)]
        done = _entered(connection, "move", rows, after=aircraft, who=who, note=note)
        flights = {row.flight_id for row in rows}
        touched = give_flights(connection, {row.flight_id for row in rows if row.name != aircraft}, aircraft)
        _pin(connection, flights, pinned=True)
        make_verdicts(connection, touched)
    return done


def rename(
    store: Place,
    aircraft: str,
    name: str,
    *,
    join: bool = False,
    who: str | None = None,
    note: str | None = None,
) -> Correction | None:
    """Rename an aircraft, with its repairs, installed actuators and history; later scans do so, too.

    Parameters
    ----------
    aircraft, name
        The name that it has, and the one that it gets.
    join
        Whether an aircraft that has that name already becomes one with it. The other parameters, the result
        and the errors are those of :func:`remove`.
    """
    _check_name(name)
    kept = Store(store).opened()
    with kept.writing() as connection:
        there = {*connection.scalars(FLOWN)}
        whose = aircraft_id(connection, aircraft, creates=False)
        other = connection.scalar(select(AIRCRAFT.c.id).where(AIRCRAFT.c.name == name))
        if whose is not None and whose == other:
            return None
        if whose is None or aircraft not in there:
            raise MavhumsError(f"{kept.place}: no aircraft {aircraft}", there_are(connection))
        if name in there and not join:
            raise MavhumsError(f"{kept.place}: {name} is there already", "--join makes one aircraft of both")
        rows = [] if other is None else _logs(connection, FLIGHT.c.aircraft_id == whose)
        done = _entered(connection, "rename", rows, before=aircraft, after=name, who=who, note=note)
        if other is None:
            _call(connection, whose, name)
        else:
            _join(connection, whose, other, aircraft)
            touched = give_flights(connection, {row.flight_id for row in rows if row.flight_id}, name)
            make_verdicts(connection, touched)
    return done


def undo(store: Place, number: int) -> Correction:
    """Undo a correction, and return it; its errors are those of :func:`remove`.

    Parameters
    ----------
    store
        The store.
    number
        The correction's number in the journal.
    """
    kept = Store(store).opened()
    with kept.writing() as connection:
        row = connection.execute(select(JOURNAL).where(JOURNAL.c.id == number)).first()
        if row is None or row.undone:
            why = "is undone already" if row else "is not in the journal"
            remedy = f"list them: mavhums fleet journal --store {kept.place}"
            raise MavhumsError(f"{kept.place}: the correction {number} {why}", remedy)
        done = _correction(row)
        connection.execute(update(JOURNAL).where(JOURNAL.c.id == number).values(undone=True))
        if done.kind == "rename" and done.before is not None and done.after is not None:
            connection.execute(delete(ALIAS).where(ALIAS.c.name == done.before))
            whose = aircraft_id(connection, done.after, creates=False)
            if not done.logs and whose is not None:
                connection.execute(update(AIRCRAFT).where(AIRCRAFT.c.id == whose).values(name=done.before))
        owners: dict[str, set[int]] = defaultdict(set)
        pinned: dict[bool, set[int]] = defaultdict(set)
        for log in done.logs:
            same = LOG.c.path == log.path if log.sha256 is None else FLIGHT.c.sha256 == log.sha256
            for found in _logs(connection, same):
                connection.execute(update(LOG).where(LOG.c.id == found.id).values(removed=False))
                if found.flight_id is not None:
                    owners[log.aircraft].add(found.flight_id)
                    pinned[log.pinned].add(found.flight_id)
        touched: set[int] = set()
        for name, flights in owners.items():
            touched |= give_flights(connection, flights, name)
        for was, flights in pinned.items():
            _pin(connection, flights, pinned=was)
        make_verdicts(connection, touched)
    return done._replace(undone=True)


def repairs_in(store: Place) -> list[Repair]:
    """Return the repairs that a store keeps, by aircraft and date.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    with Store(store).opened().reading() as connection:
        return repairs_of(connection)


def change_repairs(store: Place, *, add: Repairs = (), remove: Repairs = ()) -> list[Repair]:
    """Add and remove repairs, compare the flights of their aircraft again, and return all repairs.

    Parameters
    ----------
    store
        File or address of the store.
    add
        Repairs to be stored; one that is there already changes nothing.
    remove
        Repairs that were entered by mistake.

    Raises
    ------
    MavhumsError
        If the store does not exist or cannot be written, or it does not have a repair that is to be removed,
        or the aircraft or actuator of one that is to be added.
    """
    kept = Store(store).opened()
    with kept.writing() as connection:
        check_flown(connection, kept.place, add)
        enter_repairs(connection, kept.place, add=add, remove=remove)
        make_verdicts(connection)
        return repairs_of(connection)


def _call(connection: Connection, aircraft: int, name: str) -> None:
    """Give an aircraft a name, and keep the one that it had."""
    before = connection.scalar(select(AIRCRAFT.c.name).where(AIRCRAFT.c.id == aircraft))
    connection.execute(delete(ALIAS).where(ALIAS.c.name == name))
    connection.execute(update(AIRCRAFT).where(AIRCRAFT.c.id == aircraft).values(name=name))
    connection.execute(insert(ALIAS).values(name=before, aircraft_id=aircraft))


def _join(connection: Connection, aircraft: int, other: int, name: str) -> None:
    """Let an aircraft's name, and what the operator entered of it, be another one's."""
    for table in (ALIAS, REPAIR, BOARD):
        connection.execute(update(table).where(table.c.aircraft_id == aircraft).values(aircraft_id=other))
    connection.execute(insert(ALIAS).values(name=name, aircraft_id=other))
    make_due(connection, [other])


def _remove(connection: Connection, rows: Sequence[Any]) -> None:
    for part in in_parts({row.id for row in rows}):
        connection.execute(update(LOG).where(LOG.c.id.in_(part)).values(removed=True))
    flights = {row.flight_id for row in rows if row.flight_id is not None}
    make_verdicts(connection, give_flights(connection, flights, None))


def _pin(connection: Connection, flights: Iterable[int], *, pinned: bool) -> None:
    for part in in_parts(flights):
        connection.execute(update(FLIGHT).where(FLIGHT.c.id.in_(part)).values(pinned=pinned))


def _logs(connection: Connection, *where: Any) -> list[Any]:
    """Return logs in a store, with their flights and aircraft."""
    columns = (LOG.c.id, LOG.c.path, LOG.c.flight_id, LOG.c.removed, FLIGHT.c.sha256, FLIGHT.c.pinned)
    asked = select(*columns, func.coalesce(AIRCRAFT.c.name, UNKNOWN).label("name")).select_from(LOG)
    asked = asked.outerjoin(FLIGHT, FLIGHT.c.id == LOG.c.flight_id).outerjoin(
        AIRCRAFT, AIRCRAFT.c.id == FLIGHT.c.aircraft_id
    )
    return [*connection.execute(asked.where(*where).order_by(LOG.c.path, LOG.c.id))]


def _found(connection: Connection, store: Store, log: Place) -> list[Any]:
    """Return the logs that a text names, with their copies elsewhere.

    Raises
    ------
    MavhumsError
        If it names none, or several that are not in one folder.
    """
    given = os.fspath(log)
    path = given if "://" in given else str(Path(given).absolute())
    folders = [f"{each.rstrip('/')}/" for each in (given, path)]
    loosely = LOG.c.path.endswith(f"/{given.lstrip('/')}", autoescape=True)
    if len(given) >= _LEAST_HASH:
        loosely = or_(loosely, FLIGHT.c.sha256.startswith(given.lower(), autoescape=True))
    found: list[Any] = []
    for where in (
        LOG.c.path.in_([given, path]),
        or_(*(LOG.c.path.startswith(each, autoescape=True) for each in folders)),
        loosely,
    ):
        found = _logs(connection, where)
        if found:
            break
    if where is loosely and len({row.sha256 or row.path for row in found}) > 1:
        shown = ", ".join(row.path for row in found[:_SHOWN])
        raise MavhumsError(f"{given}: names {len(found)} logs of {store.place}", f"name one: {shown}")
    if not found:
        remedy = "name its path as `mavhums fleet export` shows it"
        raise MavhumsError(f"{store.place}: no log {given}", remedy)
    flights = {row.flight_id for row in found if row.flight_id is not None}
    copies = [row for part in in_parts(flights) for row in _logs(connection, LOG.c.flight_id.in_(part))]
    return sorted({*found, *copies}, key=lambda row: (row.path, row.id))


def _entered(
    connection: Connection, kind: str, rows: Sequence[Any], *, who: str | None, note: str | None, **names: str
) -> Correction | None:
    """Enter a correction into the journal, and return it; None if it changes nothing."""
    if not rows and kind != "rename":
        return None
    logs = [CorrectedLog(row.path, row.sha256, row.name, bool(row.pinned)) for row in rows]
    row = {"kind": kind, "who": who or _user(), "note": note, "logs": json.dumps(logs), "at_us": now_us()}
    (number,) = connection.execute(insert(JOURNAL).values(**row, **names)).inserted_primary_key or (0,)
    return _correction(connection.execute(select(JOURNAL).where(JOURNAL.c.id == number)).one())


def _correction(row: Any) -> Correction:
    logs = tuple(CorrectedLog(*log) for log in json.loads(row.logs))
    at = time_of(row.at_us)
    return Correction(row.id, row.kind, logs, row.before, row.after, row.who, row.note, at, row.undone)


def _user() -> str:
    try:
        name = getpass.getuser()
    except (KeyError, OSError):  # a container's user without a name
        name = f"user {os.getuid()}" if hasattr(os, "getuid") else "unknown"
    return f"{name}@{socket.gethostname()}"


def _check_name(aircraft: str) -> None:
    if aircraft.strip() == UNKNOWN or aircraft != aircraft.strip():
        raise MavhumsError(f"{aircraft!r}: is no name of an aircraft", "name it, such as D-EABC")
