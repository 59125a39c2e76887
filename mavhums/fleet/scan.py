"""Scans logs into a store: workers judge, and only this process commits."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from time import monotonic
from typing import Final, NamedTuple

from sqlalchemy import Connection

from mavhums.app.settings import Options, Settings
from mavhums.fleet.judging import Judging, connected, judged, judged_by_workers
from mavhums.fleet.sources import logs_in
from mavhums.flights.naming import remember, resolver_of_store
from mavhums.flights.store import LogFile, Row, Store
from mavhums.flights.store.logs import add_logs, known_files, removed_files
from mavhums.flights.store.verdicts import make_verdicts

_COMMIT_LOGS: Final = 500
_COMMIT_S: Final = 30.0

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanOptions:
    """The options of a scan.

    Attributes
    ----------
    judging
        Options for each log, without a store. The store remembers their rule for the aircraft's name for
        later scans; without one it takes the board's id. A log without a name is compared with no other. A
        rule that is given names the scanned logs that the store has already again. The store keeps their
        table of boards and actuators, too, which goes before the rule, and applies it to its logs.
    workers
        Processes on this machine; with 0, this process judges, which is soonest for the log of one landing.
    scheduler
        Address of a Dask scheduler whose workers judge instead, such as ``tls://10.0.0.1:8786``. They must
        have logs and profiles under the same paths.
    """

    judging: Options = field(default_factory=Options)
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
    settings = Settings.read(options.judging)
    given, fingerprint = settings.resolver, settings.fingerprint()
    kept = Store(store)
    with kept.writing() as connection:
        remember(connection, given, files)
        resolver = resolver_of_store(connection, given)
        known, gone = known_files(connection, files), removed_files(connection)
    new = [file for file in files if known.get(file) != fingerprint and file not in gone]
    commits = _Commits(kept)
    judging = Judging(settings.engine, fingerprint, resolver)
    with ExitStack() as exits:
        if new and options.scheduler:
            rows = judged_by_workers(exits.enter_context(connected(options.scheduler)), new, judging)
        else:
            rows = exits.enter_context(closing(judged(new, judging, options.workers)))
        try:
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
