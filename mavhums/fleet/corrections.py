"""Corrects a store: removes and restores logs, reassigns them, renames an aircraft.

The verdicts of the aircraft concerned are made again at once, from the stored flights; no log is opened.
Each correction is kept before the change that it tells of. After an interruption the same call completes it,
and so does the next scan.
"""

from __future__ import annotations

import getpass
import os
import socket
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Literal

from mavhums.core.errors import MavhumsError
from mavhums.fleet.second_pass import second_pass
from mavhums.flights.aircraft import UNKNOWN
from mavhums.flights.corrections import (
    Correction,
    FoundLog,
    add_corrections,
    aircraft_in,
    corrected_names,
    corrections_of,
    logs_named,
    named_in,
    where_logs,
)
from mavhums.flights.store import Store
from mavhums.flights.store_tables import DATES, INSTALLED, LOGS, REMOVED, STANDINGS, schemas

Place = str | os.PathLike[str]
_Kind = Literal["remove", "restore", "reassign", "rename"]

_RENAMED: Final = (DATES, INSTALLED, STANDINGS)
"""Tables whose rows follow a renamed aircraft; the verdicts are made again."""


def corrections_in(store: Place) -> list[Correction]:
    """Return the corrections of a store, the first one first.

    Raises
    ------
    MavhumsError
        If the store does not exist.
    """
    return corrections_of(Store(store).opened())


def remove(
    store: Place, logs: Sequence[Place], *, who: str | None = None, note: str | None = None
) -> list[Correction]:
    """Remove logs from a store; later scans leave them alone, under other paths, too.

    Parameters
    ----------
    store
        Folder or address of the store.
    logs
        Paths or addresses of logs or folders as the store has them, ends of paths, or digits of hashes.
    who, note
        Who corrects it, by default the user, and why.

    Returns
    -------
    list
        What was changed; nothing for logs that were removed already.

    Raises
    ------
    MavhumsError
        If the store has no such log, does not exist or cannot be written, or another scan writes into it.
    """
    kept = Store(store).opened()
    with kept.locked():
        found = _found(kept, logs, other=lambda log: logs_named(kept, *_named(log), removed=True))
        changes = _changes("remove", found, who, note)
        add_corrections(kept, changes)
        _moved(kept, found, LOGS, REMOVED)
        _compare(kept, (one.aircraft for one in found))
    return changes


def restore(
    store: Place, logs: Sequence[Place], *, who: str | None = None, note: str | None = None
) -> list[Correction]:
    """Put removed logs back; parameters and errors are those of :func:`remove`."""
    kept = Store(store).opened()
    with kept.locked():
        found = _found(kept, logs, removed=True, other=lambda log: logs_named(kept, *_named(log)))
        names, pinned = corrected_names(kept)
        whose = {one: pinned.get(one.sha256 or "", names.get(one.aircraft, one.aircraft)) for one in found}
        changes = [
            one._replace(after=name)
            for one, name in zip(_changes("restore", found, who, note), whose.values(), strict=True)
        ]
        add_corrections(kept, changes)
        _moved(kept, found, REMOVED, LOGS)
        kept.rename({one.sha256: name for one, name in whose.items() if one.sha256 and name != one.aircraft})
        _compare(kept, whose.values())
    return changes


def reassign(
    store: Place, logs: Sequence[Place], aircraft: str, *, who: str | None = None, note: str | None = None
) -> list[Correction]:
    """Give logs to another aircraft; later scans leave them there, whatever rule or table they are given.

    Parameters
    ----------
    aircraft
        Its name; a new one founds it. The one that they have already confirms it, whatever their board says.
        The other parameters and the errors are those of :func:`remove`.
    """
    _check_name(aircraft)
    kept = Store(store).opened()
    with kept.locked():
        pinned = corrected_names(kept).logs
        found = [
            one
            for one in _found(kept, logs)
            if one.sha256 and (one.aircraft != aircraft or pinned.get(one.sha256) != aircraft)
        ]
        changes = [one._replace(after=aircraft) for one in _changes("reassign", found, who, note)]
        add_corrections(kept, changes)
        kept.rename({one.sha256: aircraft for one in found if one.sha256})
        moved = [one.aircraft for one in found if one.aircraft != aircraft]
        _compare(kept, (aircraft, *moved) if moved else ())
    return changes


def rename(
    store: Place,
    aircraft: str,
    name: str,
    *,
    join: bool = False,
    who: str | None = None,
    note: str | None = None,
) -> list[Correction]:
    """Rename an aircraft, with its repairs, installed actuators and history; later scans do so, too.

    Parameters
    ----------
    aircraft, name
        The name that it has, and the one that it gets.
    join
        Whether an aircraft that has that name already becomes one with it. The other parameters and the
        errors are those of :func:`remove`.
    """
    _check_name(name)
    kept = Store(store).opened()
    with kept.locked():
        there = aircraft_in(kept)
        if aircraft == name or (
            aircraft not in there and corrected_names(kept).aircraft.get(aircraft) == name
        ):
            _compare(kept, ())
            return []
        if aircraft not in there:
            raise MavhumsError(f"{kept.place}: no aircraft {aircraft}", named_in(kept))
        if name in there and not join:
            problem = f"{kept.place}: {name} is there already"
            raise MavhumsError(problem, "--join makes one aircraft of both")
        change = _change("rename", None, who, note)._replace(before=aircraft, after=name)
        add_corrections(kept, [change])
        for table in _RENAMED if not join else _RENAMED[:2]:
            _renamed_rows(kept, table, aircraft, name)
        rows = kept.query("SELECT DISTINCT sha256 FROM logs WHERE aircraft = ?", aircraft).fetchall()
        kept.rename({sha256: name for (sha256,) in rows if sha256})
        _compare(kept, (aircraft, name))
    return [change]


def _compare(store: Store, aircraft: Iterable[str]) -> None:
    """Make the verdicts of aircraft again, and those that an interruption left."""
    second_pass(store, sorted({*aircraft} | store.waiting()))


def _found(
    store: Store,
    logs: Iterable[Place],
    *,
    removed: bool = False,
    other: Callable[[Place], list[FoundLog]] | None = None,
) -> list[FoundLog]:
    """Return the logs that are named; those that ``other`` finds are corrected already.

    Raises
    ------
    MavhumsError
        If a name finds nothing.
    """
    found: dict[FoundLog, None] = {}
    for log in logs:
        several = logs_named(store, *_named(log), removed=removed)
        if not several and not (other and other(log)):
            what = "removed log" if removed else "log"
            remedy = "name its path as `mavhums fleet export` shows it"
            raise MavhumsError(f"{store.place}: no {what} {os.fspath(log)}", remedy)
        found |= dict.fromkeys(several)
    return [*found]


def _named(log: Place) -> tuple[str, str]:
    text = os.fspath(log)
    return text, text if "://" in text else str(Path(text).absolute())


def _moved(store: Store, logs: Sequence[FoundLog], source: str, target: str) -> None:
    """Move the rows of logs from one table to another; done again after an interruption, it adds no row."""
    if not logs:
        return
    columns, where = schemas()[source].names, where_logs(logs)
    there = {*store.query(f"SELECT path, scanned FROM {target} WHERE {where}").fetchall()}
    rows = store.query(f"SELECT {', '.join(columns)} FROM {source} WHERE {where}").fetchall()
    told = [dict(zip(columns, row, strict=True)) for row in rows]
    new = [row for row in told if (row["path"], row["scanned"]) not in there]
    if new:
        store.append(target, new)
    store.delete(source, where)


def _renamed_rows(store: Store, table: str, aircraft: str, name: str) -> None:
    columns = schemas()[table].names

    def renamed() -> list[dict[str, object]]:
        rows = store.query(f"SELECT {', '.join(columns)} FROM {table}").fetchall()
        told = [dict(zip(columns, row, strict=True)) for row in rows]
        return [row | {"aircraft": name} if row["aircraft"] == aircraft else row for row in told]

    if any(row["aircraft"] == name for row in renamed()):
        store.rewrite(table, renamed)


def _changes(kind: _Kind, logs: Iterable[FoundLog], who: str | None, note: str | None) -> list[Correction]:
    return [_change(kind, one, who, note)._replace(before=one.aircraft, after=None) for one in logs]


def _change(kind: _Kind, log: FoundLog | None, who: str | None, note: str | None) -> Correction:
    path, sha256 = (log.path, log.sha256) if log else (None, None)
    return Correction(kind, path, sha256, None, None, who or _user(), note, datetime.now(UTC))


def _user() -> str:
    try:
        name = getpass.getuser()
    except (KeyError, OSError):  # a container's user without a name
        name = f"user {os.getuid()}" if hasattr(os, "getuid") else "unknown"
    return f"{name}@{socket.gethostname()}"


def _check_name(aircraft: str) -> None:
    if aircraft.strip() == UNKNOWN or aircraft != aircraft.strip():
        raise MavhumsError(f"{aircraft!r}: is no name of an aircraft", "name it, such as D-EABC")
