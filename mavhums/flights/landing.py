"""A log among its aircraft's flights in a store: compared with the earlier ones, and kept there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sqlalchemy import Connection, select

from mavhums.core.errors import MavhumsError
from mavhums.core.output import as_utf8
from mavhums.core.packed import is_stream
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.aircraft import (
    BOARD,
    GIVEN,
    UNKNOWN,
    AircraftResolver,
    UnnamedAircraftError,
    aircraft_of,
    board_of,
)
from mavhums.flights.compare import compared, packed
from mavhums.flights.history import PastFlight, UndatedError, with_copies
from mavhums.flights.naming import (
    BOARD_NAME,
    aircraft_in_store,
    check_aircraft_named,
    foreign_board_among,
    proposed,
    remember,
    resolver_of_store,
)
from mavhums.flights.queries import earlier_flights, standings, stored_verdicts
from mavhums.flights.store import LogFile, Row, Store
from mavhums.flights.store.database import FORMAT
from mavhums.flights.store.logs import (
    FLOWN,
    add_logs,
    known_files,
    removed_files,
)
from mavhums.flights.store.tables import AIRCRAFT, FLIGHT, us_of
from mavhums.flights.store.verdicts import make_verdicts
from mavhums.flights.trends import standings_after
from mavhums.results.assessment import Assessment
from mavhums.results.sections import NOT_COMPARED
from mavhums.results.standing import Standing


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
            recorded = standings(connection, self._aircraft).get(self._aircraft, ())
        own = [one for one in recorded if one.last_utc == PastFlight.of(alone.assessment).start.isoformat()]
        last = tuple(one.model_copy(update={"log": log.path}) for one in own)
        named = self.resolver.named(alone.assessment.model_copy(update={"verdicts": verdicts}))
        return self.completed(named, last or None)

    def completed(self, assessment: Assessment, states: tuple[Standing, ...] | None = None) -> Assessment:
        """Return a compared assessment with what the store knows of its aircraft.

        That is how many flights it was compared with, each actuator's state over them, which other logs
        record this one, and what an operator should look into. ``states`` are known ones.
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
        if states is None or not count:
            known, before = self.flights, self.flights.recent() if count else ()
            states = standings_after(flown, before, known.since(flown.start), known.baselines)
        counted = {"standings": states, "earlier_flights": count}
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
