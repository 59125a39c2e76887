"""How a store names aircraft: it remembers the rule and the boards of its scans, so that none is guessed.

It also lists the logs whose board does not belong to their aircraft: of another one, or a swapped board.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from datetime import datetime
from typing import Any, Final

from sqlalchemy import Connection, delete, func, insert, select

from mavhums.flights.aircraft import (
    BOARD,
    FOLDER,
    GIVEN,
    UNKNOWN,
    AircraftResolver,
    AircraftTable,
    UnnamedAircraftError,
    board_of,
)
from mavhums.flights.store import LogFile, Row
from mavhums.flights.store.logs import (
    FLOWN,
    aircraft_id,
    former_names,
    give_flights,
    in_parts,
    install,
    installed,
)
from mavhums.flights.store.tables import AIRCRAFT, FLIGHT, LOG, SETTING, time_of
from mavhums.results.assessment import Assessment
from mavhums.results.standing import ForeignBoard

BOARD_NAME: Final = "board "
"""Begins the name of an aircraft that only its board identifies."""

_SHOWN: Final = 20
_RULE: Final = "aircraft rule"
_OF_FLIGHT: Final = (FLIGHT.c.id, FLIGHT.c.path, FLIGHT.c.board, FLIGHT.c.start_us, FLIGHT.c.pinned)


def aircraft_in_store(path: str, assessment: Assessment, resolver: AircraftResolver) -> str:
    """Return the aircraft's name in a store: by the table, else by the rule; without a rule, by its board."""
    board = board_of(assessment)
    named = resolver.name(path, board, assessment.log.start_utc)
    if named is None and board and resolver.rule in (None, BOARD):
        named = f"{BOARD_NAME}{board}"
        return resolver.renamed.get(named, named)
    return named or UNKNOWN


def rule_of(connection: Connection) -> str | None:
    """Return the rule by which a store names aircraft: the last that a scan had; None for a new store."""
    return connection.scalar(select(SETTING.c.value).where(SETTING.c.name == _RULE))


def resolver_of_store(connection: Connection, given: AircraftResolver) -> AircraftResolver:
    """Return the operator's knowledge of whose logs they are, with what a store remembers of it."""
    table = given.table
    if not table.installed:
        table = AircraftTable(each for each in installed(connection).installed if each.board)
    return AircraftResolver(given.rule or rule_of(connection), table, former_names(connection))


def remember(connection: Connection, given: AircraftResolver, files: Iterable[LogFile]) -> None:
    """Keep the rule and the table of a scan, and name by them the logs that are there already.

    No log is read again, and what the operator gave to an aircraft stays there. The table names all logs, a
    rule the scanned ones. A name that was given for some logs (``=D-EABC``) is the rule of a store that has
    no other.
    """
    before = rule_of(connection)
    rule = given.rule or before or BOARD
    if rule.startswith(GIVEN):
        rule = before or GIVEN
    if rule != before:
        connection.execute(delete(SETTING).where(SETTING.c.name == _RULE))
        connection.execute(insert(SETTING).values(name=_RULE, value=rule))
    install(connection, given.table)
    resolver = AircraftResolver(given.rule, given.table, former_names(connection))
    asked = select(*_OF_FLIGHT, AIRCRAFT.c.name).join(AIRCRAFT).where(~FLIGHT.c.pinned)
    rows: list[Any] = []
    if given.rule is not None:
        for paths in in_parts({file.path for file in files}):
            scanned = select(LOG.c.flight_id).where(LOG.c.path.in_(paths))
            rows += connection.execute(asked.where(FLIGHT.c.id.in_(scanned))).all()
    elif given.table.installed:
        rows += connection.execute(asked.where(FLIGHT.c.board.is_not(None))).all()
    moved: dict[str, list[int]] = defaultdict(list)
    for flight, path, board, start_us, _, known in rows:
        start = None if start_us is None else time_of(start_us).isoformat()
        by_board = f"{BOARD_NAME}{board}" if board and given.rule == BOARD else known
        name = resolver.name(path, board, start) or resolver.renamed.get(by_board, by_board)
        if name != known:
            moved[name].append(flight)
    for name, several in moved.items():
        give_flights(connection, several, name)


def check_aircraft_named(connection: Connection, row: Row, given: AircraftResolver) -> None:
    """Refuse the name of a new log's aircraft that only a guess gives.

    Parameters
    ----------
    connection
        Of the store.
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
    rule = given.rule or rule_of(connection)
    sure = given.rule is not None or rule in (None, BOARD)
    if row.aircraft != UNKNOWN and (sure or row.aircraft in {*connection.scalars(FLOWN)}):
        return
    how = {
        None: "their boards",
        BOARD: "their boards",
        FOLDER: "the folders of their logs",
        GIVEN: "names that are given",
    }
    found = f"has none named {row.aircraft}" if row.aircraft else "finds no name in this log"
    several = proposed(connection, row.board)
    why = f"; its board flew in {several[0]}" if several else ""
    raise UnnamedAircraftError(
        f"{row.path}: which aircraft is it of? The store names aircraft by"
        f" {how.get(rule, 'the expression ' + str(rule))}, and {found}{why}",
        f"name it: --aircraft '={several[0] if several else 'NAME'}'",
        tuple(several),
    )


def proposed(connection: Connection, board: str | None) -> list[str]:
    """Return the named aircraft in which a board flew, the latest first."""
    rows = (
        select(AIRCRAFT.c.name)
        .join(FLIGHT)
        .where(FLIGHT.c.board == board, AIRCRAFT.c.name != UNKNOWN)
        .group_by(AIRCRAFT.c.name)
        .order_by(func.max(FLIGHT.c.start_us).desc().nulls_last(), AIRCRAFT.c.name)
    )
    return [*connection.scalars(rows.limit(_SHOWN))]


def foreign_boards(connection: Connection) -> list[ForeignBoard]:
    """Return the boards that do not belong to their aircraft, by aircraft.

    A board that the operator's table puts into the aircraft at that time belongs to it, and so does that of a
    log that the operator gave to the aircraft.
    """
    several = (
        select(AIRCRAFT.c.id, AIRCRAFT.c.name)
        .join(FLIGHT)
        .where(AIRCRAFT.c.name != UNKNOWN, ~AIRCRAFT.c.name.startswith(BOARD_NAME))
        .group_by(AIRCRAFT.c.id, AIRCRAFT.c.name)
        .having(func.count(FLIGHT.c.board.distinct()) > 1)
        .order_by(AIRCRAFT.c.name)
    )
    table = resolver_of_store(connection, AircraftResolver(BOARD)).table
    found: list[ForeignBoard] = []
    for whose, name in connection.execute(several).all():
        usual, flights = _usual(connection, whose)
        others = (
            select(FLIGHT.c.board, FLIGHT.c.path, FLIGHT.c.start_us, FLIGHT.c.pinned)
            .where(FLIGHT.c.aircraft_id == whose, FLIGHT.c.board != usual)
            .order_by(FLIGHT.c.start_us.nulls_last(), FLIGHT.c.path)
        )
        odd: dict[str, list[str]] = {}
        for board, path, start_us, pinned in connection.execute(others):
            logs = odd.setdefault(board, [])
            if not pinned and not _is_installed(table, name, board, start_us):
                logs.append(path)
        of = {"aircraft": name, "usual": usual, "flights": flights}
        found += [
            ForeignBoard(**of, board=board, logs=tuple(logs), elsewhere=_home(connection, board, name))
            for board, logs in odd.items()
            if logs
        ]
    return found


def _home(connection: Connection, board: str, other: str) -> str | None:
    """Return another aircraft of which a board is the usual one."""
    for name in proposed(connection, board):
        if name != other and not name.startswith(BOARD_NAME):
            whose = aircraft_id(connection, name, creates=False)
            if whose is not None and _usual(connection, whose)[0] == board:
                return name
    return None


def _usual(connection: Connection, aircraft: int) -> tuple[str | None, int]:
    """Return the board that an aircraft has in most flights, and in how many; None without any."""
    row = connection.execute(
        select(FLIGHT.c.board, func.count())
        .where(FLIGHT.c.aircraft_id == aircraft, FLIGHT.c.board.is_not(None))
        .group_by(FLIGHT.c.board)
        .order_by(func.count().desc(), func.min(FLIGHT.c.start_us).nulls_last(), func.min(FLIGHT.c.path))
        .limit(1)
    ).first()
    return (row[0], row[1]) if row else (None, 0)


def foreign_board_among(
    connection: Connection, aircraft: str, board: str | None, start_utc: str | None
) -> str | None:
    """Return the notice on a flight whose board is not its aircraft's; None if it is."""
    whose = aircraft_id(connection, aircraft, creates=False)
    usual, count = (None, 0) if whose is None else _usual(connection, whose)
    if board is None or usual in (None, board) or aircraft.startswith(BOARD_NAME):
        return None
    start = datetime.fromisoformat(start_utc) if start_utc else None
    table = resolver_of_store(connection, AircraftResolver(BOARD)).table
    if start is not None and table.aircraft_of(board, start) == aircraft:
        return None
    others = f"{count} flight{'s' if count > 1 else ''} of {aircraft} with the board {usual}"
    return (
        f"compared with {others}, but this log has the board {board}: it is another aircraft's log, or the"
        " board was swapped (then list both in --aircraft-table)"
    )


def _is_installed(table: AircraftTable, aircraft: str, board: str, start_us: int | None) -> bool:
    if start_us is None:
        return False
    return table.aircraft_of(board, time_of(start_us)) == aircraft
