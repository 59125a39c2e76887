"""What an operator corrected in a store: logs removed or reassigned, aircraft renamed; by whom, when and why.

A correction goes before the rule and the table by which scans name logs: the next scan does not undo it.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import Any, Final, Literal, NamedTuple

from mavhums.core.errors import MavhumsError
from mavhums.flights.stores.delta import LogFile, Store, listed_sql
from mavhums.flights.stores.delta_tables import CORRECTIONS, LOGS, REMOVED

__all__ = [
    "Correction",
    "FoundLog",
    "Names",
    "add_corrections",
    "corrected_names",
    "corrections_of",
    "logs_named",
    "removed_files",
    "removed_logs",
    "where_logs",
]

_COLUMNS: Final = "kind, log, sha256, before, after, who, note, at_ns"
_LEAST_HASH: Final = 8
_SHOWN: Final = 5


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
