"""A log after a landing: judged against its aircraft's flights in a store, and kept there."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from sqlalchemy import Connection, select

from mavhums.app.analysis import Failed, Judged, analyse_alone, compared_with_own
from mavhums.app.settings import Options, Settings
from mavhums.core.errors import MavhumsError, UnreadableLogError
from mavhums.core.output import as_utf8
from mavhums.core.packed import is_stream, opened_file
from mavhums.engine.events import StandaloneAssessment
from mavhums.fleet.scan import ScanOptions, scanned
from mavhums.fleet.sources import logs_in
from mavhums.flights.aircraft import (
    BOARD,
    GIVEN,
    UNKNOWN,
    AircraftResolver,
    UnnamedAircraftError,
    aircraft_of,
    board_of,
    latest,
)
from mavhums.flights.aircraft_table import Since
from mavhums.flights.history import FlightHistory, is_store
from mavhums.flights.naming import (
    BOARD_NAME,
    aircraft_in_store,
    foreign_board_among,
    proposed,
    resolver_of_store,
)
from mavhums.flights.queries import earlier_flights, flight, standings
from mavhums.flights.store import LogFile, Store
from mavhums.flights.store.database import FORMAT
from mavhums.flights.store.earlier import StoredFlights
from mavhums.flights.store.logs import FLOWN
from mavhums.flights.store.tables import AIRCRAFT, FLIGHT, LOG, RECORDING
from mavhums.results.assessment import Assessment
from mavhums.results.sections import FlightCopy

Place = str | os.PathLike[str]


class Past(NamedTuple):
    """An aircraft's flights in a store, and the dates from which they count."""

    history: StoredFlights
    since: Since


def analyse(log: Place, store: Place, options: Options | Settings | None = None) -> Assessment:
    """Judge a log and compare it with the flights of its aircraft in a store; the store is not changed.

    The verdicts are those that :func:`scan` stores, unless later logs of earlier flights are scanned.

    Parameters
    ----------
    log
        Path of the log.
    store
        File or address of the store.
    options
        Profile, model and the like; the rule and the table name the aircraft. A history is ignored.

    Raises
    ------
    UnreadableLogError
        If the log is missing or its format is unknown.
    MavhumsError
        If the store does not exist or cannot be read, or the options cannot be used.

    Examples
    --------
    >>> from mavhums import fleet
    >>> fleet.analyse("flight.tlog", "store").exit_code.name  # doctest: +SKIP
    'EMERGENCY'
    """
    settings = _without_history(options)
    kept = Store(store).opened()
    alone = _alone(log, settings)
    return _with_notice(compared_with_own(alone, _with_past(alone, kept, log, settings)), kept)


def against(log: Place, store: Place, options: Options | Settings | None = None) -> Settings:
    """Return settings with the flights of a log's aircraft in a store as the history.

    With them, :func:`mavhums.analyse` judges and records the log; parameters and errors are those of
    :func:`analyse`. The log is read once to find its aircraft.
    """
    settings = _without_history(options)
    kept = Store(store).opened()
    return _with_past(_alone(log, settings), kept, log, settings)


def past(store: Place, aircraft: str, moment: datetime | None = None) -> Past:
    """Return an aircraft's flights in a store.

    Parameters
    ----------
    store
        File or address of the store.
    aircraft
        Its name, or the one before the store renamed it; without flights if the store does not have it.
    moment
        Time of the flight to be judged, with a time zone; now if None.

    Raises
    ------
    MavhumsError
        If the store does not exist or cannot be read.
    """
    return _past(Store(store).opened(), aircraft, moment or datetime.now(UTC))


def keep(
    logs: Sequence[Place],
    store: Place,
    options: Options | None = None,
    *,
    workers: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[Judged | Failed]:
    """Put logs into a store as :func:`scan` does, and return each with its stored verdicts.

    Parameters
    ----------
    logs
        Paths of the logs.
    store
        File or address of the store; the first log creates it.
    options
        Profile, model and the like; the rule and the table name the aircraft. A history is ignored.
    workers
        Processes that judge; with 0, this one.
    progress
        Called with the number of judged logs and the total.

    Raises
    ------
    MavhumsError
        If the store cannot be written, another scan writes into it, or the options cannot be used.
    """
    options = options or Options()
    files = [Path(log) for log in logs]
    judging = replace(options, history=None, since=None, aircraft=None, aircraft_table=None)
    named = ScanOptions(
        judging=judging, aircraft=options.aircraft, aircraft_table=options.aircraft_table, workers=workers
    )
    new = [file for file in _listed(files) if not _is_elsewhere(file, store, options)]
    asked: dict[str, UnnamedAircraftError] = {}
    if new:
        asked = scanned(new, store, named, progress=progress, asks=True)[1]
    return _outcomes(files, store, options, asked)


def _listed(files: Sequence[Path]) -> list[LogFile]:
    return logs_in([file for file in files if file.is_file()])


def _is_elsewhere(file: LogFile, store: Place, options: Options) -> bool:
    """Return whether a store has judged the same bytes under another path: a flight is kept once.

    Raises
    ------
    MavhumsError
        If it is to be of another aircraft than there.
    """
    if not is_store(store):
        return False
    try:
        digest = _sha256(Path(file.path))
    except UnreadableLogError:  # a row of the scan says why
        return False
    with Store(store).opened().reading() as connection:
        row = _judged(connection, digest)
    if row is None or row.path == file.path or row.aircraft == UNKNOWN:
        return False
    name = aircraft_of(file.path, options.aircraft)
    if name not in (UNKNOWN, row.aircraft):
        move = f"mavhums fleet move {store} '{row.path}' '{name}'"
        problem = f"{file.path}: {store} has this log as one of {row.aircraft}, not of {name}"
        raise MavhumsError(problem, f"if that is wrong, move it: {move}")
    return True


def _outcomes(
    files: Sequence[Path], store: Place, options: Options, asked: Mapping[str, UnnamedAircraftError]
) -> Iterator[Judged | Failed]:
    for file in files:
        try:
            if (unnamed := asked.get(as_utf8(file.absolute()))) is not None:
                raise unnamed
            yield Judged(file, _kept(file, store, options))
        except MavhumsError as error:
            yield Failed.of(file, error)


def _without_history(options: Options | Settings | None) -> Settings:
    """Return settings without a history: the store is the history."""
    if isinstance(options, Settings):
        return replace(options, history=FlightHistory())
    return Settings.read(replace(options or Options(), history=None))


def _alone(log: Place, settings: Settings) -> StandaloneAssessment:
    if is_stream(log):
        raise MavhumsError(f"{log}: a store names logs by their files", "save the log first")
    return analyse_alone(log, settings.engine)


def _with_past(alone: StandaloneAssessment, store: Store, log: Place, settings: Settings) -> Settings:
    """Return settings with the past of a judged log's aircraft."""
    given = settings.resolver
    start = alone.assessment.log.start_utc
    with store.reading() as connection:
        resolver = resolver_of_store(connection, given)
        path = as_utf8(Path(log).absolute())
        aircraft = _aircraft(alone.assessment, connection, path, resolver, given.rule)
    if aircraft == UNKNOWN or start is None:
        return replace(settings, resolver=AircraftResolver(None, resolver.table))
    rule = given.rule if aircraft.startswith(BOARD_NAME) else f"{GIVEN}{aircraft}"
    before = _past(store, aircraft, datetime.fromisoformat(start))
    since = latest(settings.since, before.since)
    return replace(
        settings, history=before.history, since=since, resolver=AircraftResolver(rule, resolver.table)
    )


def _with_notice(assessment: Assessment, store: Store) -> Assessment:
    """Return an assessment with a notice if the board of its log is not that of its aircraft."""
    log = assessment.log
    aircraft = {each.aircraft for each in log.flight}
    name = aircraft.pop() if len(aircraft) == 1 else None
    with store.reading() as connection:
        pinned = connection.scalar(select(FLIGHT.c.pinned).where(FLIGHT.c.sha256 == log.sha256))
        if name is None or pinned:
            return assessment
        notice = foreign_board_among(connection, name, board_of(assessment), log.start_utc)
    if notice is None:
        return assessment
    return assessment.model_copy(update={"log": log.model_copy(update={"notices": (*log.notices, notice)})})


def _aircraft(
    assessment: Assessment, connection: Connection, path: str, resolver: AircraftResolver, rule: str | None
) -> str:
    """Return whose flights a log is compared with: by the rule, else by those of its board in the store."""
    row = _judged(connection, assessment.log.sha256 or "")
    if row is not None and row.aircraft != UNKNOWN and (rule is None or row.pinned):
        return row.aircraft
    named = aircraft_in_store(path, assessment, resolver)
    if rule is not None or resolver.rule in (None, BOARD):
        return named
    if named in {*connection.scalars(FLOWN)}:
        return named
    board = board_of(assessment)
    several = proposed(connection, board) if board else []
    return several[0] if len(several) == 1 else UNKNOWN


def _sha256(log: Path) -> str:
    try:
        with opened_file(log) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise UnreadableLogError(f"{log}: {error.strerror}", "check the permissions and the disk") from error


class _ScannedLog(NamedTuple):
    path: str
    aircraft: str
    pinned: bool


def _judged(connection: Connection, sha256: str) -> _ScannedLog | None:
    """Return where a store has judged a log, and its aircraft; None if it has not."""
    asked = select(FLIGHT.c.path, AIRCRAFT.c.name, FLIGHT.c.pinned).join(AIRCRAFT)
    row = connection.execute(asked.where(FLIGHT.c.sha256 == sha256, FLIGHT.c.format == FORMAT)).first()
    return None if row is None else _ScannedLog(*row)


def _past(store: Store, aircraft: str, moment: datetime) -> Past:
    history = earlier_flights(store, aircraft)
    return Past(history, history.since(moment))


def _kept(log: Path, store: Place, options: Options) -> Assessment:
    """Return the assessment of a log in a store, under the path that the user gave.

    Raises
    ------
    MavhumsError
        If the log could not be judged.
    """
    if not log.is_file():
        if log.is_dir():
            raise MavhumsError(f"{log}: is a folder", f"mavhums fleet scan {log} --to {store}")
        raise MavhumsError(f"{log}: no such regular file", "check the path")
    kept = Store(store).opened()
    digest, path = _sha256(log), as_utf8(log.absolute())
    best = FLIGHT.alias()
    with kept.reading() as connection:
        failed = select(LOG.c.problem, LOG.c.remedy).where(LOG.c.path == path, LOG.c.problem.is_not(None))
        failure = connection.execute(failed).first()
        row = _judged(connection, digest)
        if failure is not None and row is None:
            raise MavhumsError(*failure)
        if row is None:
            problem = f"{log}: was removed from {store}"
            raise MavhumsError(problem, f"see the number: mavhums fleet journal {store}; and --undo it")
        copies = connection.execute(
            select(RECORDING.c.vehicle, best.c.path)
            .join(FLIGHT, FLIGHT.c.id == RECORDING.c.flight_id)
            .join(best, best.c.id == RECORDING.c.counted_id)
            .where(FLIGHT.c.sha256 == digest)
        ).all()
        stands = standings(connection).get(row.aircraft, ())
    named = row.aircraft and not row.aircraft.startswith(BOARD_NAME)
    resolver = AircraftResolver(f"{GIVEN}{row.aircraft}") if named else Settings.read(options).resolver
    assessment = resolver.named(flight(store, row.aircraft, digest))
    last = tuple(one for one in stands if one.log == assessment.log.path and not copies)
    assessment = _with_notice(assessment.model_copy(update={"standings": last}), kept)
    others = tuple(
        FlightCopy(vehicle=vehicle, log=counted, sha256=None, counts=True) for vehicle, counted in copies
    )
    summary = assessment.log.model_copy(update={"path": as_utf8(log), "copies": others})
    return assessment.model_copy(update={"log": summary})
