"""Dates from which an actuator's flights count: repairs, and the operator's table of what is installed where.

The store keeps both for every comparison.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import NamedTuple

from mavhums.core.errors import MavhumsError
from mavhums.flights.aircraft import latest
from mavhums.flights.aircraft_table import AircraftTable, Installed, Since
from mavhums.flights.corrections import corrected_names
from mavhums.flights.stores.delta import Store
from mavhums.flights.stores.delta_tables import DATES

__all__ = [
    "Repair",
    "Repairs",
    "add_repairs",
    "aircraft_in",
    "installed_in",
    "named_in",
    "reassigned",
    "remove_repairs",
    "repairs_in",
    "repairs_of",
    "since_of",
]

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
                told = ", ".join(map(str, sorted(there, key=str))) or "none"
                raise MavhumsError(f"{store.place}: no repair {repair}", f"the store has: {told}")
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
    return f"the store has: {', '.join(sorted(aircraft_in(store))) or 'none with a name'}"


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
    return AircraftTable(Installed.model_validate_json(entry) for (entry,) in rows)


def _replaced(store: Store, table: AircraftTable) -> set[str]:
    """Store the actuators of the aircraft in a table, and return the aircraft of which they changed."""
    touched: set[str] = set()
    for aircraft in sorted({each.aircraft for each in table.installed}):
        new = sorted(each.model_dump_json(by_alias=True) for each in table.of(aircraft))
        old = store.query("SELECT entry FROM installed WHERE aircraft = ? ORDER BY 1", aircraft).fetchall()
        if new != [entry for (entry,) in old]:
            store.replace_installed(aircraft, [{"aircraft": aircraft, "entry": entry} for entry in new])
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
