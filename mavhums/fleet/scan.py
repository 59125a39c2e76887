"""Scans logs into a fleet's store, once or as they land: workers judge, and only this process commits."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import Final, NamedTuple

from sqlalchemy import Connection, func, select

from mavhums.app.settings import Options, Settings
from mavhums.fleet.judging import AGAIN, Judging, connected, judge, judged_by_workers
from mavhums.fleet.sources import logs_in
from mavhums.flights.aircraft import AircraftTable
from mavhums.flights.naming import remember, resolver_of_store
from mavhums.flights.queries import standings
from mavhums.flights.store import LogFile, Row, Store
from mavhums.flights.store.logs import add_logs, known_files, removed_files
from mavhums.flights.store.tables import AIRCRAFT, FLIGHT, LOG, VERDICT
from mavhums.flights.store.verdicts import make_verdicts
from mavhums.results.standing import Standing

_COMMIT_LOGS: Final = 500
_COMMIT_S: Final = 30.0

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanOptions:
    """The options of a scan.

    Attributes
    ----------
    judging
        Options for each log, without a store.
    aircraft
        Rule for the aircraft's name: ``folder`` for the name of the log's folder, ``board`` for the id of its
        board, or a regular expression with a group ``aircraft``. The store remembers it for later scans; a
        store without one takes the board's id. A log without a name is compared with no other. A rule that
        is given names the scanned logs that the store has already again.
    aircraft_table
        The operator's table of installed boards and actuators, or its file; it goes before the rule. The
        store keeps it, and applies it to the logs that it has already.
    workers
        Processes on this machine; with 0, this process judges, which is soonest for the log of one landing.
    scheduler
        Address of a Dask scheduler whose workers judge instead, such as ``tls://10.0.0.1:8786``. They must
        have logs and profiles under the same paths.
    """

    judging: Options = field(default_factory=Options)
    aircraft: str | None = None
    aircraft_table: AircraftTable | str | os.PathLike[str] | None = None
    workers: int = 1
    scheduler: str | None = None


class Scanned(NamedTuple):
    """The result of a scan: the number of logs judged, of logs that failed, and of logs known before."""

    judged: int
    failed: int
    known: int


def scan(
    sources: Iterable[str | os.PathLike[str]],
    store: str | os.PathLike[str],
    options: ScanOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Scanned:
    """Judge the logs that are not in a store yet, and compare their aircraft with the past.

    A log is identified by its path, size and time, and by everything its judgement depends on. Results are
    committed every 500 logs or 30 s, and at an interruption; the same call resumes.

    Parameters
    ----------
    sources
        Logs, folders with logs at any depth, or patterns; paths, or addresses such as ``s3://bucket/logs``.
    store
        File of the store, or its address.
    options
        Options of the scan; the defaults if None.
    progress
        Called with the number of finished logs and the total.

    Raises
    ------
    MavhumsError
        If there are no such logs, the store cannot be written, or the scheduler does not exist.
    MissingExtraError
        If the packages of the extra ``fleet`` are not installed.

    Examples
    --------
    >>> from mavhums import fleet
    >>> fleet.scan(["flight.tlog"], "store", fleet.ScanOptions(aircraft="folder")).failed  # doctest: +SKIP
    0
    """
    return scan_files(logs_in(sources), store, options or ScanOptions(), progress=progress)


def scan_files(
    files: Sequence[LogFile],
    store: str | os.PathLike[str],
    options: ScanOptions,
    *,
    progress: Progress | None = None,
) -> Scanned:
    """Scan listed logs; parameters and errors are those of :func:`scan`."""
    named = replace(options.judging, aircraft=options.aircraft, aircraft_table=options.aircraft_table)
    settings = Settings.read(named)
    given, fingerprint = settings.resolver, settings.fingerprint()
    kept = Store(store)
    with kept.writing() as connection:
        remember(connection, given, files)
        resolver = resolver_of_store(connection, given)
        known, gone = known_files(connection, files), removed_files(connection)
    new = [file for file in files if known.get(file) != fingerprint and file not in gone]
    commits = _Commits(kept)
    judging = Judging(options.judging, fingerprint, resolver)
    with ExitStack() as exits:
        try:
            rows: Iterator[Row] = (judge(file, judging) for file in new)
            if new and (options.workers or options.scheduler):
                client = exits.enter_context(connected(options.workers, options.scheduler))
                rows = judged_by_workers(client, new, judging)
            for done, row in enumerate(rows, 1):
                commits.add(row)
                if progress:
                    progress(done, len(new))
        finally:  # what is judged is kept, whatever ended the scan
            commits.close()
    return Scanned(commits.judged, commits.failed, len(files) - len(new))


class _Commits:
    """Commits judged logs in blocks; the last block together with the verdicts on all."""

    def __init__(self, store: Store) -> None:
        self.judged = self.failed = 0
        self._store = store
        self._rows: list[Row] = []
        self._since_s = monotonic()

    def add(self, row: Row) -> None:
        self._rows.append(row)
        if len(self._rows) >= _COMMIT_LOGS or monotonic() - self._since_s > _COMMIT_S:
            with self._store.writing() as connection:
                self._put(connection)

    def close(self) -> None:
        with self._store.writing() as connection:
            self._put(connection)
            make_verdicts(connection)

    def _put(self, connection: Connection) -> None:
        judged, failed = add_logs(connection, self._rows)
        self.judged += judged
        self.failed += failed
        self._rows, self._since_s = [], monotonic()


class ScannedFlight(NamedTuple):
    """A log that has been scanned.

    Attributes
    ----------
    path, aircraft
        Of the log; the aircraft is empty if it is unknown.
    problem, remedy
        Why it could not be judged; None if it was.
    conditions
        How often the flight, compared with the earlier ones, has each condition.
    findings
        How the actuators stand that need somebody's attention, if this is their last flight.
    """

    path: str
    aircraft: str
    problem: str | None
    remedy: str | None
    conditions: Counter[str]
    findings: tuple[Standing, ...]


class LogWatcher:
    """Looks for logs again and again, and scans those that are complete.

    A log that somebody writes or copies changes its size or its time; it is judged when neither has changed
    for a while, by this computer's clock, because that of a file server may differ.

    Parameters
    ----------
    sources
        Logs, folders or patterns, as of :func:`mavhums.fleet.scan`.
    store
        File or address of the store.
    options
        Options of each scan.
    settle_s
        Seconds for which a log must not change.

    Attributes
    ----------
    looks
        Number of looks that succeeded.
    """

    def __init__(
        self,
        sources: Iterable[str | os.PathLike[str]],
        store: str | os.PathLike[str],
        options: ScanOptions,
        *,
        settle_s: float,
    ) -> None:
        self.looks = 0
        self._sources = list(sources)
        self._store = Store(store)
        self._options = options
        self._settle_s = settle_s
        named = replace(options.judging, aircraft=options.aircraft, aircraft_table=options.aircraft_table)
        # a mistake in an option ends the watch before it begins
        self._settings = Settings.read(named).fingerprint()
        self._since_s: dict[LogFile, float] = {}
        self._done: set[LogFile] = set()
        self._reported: set[LogFile] = set()

    def look(self, now_s: float) -> list[ScannedFlight]:
        """Scan the logs that no longer change, and return the newly judged ones.

        Parameters
        ----------
        now_s
            Time on a clock that never goes back.

        Raises
        ------
        MavhumsError
            As of :func:`mavhums.fleet.scan`; the next look tries again.
        """
        files = logs_in(self._sources)
        self._done &= {*files}
        waiting = [file for file in files if file not in self._done]
        self._since_s = {file: self._since_s.get(file, now_s) for file in waiting}
        ready = [file for file in waiting if now_s - self._since_s[file] >= self._settle_s]
        landed = [*self._scan(ready)] if ready else []
        self.looks += 1
        return landed

    def _scan(self, ready: list[LogFile]) -> Iterator[ScannedFlight]:
        known, removed = self._known(ready)
        self._done |= {file for file in ready if known.get(file) == self._settings} | removed & {*ready}
        new = [file for file in ready if file not in self._done]
        if not new:
            return
        scan_files(new, self._store.address, self._options)
        known, _ = self._known(new)
        with self._store.reading() as connection:
            stands = standings(connection)
            landed = {file: _landed(connection, file, stands) for file in new}
        for file, one in landed.items():
            if one is None:  # a copy of a log that was removed
                self._done.add(file)
                continue
            if known.get(file) != AGAIN:
                self._done.add(file)
            elif file in self._reported:  # one that could not be downloaded is tried again, and reported once
                continue
            else:
                self._reported.add(file)
            yield one

    def _known(self, files: list[LogFile]) -> tuple[dict[LogFile, str], set[LogFile]]:
        """Return the settings by which logs were judged, and those that were removed."""
        if not self._store.exists:
            return {}, set()
        with self._store.opened().reading() as connection:
            return known_files(connection, files), removed_files(connection)


def _landed(
    connection: Connection, file: LogFile, stands: dict[str, tuple[Standing, ...]]
) -> ScannedFlight | None:
    log = (
        select(LOG.c.problem, LOG.c.remedy, LOG.c.flight_id, AIRCRAFT.c.name)
        .outerjoin(FLIGHT, FLIGHT.c.id == LOG.c.flight_id)
        .outerjoin(AIRCRAFT, AIRCRAFT.c.id == FLIGHT.c.aircraft_id)
        .where(LOG.c.path == file.path, ~LOG.c.removed)
        .order_by(LOG.c.scanned_us.desc())
    )
    row = connection.execute(log.limit(1)).first()
    if row is None:
        return None
    counts = (
        select(VERDICT.c.worst, func.count())
        .where(VERDICT.c.flight_id == row.flight_id, VERDICT.c.counts)
        .group_by(VERDICT.c.worst)
        .order_by(func.max(VERDICT.c.urgency).desc())
    )
    conditions: Counter[str] = Counter(dict(connection.execute(counts).all()))
    findings = tuple(one for one in stands.get(row.name or "", ()) if one.is_finding and one.log == file.path)
    return ScannedFlight(file.path, row.name or "", row.problem, row.remedy, conditions, findings)
