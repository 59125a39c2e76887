"""What an operator enters into a store: corrections of its logs and aircraft, repairs, installed actuators.

A correction goes before the rule and the table by which scans name logs: the next scan does not undo it.
Repairs, and the operator's table of what is installed where, give the dates from which an actuator's flights
count; the store keeps both for every comparison.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any, Final, Literal, NamedTuple

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import latest
from mavhums.flights.aircraft_table import AircraftTable, Installation, Since
from mavhums.flights.store import LogFile, Store, listed_sql
from mavhums.flights.store_tables import CORRECTIONS, DATES, INSTALLED, LOGS, REMOVED

_COLUMNS: Final = "kind, log, sha256, before, after, who, note, at_ns"
_LEAST_HASH: Final = 8
_SHOWN: Final = 5
_SHOWN_NAMES: Final = 20


class Correction(NamedTuple):
    """A correction of a store.

    Attributes
    ----------
    kind
        A log was removed, restored or reassigned, or an aircraft renamed.
    log, sha256
        The log, and the hash of its bytes; None for a renamed aircraft, and the hash of a log that could not
        be judged.
    before, after
        Aircraft; None after a removal, empty for an unknown one.
    who, note, at
        Who made it, why, and when.
    """

    kind: Literal["remove", "restore", "reassign", "rename"]
    log: str | None
    sha256: str | None
    before: str | None
    after: str | None
    who: str
    note: str | None
    at: datetime

    def __str__(self) -> str:
        done = {
            "remove": f"removed {self.log} from {self.before or 'an unknown aircraft'}",
            "restore": f"restored {self.log} to {self.after or 'an unknown aircraft'}",
            "reassign": f"reassigned {self.log} from {self.before or 'an unknown aircraft'} to {self.after}",
            "rename": f"renamed {self.before} to {self.after}",
        }
        note = f": {self.note}" if self.note else ""
        return f"{self.at:%Y-%m-%d %H:%M} UTC, {self.who}: {done[self.kind]}{note}"


class FoundLog(NamedTuple):
    """A log in a store; the hash is None if it could not be judged."""

    path: str
    sha256: str | None
    aircraft: str


class Names(NamedTuple):
    """What corrections say of names: those of renamed aircraft, and the aircraft of reassigned logs."""

    aircraft: dict[str, str]
    logs: dict[str, str]


def add_corrections(store: Store, several: Iterable[Correction]) -> None:
    """Keep corrections."""
    now = time.time_ns()
    rows = [{**one._asdict(), "at_ns": now + k} for k, one in enumerate(several)]
    for row in rows:
        del row["at"]
    if rows:
        store.append(CORRECTIONS, rows)


def corrections_of(store: Store) -> list[Correction]:
    """Return the corrections of a store, the first one first."""
    rows = store.query(f"SELECT DISTINCT {_COLUMNS} FROM corrections ORDER BY at_ns").fetchall()
    return [Correction._make([*row[:-1], datetime.fromtimestamp(row[-1] / 1e9, tz=UTC)]) for row in rows]


def corrected_names(store: Store) -> Names:
    """Return the names that corrections give, each as the later ones leave it."""
    names = Names({}, {})
    for one in corrections_of(store):
        if one.kind == "reassign" and one.sha256 and one.after:
            names.logs[one.sha256] = one.after
        if one.kind == "rename" and one.before and one.after:
            for each in names:
                each.update({key: one.after for key, name in each.items() if name == one.before})
            names.aircraft[one.before] = one.after
            names.aircraft.pop(one.after, None)
    return names


def removed_logs(store: Store, logs: Iterable[str]) -> set[str]:
    """Return which of some logs, by their hashes, were removed from a store."""
    several = {*logs}
    if not several:
        return set()
    rows = store.query(f"SELECT DISTINCT sha256 FROM removed WHERE sha256 IN ({listed_sql(several)})")
    return {sha256 for (sha256,) in rows.fetchall()}


def removed_files(store: Store) -> set[LogFile]:
    """Return the files that a scan leaves alone, because their logs were removed."""
    return {LogFile(*row) for row in store.query("SELECT path, size, time_ns FROM removed").fetchall()}


def logs_named(store: Store, given: str, path: str, *, removed: bool = False) -> list[FoundLog]:
    """Return the logs in a store that a text names, with their copies elsewhere.

    Parameters
    ----------
    store
        The store.
    given
        The path or address of a log or of a folder, the end of a path, or at least eight digits of a hash.
    path
        The same as an absolute path.
    removed
        Whether to look among the removed logs instead.

    Raises
    ------
    MavhumsError
        If it names several logs that are not in one folder.
    """
    table = REMOVED if removed else LOGS
    select = f"SELECT DISTINCT path, sha256, aircraft FROM {table} WHERE"
    found: list[FoundLog] = []
    for where, values in (
        ("path IN (?, ?)", (given, path)),
        ("starts_with(path, ?) OR starts_with(path, ?)", (given.rstrip("/") + "/", path.rstrip("/") + "/")),
        ("ends_with(path, ?) OR (? AND starts_with(sha256, ?))", _loosely(given)),
    ):
        found = [FoundLog(*row) for row in store.query(f"{select} {where} ORDER BY path", *values).fetchall()]
        if found:
            break
    if "ends_with" in where and len({one.sha256 or one.path for one in found}) > 1:
        shown = ", ".join(one.path for one in found[:_SHOWN])
        raise MavhumsError(f"{given}: names {len(found)} logs of {store.place}", f"name one: {shown}")
    if not found:
        return []
    return [FoundLog(*row) for row in store.query(f"{select} {where_logs(found)} ORDER BY path").fetchall()]


def where_logs(logs: Sequence[FoundLog]) -> str:
    """Return the SQL condition of some logs: their paths, and their bytes wherever they lie."""
    hashes = {one.sha256 for one in logs if one.sha256}
    paths = f"path IN ({listed_sql({one.path for one in logs})})"
    return f"{paths} OR sha256 IN ({listed_sql(hashes)})" if hashes else paths


def _loosely(given: str) -> tuple[Any, ...]:
    return f"/{given.lstrip('/')}", len(given) >= _LEAST_HASH, given.lower()


_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


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


def add_repairs(store: Store, repairs: Repairs) -> set[str]:
    """Store repairs, and return the aircraft whose verdicts they may change: none if all were known."""
    known = set(_stored(store))
    new = [repair for repair in repairs if repair not in known]
    if not new:
        return set()
    store.append(DATES, _rows(new))
    return _concerned(store, new)


def remove_repairs(store: Store, repairs: Repairs) -> set[str]:
    """Remove stored repairs, and return the aircraft whose verdicts they may have changed.

    Raises
    ------
    MavhumsError
        If the store does not have one of them; then none is removed.
    """

    def kept() -> Repairs:
        there = _stored(store)
        for repair in repairs:
            if repair not in there:
                others = ", ".join(map(str, sorted(there, key=str))) or "none"
                raise MavhumsError(f"{store.place}: no repair {repair}", f"the store has: {others}")
        return [repair for repair in there if repair not in repairs]

    if not repairs:
        return set()
    store.rewrite(DATES, lambda: _rows(kept()))
    return _concerned(store, repairs)


def repairs_in(store: str | os.PathLike[str]) -> list[Repair]:
    """Return the repairs that a store keeps, by aircraft and date.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    there = _stored(Store(store).opened())
    return sorted(there, key=lambda repair: (repair.aircraft or "", repair.at, repair.actuator or ""))


def aircraft_in(store: Store) -> set[str]:
    """Return the names of the aircraft with flights in a store."""
    rows = store.query("SELECT DISTINCT aircraft FROM logs WHERE flight IS NOT NULL AND aircraft <> ''")
    return {name for (name,) in rows.fetchall()}


def named_in(store: Store) -> str:
    """Return which aircraft a store has, in words."""
    several = sorted(aircraft_in(store))
    more = ", …" if len(several) > _SHOWN_NAMES else ""
    return f"the store has: {', '.join(several[:_SHOWN_NAMES]) or 'none with a name'}{more}"


def repairs_of(store: Store, aircraft: str) -> Repairs:
    """Return the repairs of an aircraft."""
    return [repair for repair in _stored(store) if repair.aircraft in (None, aircraft)]


def since_of(store: Store, aircraft: str) -> Callable[[datetime], Since]:
    """Return what gives the dates from which an aircraft's flights count for one at a time.

    They are those of the repairs and of the operator's table of installed actuators, whichever is later.
    """
    return partial(_since, repairs_of(store, aircraft), installed_in(store, aircraft), aircraft)


def _since(repairs: Repairs, table: AircraftTable, aircraft: str, moment: datetime) -> Since:
    begun = sorted((repair for repair in repairs if repair.at <= moment), key=lambda repair: repair.at)
    repaired: Since = {repair.actuator: repair.at for repair in begun}
    return latest(repaired, table.since(aircraft, moment))


def reassigned(store: Store, table: AircraftTable) -> set[str]:
    """Apply a table to a store, and return the aircraft whose flights must be compared again.

    Logs are not read again. An empty table changes nothing.
    """
    if not table.installed:
        return set()
    touched: set[str] = set()
    names: dict[str, str] = {}
    pinned = corrected_names(store).logs
    for sha256, board, start_us, aircraft in store.query(
        "SELECT DISTINCT sha256, board, start_us, aircraft FROM logs"
        " WHERE board IS NOT NULL AND start_us IS NOT NULL"
    ).fetchall():
        named = table.aircraft_of(board, _EPOCH + timedelta(microseconds=start_us))
        if named is not None and named != aircraft and sha256 not in pinned:
            names[sha256] = named
            touched |= {aircraft, named}
    store.rename(names)
    return touched | _replaced(store, table)


def installed_in(store: Store, aircraft: str) -> AircraftTable:
    """Return the actuators of an aircraft, as of the last table that was given."""
    rows = store.query("SELECT entry FROM installed WHERE aircraft = ?", aircraft).fetchall()
    return AircraftTable(Installation.model_validate_json(entry) for (entry,) in rows)


def _replaced(store: Store, table: AircraftTable) -> set[str]:
    """Store the actuators of the aircraft in a table, and return the aircraft of which they changed."""
    touched: set[str] = set()
    for aircraft in sorted({each.aircraft for each in table.installed}):
        new = sorted(each.model_dump_json(by_alias=True) for each in table.of(aircraft))
        old = store.query("SELECT entry FROM installed WHERE aircraft = ? ORDER BY 1", aircraft).fetchall()
        if new != [entry for (entry,) in old]:
            store.replace(INSTALLED, aircraft, [{"aircraft": aircraft, "entry": entry} for entry in new])
            touched.add(aircraft)
    return touched


def _rows(repairs: Repairs) -> list[dict[str, object]]:
    return [
        {
            "aircraft": repair.aircraft,
            "actuator": repair.actuator,
            "since_us": (repair.at - _EPOCH) // timedelta(microseconds=1),
        }
        for repair in repairs
    ]


def _concerned(store: Store, repairs: Repairs) -> set[str]:
    """Return the aircraft with flights that repairs name."""
    named = {repair.aircraft for repair in repairs}
    there = store.query("SELECT DISTINCT aircraft FROM logs WHERE flight IS NOT NULL").fetchall()
    return {aircraft for (aircraft,) in there if None in named or aircraft in named}


def _stored(store: Store) -> list[Repair]:
    rows = store.query("SELECT DISTINCT aircraft, actuator, since_us FROM dates").fetchall()
    return [
        Repair(aircraft, actuator, _EPOCH + timedelta(microseconds=since))
        for aircraft, actuator, since in rows
    ]
