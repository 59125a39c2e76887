"""Checkpoint of an aircraft in a store: flights with final verdicts, and what the next one needs of them."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from typing import Final, NamedTuple

from mavhums.core.about import __version__
from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.repairs import installed_in, repairs_of
from mavhums.flights.stores.delta import FORMAT, OF_THIS_FORMAT, Store
from mavhums.flights.stores.delta_tables import SETTLED

__all__ = ["Listed", "listed", "read_checkpoint", "stamp_of", "store_checkpoint"]

_VERSION: Final = 1
_MOST_NEW: Final = 1_000


class Listed(NamedTuple):
    """A flight of an aircraft: its log, the time of its latest judgement, its start and its path."""

    sha256: str
    scanned: int
    start_us: int | None
    path: str


def listed(store: Store, aircraft: str) -> list[Listed]:
    """Return an aircraft's flights in time order, each log once; those without a date are last."""
    rows = store.query(
        "SELECT sha256, max(scanned), min(start_us), min(path) FROM logs WHERE aircraft = ?"
        f" AND sha256 IS NOT NULL AND {OF_THIS_FORMAT} GROUP BY sha256 ORDER BY min(start_us), min(path)",
        aircraft,
    ).fetchall()
    return [Listed(*row) for row in rows]


def stamp_of(store: Store, aircraft: str) -> str:
    """Return what the verdicts of an aircraft depend on besides its flights, as text."""
    dates = repairs_of(store, aircraft)
    repairs = sorted(json.dumps([repair.actuator, repair.at.isoformat()]) for repair in dates)
    table = sorted(each.model_dump_json(by_alias=True) for each in installed_in(store, aircraft).installed)
    return json.dumps([_VERSION, FORMAT, __version__, aircraft, repairs, table])


def read_checkpoint(
    store: Store, aircraft: str, flights: Sequence[Listed], stamp: str
) -> tuple[bytes, list[Listed]] | None:
    """Return what is known of the settled flights, and the new ones; None if all must be judged again.

    Parameters
    ----------
    store
        The store.
    aircraft
        Name of the aircraft.
    flights
        All its flights, in time order.
    stamp
        What its verdicts depend on besides.
    """
    row = store.query(
        "SELECT scanned, digest, known FROM settled WHERE aircraft = ? ORDER BY stored DESC LIMIT 1", aircraft
    ).fetchone()
    if row is None or row[2] is None:
        return None
    scanned, digest, known = row
    settled = [flight for flight in flights if flight.scanned <= scanned]
    new = [flight for flight in flights if flight.scanned > scanned]
    if len(new) > _MOST_NEW or _digest(settled, stamp) != digest or not _follow(settled, new, aircraft):
        return None
    if _without_verdicts(store, aircraft) != {flight.sha256 for flight in new}:
        return None
    return known, new


def store_checkpoint(
    store: Store, aircraft: str, flights: Sequence[Listed], stamp: str, known: bytes | None
) -> None:
    """Commit what is known of an aircraft's flights; None if the next one shall be judged with all."""
    row: dict[str, object] = {
        "aircraft": aircraft,
        "scanned": max((flight.scanned for flight in flights), default=0),
        "digest": _digest(flights, stamp),
        "known": known,
        "stored": time.time_ns(),
    }
    store.append(SETTLED, [row])


def _follow(settled: Sequence[Listed], new: Sequence[Listed], aircraft: str) -> bool:
    """Return whether all new flights with a date come after those that are settled."""
    if aircraft == UNKNOWN:
        return True
    before = [(flight.start_us, flight.path) for flight in settled if flight.start_us is not None]
    after = [(flight.start_us, flight.path) for flight in new if flight.start_us is not None]
    return not before or not after or before[-1] < after[0]


def _without_verdicts(store: Store, aircraft: str) -> set[str]:
    rows = store.query(
        f"SELECT DISTINCT sha256 FROM logs WHERE aircraft = $1 AND sha256 IS NOT NULL AND {OF_THIS_FORMAT}"
        " AND sha256 NOT IN (SELECT sha256 FROM verdicts WHERE aircraft = $1"
        " UNION ALL SELECT sha256 FROM copies WHERE aircraft = $1)",
        aircraft,
    ).fetchall()
    return {sha256 for (sha256,) in rows}


def _digest(flights: Sequence[Listed], stamp: str) -> str:
    return hashlib.sha256(json.dumps([stamp, flights]).encode()).hexdigest()
