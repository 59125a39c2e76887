"""Scans logs into a store, once or as they land: workers judge, and only this process commits."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from math import ceil
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sqlalchemy import Connection, func, select

from mavhums.app.analysis import Failed, analyse_alone
from mavhums.app.settings import Options, Settings
from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.core.process_pool import LostItem, in_processes
from mavhums.engine.options import EngineOptions
from mavhums.fleet.sources import UnreachedError, at_hand, logs_in
from mavhums.flights.aircraft import UNKNOWN, AircraftResolver
from mavhums.flights.landing import row_of
from mavhums.flights.naming import remember, resolver_of_store
from mavhums.flights.queries import standings
from mavhums.flights.store import LogFile, Row, Store
from mavhums.flights.store.database import AIRCRAFT, FLIGHT, LOG, VERDICT
from mavhums.flights.store.logs import add_logs, known_files, removed_files
from mavhums.flights.store.verdicts import make_verdicts
from mavhums.results.standing import Standing

if TYPE_CHECKING:
    from distributed import Client


AGAIN: Final = ""
"""Settings of a log that the next scan judges again."""

_IN_FLIGHT: Final = 8
_MOST: Final = 20
_SHARE: Final = 4
_TLS: Final = (
    "start it with TLS (https://distributed.dask.org/en/stable/tls.html), name it tls://…, and its"
    " certificates here by Dask's settings distributed.comm.tls.*"
)


class Judging(NamedTuple):
    """How the logs of a scan are judged: the options, their hash, and what names the aircraft."""

    engine: EngineOptions
    settings: str
    resolver: AircraftResolver


def judge_several(files: Sequence[LogFile], judging: Judging) -> list[Row]:
    """Judge logs one by one."""
    return [judge(file, judging) for file in files]


def judge(file: LogFile, judging: Judging) -> Row:
    """Judge a log alone; a log that cannot be judged gives a row with the reason."""
    path = file.path
    try:
        with at_hand(file) as path:
            alone = analyse_alone(path, judging.engine)
    except UnreachedError as error:
        return _failed(file, judging._replace(settings=AGAIN), error.problem, error.remedy)
    except Exception as error:
        failed = Failed.of(Path(path), error)
        return _failed(file, judging, failed.problem.replace(path, file.path), failed.remedy)
    return row_of(alone, file, judging.settings, judging.resolver)


def _failed(file: LogFile, judging: Judging, problem: str, remedy: str) -> Row:
    aircraft = judging.resolver.name(file.path, None, None) or UNKNOWN
    return Row(*file, judging.settings, aircraft, problem=problem, remedy=remedy)


def _crashed(file: LogFile, judging: Judging) -> Row:
    problem = f"{file.path}: crashed the worker that judged it"
    return _failed(file, judging, problem, "judge it alone to see why: mavhums analyse LOG")


@contextmanager
def connected(scheduler: str) -> Iterator[Client]:
    """Connect to a scheduler.

    Dask unpickles what comes to its ports, so whoever reaches them runs code. So every connection has TLS
    with certificates on both sides: those that Dask's configuration names.

    Raises
    ------
    MavhumsError
        If no scheduler answers there, or the connection would not be authenticated.
    MissingExtraError
        If Dask is not installed.
    """
    try:
        from distributed import Client, Security
    except ImportError as error:
        raise MissingExtraError("scanning by a cluster", "fleet") from error
    try:
        client = Client(scheduler, timeout=10, security=Security(require_encryption=True))
    except (OSError, ValueError) as error:
        problem = f"{scheduler}: no scheduler answers"
        raise MavhumsError(problem, "start one: dask scheduler, and dask worker ADDRESS") from error
    except (RuntimeError, TypeError) as error:
        # The address is not tls://, or there is no certificate.
        problem = f"{scheduler}: refused, for without TLS anybody could run code in it"
        raise MavhumsError(problem, _TLS) from error
    with client:
        yield client


def judged(files: Sequence[LogFile], judging: Judging, workers: int) -> Generator[Row]:
    """Yield the row of each log, judged by processes of this machine, or without any by this one."""
    if not workers:
        yield from (judge(file, judging) for file in files)
        return
    with closing(in_processes(partial(judge, judging=judging), files, workers, preload=[__name__])) as rows:
        for file, row in zip(files, rows, strict=True):
            yield _crashed(file, judging) if isinstance(row, LostItem) else row


def count(client: Client) -> int:
    """Return the number of tasks that run at once, at least 1."""
    cores: dict[str, int] = client.ncores()
    return max(sum(cores.values()), 1)


def batches(files: Sequence[LogFile], workers: int) -> Iterator[tuple[LogFile, ...]]:
    """Yield the logs in batches: one log first, so that progress is seen early, and small ones at the end.

    Parameters
    ----------
    files
        All logs.
    workers
        Number of workers, which should end together.

    Examples
    --------
    >>> files = [LogFile(str(n), 0, 0) for n in range(40)]
    >>> [len(several) for several in batches(files, 2)]
    [1, 1, 5, 5, 4, 3, 3, 3, 2, 2, 2, 2, 1, 1, 1, 1, 1, 1, 1]
    """
    done = 0
    while done < len(files):
        share = ceil((len(files) - done) / (_SHARE * workers))
        size = 1 if done < workers else min(share, _MOST)
        yield tuple(files[done : done + size])
        done += size


def judged_by_workers(client: Client, files: Sequence[LogFile], judging: Judging) -> Generator[Row]:
    """Yield the row of each log as it is judged.

    A worker that dies loses its waiting batches. So the logs of a batch that no worker completes are tried
    again at the end, one at a time: a log on which a worker then dies is the cause.
    """
    from distributed import as_completed, wait

    workers = count(client)
    waiting = batches(files, workers)
    running: Any = as_completed()
    pending: dict[str, tuple[LogFile, ...]] = {}
    suspects: list[LogFile] = []

    def submit(several: tuple[LogFile, ...]) -> Any:
        return client.submit(judge_several, several, judging, pure=False)

    def go_on(most: int) -> None:
        for several in islice(waiting, most):
            future = submit(several)
            pending[future.key] = several
            running.add(future)

    go_on(_IN_FLIGHT * workers)
    for future in running:
        several = pending.pop(future.key)
        if future.status == "finished":
            yield from future.result()
        else:
            suspects += several
        future.release()
        go_on(1)
    for file in suspects:
        future = submit((file,))
        wait([future])
        if future.status == "finished":
            yield from future.result()
        else:
            yield _crashed(file, judging)


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
        # a mistake in an option ends the watch before it begins
        self._settings = Settings.read(options.judging).fingerprint()
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
