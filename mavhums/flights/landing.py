"""Lands a flight in a store, and compares it with the earlier flights of its aircraft there.

A store remembers the rule and the boards by which its scans name aircraft, so that none is guessed; it lists
the logs whose board does not belong to their aircraft: of another one, or a swapped board.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from sqlalchemy import Connection, delete, func, insert, select

from mavhums.core.errors import MavhumsError
from mavhums.core.output import as_utf8
from mavhums.core.packed import is_stream
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.aircraft import (
    BOARD,
    FOLDER,
    GIVEN,
    UNKNOWN,
    AircraftResolver,
    AircraftTable,
    UnnamedAircraftError,
    aircraft_of,
    board_of,
)
from mavhums.flights.compare import compared, packed
from mavhums.flights.history import PastFlight, UndatedError, with_copies
from mavhums.flights.queries import earlier_flights, standings, stored_verdicts
from mavhums.flights.store import LogFile, Row, Store
from mavhums.flights.store.database import AIRCRAFT, FLIGHT, FORMAT, LOG, SETTING, time_of, us_of
from mavhums.flights.store.logs import (
    FLOWN,
    add_logs,
    aircraft_id,
    former_names,
    give_flights,
    in_parts,
    install,
    installed,
    known_files,
    removed_files,
)
from mavhums.flights.store.verdicts import make_verdicts
from mavhums.flights.trends import standings_after
from mavhums.results.assessment import Assessment
from mavhums.results.sections import NOT_COMPARED
from mavhums.results.standing import ForeignBoard, Standing

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


class OwnFlights:
    """The earlier flights of a log's aircraft in a store.

    Parameters
    ----------
    store
        The store.
    alone
        Assessment of the log, or of a link so far, by itself.
    given
        What the operator says of whose log it is.

    Attributes
    ----------
    is_named
        Whether anything names the aircraft; otherwise it has no earlier flights.
    resolver
        Gives the aircraft in the log its name.
    flights
        What a comparison takes of the flights; empty of an aircraft without a name.

    Raises
    ------
    MavhumsError
        If the store does not exist or cannot be read.
    """

    def __init__(self, store: Store, alone: Assessment, given: AircraftResolver) -> None:
        self._store = store.opened()
        with store.reading() as connection:
            known = resolver_of_store(connection, given)
            aircraft = _aircraft(alone, connection, known, given.rule)
        self.is_named, self._aircraft = aircraft != UNKNOWN, aircraft
        rule = given.rule if aircraft.startswith(BOARD_NAME) else f"{GIVEN}{aircraft}"
        self.resolver = AircraftResolver(rule if self.is_named else None, known.table)
        self.flights = earlier_flights(store, aircraft if self.is_named else None, known.table)

    def compared(self, alone: StandaloneAssessment) -> Assessment:
        """Return the assessment of a flight that was judged alone, compared with the earlier ones."""
        named = self.resolver.named(alone.assessment)
        if not self.is_named:
            return self.completed(named)
        known = self.flights
        return self.completed(compared(alone._replace(assessment=named), known.baselines, known.past))

    def kept(self, alone: StandaloneAssessment) -> Assessment:
        """Return the assessment of a flight with its verdicts in the store, which has just made them."""
        log = alone.assessment.log
        if log.start_utc is None or not self.is_named:
            return self.compared(alone)
        with self._store.reading() as connection:
            verdicts = stored_verdicts(connection, log.sha256 or "")
            stands = standings(connection, self._aircraft).get(self._aircraft, ())
        own = [one for one in stands if one.last_utc == PastFlight.of(alone.assessment).start.isoformat()]
        last = tuple(one.model_copy(update={"log": log.path}) for one in own)
        named = self.resolver.named(alone.assessment.model_copy(update={"verdicts": verdicts}))
        return self.completed(named, last or None)

    def completed(self, assessment: Assessment, stands: tuple[Standing, ...] | None = None) -> Assessment:
        """Return a compared assessment with what the store knows of its aircraft.

        That is how many flights it was compared with, how each actuator stands over them, which other logs
        record this one, and what an operator should look into. ``stands`` is how they stand, if known.
        """
        if not self.is_named:
            return assessment.with_notice(
                f"{NOT_COMPARED}: nothing names its aircraft; give it by --aircraft =NAME"
            )
        with self._store.reading() as connection:
            notice = _odd_board(connection, assessment)
        if notice is not None:
            assessment = assessment.with_notice(notice)
        try:
            flown = PastFlight.of(assessment)
        except UndatedError:
            return assessment
        count = self.flights.count(flown)
        if stands is None or not count:
            before = self.flights.recent() if count else ()
            stands = standings_after(flown, before, self.flights.since(flown.start))
        counted = {"standings": stands, "earlier_flights": count}
        return with_copies(assessment, self.flights.near(flown)).model_copy(update=counted)


def land(
    store: Store, alone: StandaloneAssessment, file: LogFile, settings: str, given: AircraftResolver
) -> bool:
    """Put a judged log into a store, and make the verdicts on it and on later flights; it is kept once.

    Return whether it is there as it was judged now; a copy of a log that is there is left out.

    Parameters
    ----------
    store
        The store; the first log creates it.
    alone
        The log, judged by itself.
    file, settings
        The log's file, and the hash of everything else that its judgement depends on.
    given
        What the operator says of whose log it is; the store remembers it.

    Raises
    ------
    UnnamedAircraftError
        If nothing but a guess names its aircraft.
    MavhumsError
        If the store cannot be written, has the log as one of another aircraft, or the log was removed.
    """
    refused: MavhumsError | None = None
    with store.writing() as connection:
        there = _judged(connection, alone.assessment.log.sha256 or "")
        if there is not None and there.path != file.path and there.aircraft != UNKNOWN:
            _check_not_of_another(store, file, there, given)
            return False
        remember(connection, given, [file])
        if known_files(connection, [file]).get(file) != settings:
            row = row_of(alone, file, settings, resolver_of_store(connection, given))
            try:
                check_aircraft_named(connection, row, given)
                if file in removed_files(connection) or not add_logs(connection, [row])[0]:
                    remedy = f"see the number: mavhums fleet journal --store {store.place}; and --undo it"
                    refused = MavhumsError(f"{file.path}: was removed from {store.place}", remedy)
            except UnnamedAircraftError as error:
                refused = error
        make_verdicts(connection)
    if refused is not None:
        raise refused
    return True


def row_of(alone: StandaloneAssessment, file: LogFile, settings: str, resolver: AircraftResolver) -> Row:
    """Return a log that was judged by itself as a store takes it; arguments as of :func:`land`."""
    # The path of the log, wherever its copy lay.
    log = alone.assessment.log.model_copy(update={"path": file.path})
    assessment = alone.assessment.model_copy(update={"log": log})
    try:
        start_us: int | None = us_of(PastFlight.of(assessment).start)
    except UndatedError:
        start_us = None
    return Row(
        *file,
        settings=settings,
        sha256=log.sha256,
        aircraft=aircraft_in_store(file.path, assessment, resolver),
        board=board_of(assessment),
        start_us=start_us,
        duration_s=log.duration_s,
        losses=bool(log.losses.any),
        flight=packed(alone._replace(assessment=assessment)),
    )


def _check_not_of_another(store: Store, file: LogFile, there: Any, given: AircraftResolver) -> None:
    name = aircraft_of(file.path, given.rule)
    if name not in (UNKNOWN, there.aircraft):
        problem = f"{file.path}: {store.place} has this log as one of {there.aircraft}, not of {name}"
        move = f"mavhums fleet move --store {store.place} '{there.path}' '{name}'"
        raise MavhumsError(problem, f"if that is wrong, move it: {move}")


def _odd_board(connection: Connection, assessment: Assessment) -> str | None:
    """Return the notice on a log whose board is not that of its aircraft; None if it is."""
    log = assessment.log
    names = {each.aircraft for each in log.flight}
    name = names.pop() if len(names) == 1 else None
    pinned = connection.scalar(select(FLIGHT.c.pinned).where(FLIGHT.c.sha256 == log.sha256))
    if name is None or pinned:
        return None
    return foreign_board_among(connection, name, board_of(assessment), log.start_utc)


def _aircraft(
    assessment: Assessment, connection: Connection, resolver: AircraftResolver, rule: str | None
) -> str:
    """Return whose flights a log is compared with: by the rule, else by those of its board in the store."""
    log = assessment.log
    row = _judged(connection, log.sha256 or "")
    if row is not None and row.aircraft != UNKNOWN and (rule is None or row.pinned):
        return str(row.aircraft)
    path = "" if log.path is None or is_stream(log.path) else as_utf8(Path(log.path).absolute())
    named = aircraft_in_store(path, assessment, resolver)
    if rule is not None or resolver.rule in (None, BOARD):
        return named
    if named in {*connection.scalars(FLOWN)}:
        return named
    board = board_of(assessment)
    several = proposed(connection, board) if board else []
    return several[0] if len(several) == 1 else UNKNOWN


def _judged(connection: Connection, sha256: str) -> Any:
    """Return where a store has judged a log, and its aircraft; None if it has not."""
    asked = select(FLIGHT.c.path, AIRCRAFT.c.name.label("aircraft"), FLIGHT.c.pinned).join(AIRCRAFT)
    return connection.execute(asked.where(FLIGHT.c.sha256 == sha256, FLIGHT.c.format == FORMAT)).first()
