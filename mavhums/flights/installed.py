"""The operator's table in a store: it names the aircraft of the logs there, and dates their actuators."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from mavhums.flights.aircraft_table import AircraftTable, Installed
from mavhums.flights.stores.delta import Store

__all__ = ["installed_in", "reassigned"]

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def reassigned(store: Store, table: AircraftTable) -> set[str]:
    """Apply a table to a store, and return the aircraft whose flights must be compared again.

    Logs are not read again. An empty table changes nothing.
    """
    if not table.installed:
        return set()
    touched: set[str] = set()
    names: dict[str, str] = {}
    for sha256, board, start_us, aircraft in store.query(
        "SELECT DISTINCT sha256, board, start_us, aircraft FROM logs"
        " WHERE board IS NOT NULL AND start_us IS NOT NULL"
    ).fetchall():
        named = table.aircraft_of(board, _EPOCH + timedelta(microseconds=start_us))
        if named is not None and named != aircraft:
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
