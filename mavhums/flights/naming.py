"""How a store names aircraft: it remembers the rule and the boards of its scans, so that none is guessed.

It also lists the logs whose board does not belong to their aircraft: of another one, or a swapped board.
"""

from __future__ import annotations

import json
import time
from collections import defaultdict
from collections.abc import Collection, Iterable
from datetime import UTC, datetime, timedelta
from typing import Final

from mavhums.flights.aircraft import (
    BOARD,
    FOLDER,
    GIVEN,
    UNKNOWN,
    AircraftResolver,
    UnnamedAircraftError,
    board_of,
)
from mavhums.flights.aircraft_table import AircraftTable, Installation
from mavhums.flights.corrections import aircraft_in, corrected_names
from mavhums.flights.store import OF_THIS_FORMAT, LogFile, Row, Store, listed_sql
from mavhums.flights.store_tables import NAMING
from mavhums.results.assessment import Assessment
from mavhums.results.store import ForeignBoard

BOARD_NAME: Final = "board "
"""Begins the name of an aircraft that only its board identifies."""

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_SHOWN: Final = 20


def aircraft_in_store(path: str, assessment: Assessment, resolver: AircraftResolver) -> str:
    """Return the aircraft's name in a store: by the table, else by the rule; without a rule, by its board."""
    board = board_of(assessment)
    named = resolver.name(path, board, assessment.log.start_utc)
    if named is None and board and resolver.rule in (None, BOARD):
        named = f"{BOARD_NAME}{board}"
        return resolver.renamed.get(named, named)
    return named or UNKNOWN


def rule_of(store: Store) -> str | None:
    """Return the rule by which a store names aircraft; None if it has neither a rule nor a log.

    It is the latest that a scan was given. Versions that did not keep it are recognised by the names there:
    where one is not a board's, an unknown rule has given it, and each new log must be named.
    """
    rule, _ = _latest(store)
    if rule is not None:
        return rule
    named, judged = store.query(
        f"SELECT count(*) FILTER (aircraft <> '' AND NOT starts_with(aircraft, '{BOARD_NAME}')), count(*)"
        " FROM logs WHERE flight IS NOT NULL"
    ).fetchone()
    return GIVEN if named else BOARD if judged else None


def resolver_of_store(store: Store, given: AircraftResolver) -> AircraftResolver:
    """Return the operator's knowledge of whose logs they are, with what a store remembers of it."""
    boards = None if given.table.installed else _latest(store)[1]
    table = AircraftTable(map(Installation.model_validate, json.loads(boards))) if boards else given.table
    names = corrected_names(store).aircraft
    if names:
        renamed_boards = (
            each.model_copy(update={"aircraft": names.get(each.aircraft, each.aircraft)})
            for each in table.installed
        )
        table = AircraftTable(renamed_boards)
    return AircraftResolver(given.rule or rule_of(store), table, names)


def remember(store: Store, given: AircraftResolver) -> None:
    """Store the rule and the boards of a scan, if they are new.

    A name that was given for some logs (``=D-EABC``) is the rule of a store that has no other.
    """
    before = rule_of(store)
    rule = given.rule or before or BOARD
    if rule.startswith(GIVEN):
        rule = before or GIVEN
    entries = [each.model_dump(mode="json", by_alias=True) for each in given.table.installed if each.board]
    boards = json.dumps(entries) if entries else _latest(store)[1]
    if (rule, boards) != _latest(store):
        store.append(NAMING, [{"rule": rule, "boards": boards, "stored": time.time_ns()}])


def check_aircraft_named(store: Store, row: Row, given: AircraftResolver) -> None:
    """Refuse the name of a new log's aircraft that only a guess gives.

    Parameters
    ----------
    store
        The store.
    row
        The log, with its aircraft by the rule and the table.
    given
        What the operator gave for this log.

    Raises
    ------
    UnnamedAircraftError
        If nothing names the aircraft, or the remembered rule gives a name that the store does not have: a
        log in another folder than the scanned ones is of no aircraft of that folder's name.
    """
    rule = given.rule or rule_of(store)
    sure = given.rule is not None or rule in (None, BOARD)
    if row.aircraft != UNKNOWN and (sure or row.aircraft in aircraft_in(store)):
        return
    how = {
        None: "their boards",
        BOARD: "their boards",
        FOLDER: "the folders of their logs",
        GIVEN: "names that are given",
    }
    found = f"has none named {row.aircraft}" if row.aircraft else "finds no name in this log"
    several = proposed(store, row.board)
    why = f"; its board flew in {several[0]}" if several else ""
    raise UnnamedAircraftError(
        f"{row.path}: which aircraft is it of? The store names aircraft by"
        f" {how.get(rule, 'the expression ' + str(rule))}, and {found}{why}",
        f"name it: --aircraft '={several[0] if several else 'NAME'}'",
        tuple(several),
    )


def proposed(store: Store, board: str | None) -> list[str]:
    """Return the named aircraft in which a board flew, the latest first."""
    rows = store.query(
        "SELECT aircraft FROM logs WHERE board = ? AND aircraft <> '' AND flight IS NOT NULL"
        " GROUP BY aircraft ORDER BY max(start_us) DESC NULLS LAST",
        board,
    ).fetchall()
    return [name for (name,) in rows[:_SHOWN]]


def names_of(store: Store, logs: Collection[str]) -> dict[str, str]:
    """Return the aircraft of those logs, by their hashes, that a store has judged: a flight is kept once."""
    if not logs:
        return {}
    return dict(
        store.query(
            "SELECT sha256, arg_max(aircraft, scanned) FROM logs WHERE flight IS NOT NULL"
            f" AND sha256 IN ({listed_sql(logs)}) AND {OF_THIS_FORMAT} GROUP BY sha256"
        ).fetchall()
    )


def renamed(store: Store, files: Iterable[LogFile], given: AircraftResolver) -> set[str]:
    """Name known logs again by a rule that was given, and return the aircraft whose flights change.

    Logs are not read again. A log that lies at several paths has the name of the first.
    """
    if given.rule is None:
        return set()
    paths = {file.path for file in files}
    pinned = corrected_names(store).logs
    names: dict[str, str] = {}
    before: dict[str, str] = {}
    rows = store.query(
        "SELECT path, sha256, arg_max(aircraft, scanned), any_value(board), any_value(start_us)"
        " FROM logs WHERE flight IS NOT NULL GROUP BY path, sha256 ORDER BY path"
    ).fetchall()
    for path, sha256, aircraft, board, start_us in rows:
        if path in paths and sha256 not in names and sha256 not in pinned:
            start = None if start_us is None else (_EPOCH + timedelta(microseconds=start_us)).isoformat()
            by_board = f"{BOARD_NAME}{board}" if board and given.rule == BOARD else aircraft
            names[sha256] = given.name(path, board, start) or given.renamed.get(by_board, by_board)
            before[sha256] = aircraft
    changed = {sha256: name for sha256, name in names.items() if name != before[sha256]}
    store.rename(changed)
    return {*changed.values(), *(before[sha256] for sha256 in changed)}


def _latest(store: Store) -> tuple[str | None, str | None]:
    """Return the rule and the boards of the last scan that had others than the one before."""
    row = store.query("SELECT rule, boards FROM naming ORDER BY stored DESC LIMIT 1").fetchone()
    return row or (None, None)


def foreign_boards(store: Store) -> list[ForeignBoard]:
    """Return the boards that do not belong to their aircraft, by aircraft.

    A board that the operator's table puts into the aircraft at that time belongs to it, and so does that of a
    log that the operator gave to the aircraft.
    """
    rows = store.query(
        "SELECT aircraft, board, sha256, min(path), min(start_us) FROM logs"
        " WHERE flight IS NOT NULL AND board IS NOT NULL AND aircraft <> ''"
        f" AND NOT starts_with(aircraft, '{BOARD_NAME}') GROUP BY ALL ORDER BY min(start_us), min(path)"
    ).fetchall()
    boards: dict[str, dict[str, list[tuple[str, str, int | None]]]] = defaultdict(lambda: defaultdict(list))
    for aircraft, board, sha256, path, start_us in rows:
        boards[aircraft][board].append((sha256, path, start_us))
    usual = {name: max(several, key=lambda one: len(several[one])) for name, several in boards.items()}
    several_boards = {name: boards[name] for name in sorted(boards) if len(boards[name]) > 1}
    if not several_boards:
        return []
    homes = {board: name for name, board in usual.items()}
    table, pinned = resolver_of_store(store, AircraftResolver(BOARD)).table, corrected_names(store).logs
    found = []
    for name, several in several_boards.items():
        for board, logs in several.items():
            odd = tuple(
                path
                for sha256, path, start_us in logs
                if sha256 not in pinned and not _is_installed(table, name, board, start_us)
            )
            if board != usual[name] and odd:
                count = len(several[usual[name]])
                found.append(
                    ForeignBoard(
                        aircraft=name,
                        board=board,
                        logs=odd,
                        usual=usual[name],
                        flights=count,
                        elsewhere=homes.get(board),
                    )
                )
    return found


def foreign_board_among(store: Store, aircraft: str, board: str | None, start_utc: str | None) -> str | None:
    """Return the notice on a flight whose board is not its aircraft's; None if it is."""
    rows = store.query(
        "SELECT board, count(DISTINCT sha256) FROM logs"
        " WHERE aircraft = ? AND board IS NOT NULL AND flight IS NOT NULL GROUP BY board"
        " ORDER BY 2 DESC, min(start_us), min(path)",
        aircraft,
    ).fetchall()
    if board is None or aircraft.startswith(BOARD_NAME) or not rows or board == rows[0][0]:
        return None
    start = datetime.fromisoformat(start_utc) if start_utc else None
    table = resolver_of_store(store, AircraftResolver(BOARD)).table
    if start is not None and table.aircraft_of(board, start) == aircraft:
        return None
    usual, count = rows[0]
    others = f"{count} flight{'s' if count > 1 else ''} of {aircraft} with the board {usual}"
    return (
        f"compared with {others}, but this log has the board {board}: it is another aircraft's log, or the"
        " board was swapped (then list both in --aircraft-table)"
    )


def _is_installed(table: AircraftTable, aircraft: str, board: str, start_us: int | None) -> bool:
    if start_us is None:
        return False
    return table.aircraft_of(board, _EPOCH + timedelta(microseconds=start_us)) == aircraft
