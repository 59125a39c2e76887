"""A log after a landing: judged against its aircraft's flights in a store, and kept there."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from mavhums.app.analysis import analyse as analyse_log
from mavhums.app.analysis import analyse_alone
from mavhums.app.many import Outcome
from mavhums.app.options import Options
from mavhums.app.own_flights import compared_with_own
from mavhums.core.errors import MavhumsError
from mavhums.fleet.flight import flight
from mavhums.fleet.queries import past_flights
from mavhums.fleet.repairs import since_of
from mavhums.fleet.rows import aircraft_in_store
from mavhums.fleet.scan import ScanOptions, scan
from mavhums.fleet.store import Store
from mavhums.history.aircraft import UNKNOWN, latest
from mavhums.history.comparison import LoneFlight
from mavhums.history.flights import FlightHistory, Since
from mavhums.report.assessment import Assessment
from mavhums.report.flight import FlightCopy

__all__ = ["Past", "against", "analyse", "keep", "past", "record"]

Place = str | os.PathLike[str]


class Past(NamedTuple):
    """An aircraft's flights in a store, and the dates from which they count."""

    history: FlightHistory
    since: Since


def analyse(log: Place, store: Place, options: Options | None = None) -> Assessment:
    """Judge a log and compare it with the flights of its aircraft in a store; the store is not changed.

    The verdicts are those that :func:`scan` stores, unless later logs of earlier flights are scanned.

    Parameters
    ----------
    log
        Path of the log.
    store
        Folder or address of the store.
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
    options = replace(options or Options(), history=None)
    kept = Store(store).opened()
    alone = _alone(log, options)
    return compared_with_own(alone, _with_past(alone, kept, log, options))


def against(log: Place, store: Place, options: Options | None = None) -> Options:
    """Return options with the flights of a log's aircraft in a store as the history.

    With them, :func:`mavhums.analyse` judges and records the log; parameters and errors are those of
    :func:`analyse`. The log is read once to find its aircraft.
    """
    options = replace(options or Options(), history=None)
    kept = Store(store).opened()
    return _with_past(_alone(log, options), kept, log, options)


def past(store: Place, aircraft: str, moment: datetime | None = None) -> Past:
    """Return an aircraft's flights in a store.

    Parameters
    ----------
    store
        Folder or address of the store.
    aircraft
        Its name; an aircraft that the store does not have has no flights.
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
) -> Iterator[Outcome]:
    """Put logs into a store as :func:`scan` does, and return each with its stored verdicts.

    Parameters
    ----------
    logs
        Paths of the logs.
    store
        Folder or address of the store; the first log creates it.
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
    there = [file for file in files if file.is_file()]
    if there:
        scan(there, store, named, progress=progress)
    return _outcomes(files, store, options)


def record(log: Place, store: Place, options: Options, output: Path, *, position: bool = True) -> None:
    """Write the Rerun recording of a log that is judged against its aircraft's flights in a store."""
    analyse_log(log, against(log, store, options), recording=output, position=position)


def _outcomes(files: Sequence[Path], store: Place, options: Options) -> Iterator[Outcome]:
    for file in files:
        try:
            yield Outcome(file, _kept(file, store, options), None)
        except MavhumsError as error:
            yield Outcome(file, None, error)


def _alone(log: Place, options: Options) -> LoneFlight:
    if str(log) == "-":
        raise MavhumsError("-: a store names logs by their files", "save the log first")
    return analyse_alone(log, options.resolved())


def _with_past(alone: LoneFlight, store: Store, log: Place, options: Options) -> Options:
    """Return options with the past of a judged log's aircraft."""
    whose = options.whose()
    start = alone.assessment.log.start_utc
    aircraft = aircraft_in_store(str(Path(log).absolute()), alone.assessment, whose)
    if aircraft == UNKNOWN or start is None:
        return replace(options, aircraft_table=whose.table)
    before = _past(store, aircraft, datetime.fromisoformat(start))
    since = latest(options.since, before.since)
    return replace(options, history=before.history, since=since, aircraft_table=whose.table)


def _past(store: Store, aircraft: str, moment: datetime) -> Past:
    flights = tuple(past_flights(store, aircraft))
    return Past(FlightHistory(flights, name=store.place), since_of(store, aircraft)(moment))


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
        raise MavhumsError(f"{log}: no such file", "check the path")
    kept = Store(store).opened()
    aircraft, sha256, problem, remedy = kept.query(
        "SELECT aircraft, sha256, problem, remedy FROM logs WHERE path = ? ORDER BY scanned DESC LIMIT 1",
        str(log.absolute()),
    ).fetchone()
    if problem is not None:
        raise MavhumsError(problem, remedy)
    copies = kept.query(
        "SELECT vehicle, counted FROM copies WHERE aircraft = ? AND sha256 = ?", aircraft, sha256
    ).fetchall()
    if copies:
        assessment = analyse(log, store, options)
    else:
        assessment = options.whose().named(flight(store, aircraft, sha256))
    others = tuple(
        FlightCopy(vehicle=vehicle, log=counted, sha256=None, counts=True) for vehicle, counted in copies
    )
    summary = assessment.log.model_copy(update={"path": str(log), "copies": others})
    return assessment.model_copy(update={"log": summary})
