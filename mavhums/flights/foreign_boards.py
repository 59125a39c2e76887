"""Logs whose board does not belong to their aircraft: of another aircraft, or the board was swapped."""

from __future__ import annotations

from collections import defaultdict
from datetime import UTC, datetime, timedelta

from mavhums.flights.aircraft import BOARD, AircraftResolver
from mavhums.flights.aircraft_table import AircraftTable
from mavhums.flights.corrections import corrected_names
from mavhums.flights.naming import BOARD_NAME, whose_in
from mavhums.flights.stores.delta import Store
from mavhums.results.store import ForeignBoard

__all__ = ["foreign_board_among", "foreign_boards"]

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


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
    table, pinned = whose_in(store, AircraftResolver(BOARD)).table, corrected_names(store).logs
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
    """Return what is to be said of a flight whose board its aircraft does not have; None if it has it."""
    rows = store.query(
        "SELECT board, count(DISTINCT sha256) FROM logs"
        " WHERE aircraft = ? AND board IS NOT NULL AND flight IS NOT NULL GROUP BY board ORDER BY 2 DESC",
        aircraft,
    ).fetchall()
    if board is None or aircraft.startswith(BOARD_NAME) or not rows or board == rows[0][0]:
        return None
    start = datetime.fromisoformat(start_utc) if start_utc else None
    table = whose_in(store, AircraftResolver(BOARD)).table
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
