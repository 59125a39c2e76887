"""Scans logs into a fleet's store: workers judge, and only this process commits."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import islice
from time import monotonic
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from mavhums.app.settings import Options, Settings
from mavhums.core.errors import MavhumsError
from mavhums.fleet.rows import crashed, judge, judge_several, settings_of
from mavhums.fleet.second_pass import second_pass
from mavhums.fleet.sources import logs_in
from mavhums.fleet.workers import batches, connected, count
from mavhums.flights.aircraft import UNKNOWN, AircraftResolver, UnnamedAircraftError
from mavhums.flights.aircraft_table import AircraftTable
from mavhums.flights.corrections import (
    Repairs,
    add_repairs,
    aircraft_in,
    corrected_names,
    named_in,
    reassigned,
    removed_files,
    removed_logs,
)
from mavhums.flights.naming import check_aircraft_named, names_of, remember, renamed, whose_in
from mavhums.flights.store import LogFile, Row, Store
from mavhums.flights.store_tables import REMOVED

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["ScanOptions", "Scanned", "scan", "scanned"]

_IN_FLIGHT: Final = 8
_COMMIT_LOGS: Final = 500
_COMMIT_S: Final = 30.0
_ROUNDS: Final = 2  # in the second, what another scan of an object store committed in between

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanOptions:
    """The options of a scan.

    Attributes
    ----------
    judging
        Options for each log; a history is ignored, because the store is the history.
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
        Address of a Dask scheduler whose workers judge instead, such as ``tcp://10.0.0.1:8786``. They must
        have logs and profiles under the same paths.
    repairs
        Dates from which actuators' flights count. The store keeps them; a new one changes the verdicts of
        its aircraft without opening a log.
    """

    judging: Options = field(default_factory=Options)
    aircraft: str | None = None
    aircraft_table: AircraftTable | str | os.PathLike[str] | None = None
    workers: int = 1
    scheduler: str | None = None
    repairs: Repairs = ()


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
        Folder of the store, or its address.
    options
        Options of the scan; the defaults if None.
    progress
        Called with the number of finished logs and the total.

    Raises
    ------
    MavhumsError
        If there are no such logs, the store cannot be written, another scan writes into it, or the scheduler
        does not exist.
    MissingExtraError
        If the packages of the extra ``fleet`` are not installed.

    Examples
    --------
    >>> from mavhums import fleet
    >>> fleet.scan(["flight.tlog"], "store", fleet.ScanOptions(aircraft="folder")).failed  # doctest: +SKIP
    0
    """
    options = options or ScanOptions()
    return scanned(logs_in(sources), store, options, progress=progress)[0]


def scanned(
    files: Sequence[LogFile],
    store: str | os.PathLike[str],
    options: ScanOptions,
    *,
    progress: Progress | None = None,
    asks: bool = False,
) -> tuple[Scanned, dict[str, UnnamedAircraftError]]:
    """Scan listed logs; with ``asks``, leave out those whose aircraft is a guess, and return why, by path."""
    named = replace(options.judging, aircraft=options.aircraft, aircraft_table=options.aircraft_table)
    given = Settings.read(named).whose
    options = replace(options, judging=replace(options.judging, history=None))
    settings = settings_of(options.judging)
    kept = Store(store)
    with kept.locked():
        whose = whose_in(kept, given)
        known = kept.known(files)
        gone = removed_files(kept)
        new = [file for file in files if known.get(file) != settings and file not in gone]
        table = whose.table if given.table.installed else given.table
        touched = reassigned(kept, table) | renamed(kept, known, replace(whose, rule=given.rule))
        commits = _Commits(kept, touched, given if asks else None)
        remember(kept, given)
        engine = ExitStack()
        try:
            client = None
            if new and (options.workers or options.scheduler):
                client = engine.enter_context(connected(options.workers, options.scheduler))
            for done, row in enumerate(_rows(client, new, options, settings, whose), 1):
                commits.add(row)
                if progress:
                    progress(done, len(new))
        except BaseException:
            engine.close()
            commits.close()
            raise
        with engine:
            unknown = commits.repair(options.repairs)
            commits.close(client)
    if unknown:
        problem = f"{kept.place}: no aircraft {', '.join(unknown)}, whose repairs are not stored"
        raise MavhumsError(problem, f"the logs are judged; {named_in(kept)}")
    return Scanned(commits.judged, commits.failed, len(files) - len(new)), commits.asked


class _Commits:
    """Collects rows and commits them in blocks; at the end, commits the verdicts of their aircraft."""

    def __init__(self, store: Store, aircraft: set[str], given: AircraftResolver | None) -> None:
        self.judged = self.failed = 0
        self.asked: dict[str, UnnamedAircraftError] = {}
        self._given = given
        self._store = store
        self._rows: list[Row] = []
        self._since_s = monotonic()
        self._aircraft = aircraft

    def add(self, row: Row) -> None:
        if self._given is not None and row.flight is not None:
            try:
                check_aircraft_named(self._store, row, self._given)
            except UnnamedAircraftError as error:
                self.asked[row.path] = error
                return
        self._rows.append(row)
        if len(self._rows) >= _COMMIT_LOGS or monotonic() - self._since_s > _COMMIT_S:
            self._commit()

    def repair(self, repairs: Repairs) -> list[str]:
        """Store repairs, and return the names that no aircraft has: a first scan knows names at its end."""
        self._commit()
        there = aircraft_in(self._store)
        known = [one for one in repairs if one.aircraft is None or one.aircraft in there]
        self._aircraft |= add_repairs(self._store, known)
        return list(dict.fromkeys(one.aircraft for one in repairs if one.aircraft and one not in known))

    def close(self, client: Client | None = None) -> None:
        self._commit()
        for _ in range(_ROUNDS if self._store.is_shared else 1):
            second_pass(self._store, sorted(self._aircraft | self._store.waiting()), client)
            self._aircraft = set()
        self._store.tidy()

    def _commit(self) -> None:
        self._leave_removed()
        if self._rows:
            self._name_copies()
            self._store.add_logs(self._rows)
            self.failed += sum(row.flight is None for row in self._rows)
            self.judged += sum(row.flight is not None for row in self._rows)
            self._aircraft |= {row.aircraft for row in self._rows if row.flight is not None}
        self._rows = []
        self._since_s = monotonic()

    def _leave_removed(self) -> None:
        """Leave out copies of logs that were removed, so that no other path brings them back."""
        gone = removed_logs(self._store, {row.sha256 for row in self._rows if row.sha256})
        if gone:
            self._store.add_logs([row for row in self._rows if row.sha256 in gone], REMOVED)
            self._rows = [row for row in self._rows if row.sha256 not in gone]

    def _name_copies(self) -> None:
        """Give logs of the same bytes, wherever they lie, to one aircraft, so that a flight counts once."""
        stored = names_of(self._store, {row.sha256 for row in self._rows if row.sha256})
        pinned = corrected_names(self._store).logs
        names = {sha256: name for sha256, name in (stored | pinned).items() if name}
        for row in sorted(self._rows, key=lambda row: row.path):
            if row.sha256 and row.aircraft:
                names.setdefault(row.sha256, row.aircraft)
        self._rows = [row._replace(aircraft=names.get(row.sha256 or "", row.aircraft)) for row in self._rows]
        found = {sha256: name for sha256, name in names.items() if stored.get(sha256) == UNKNOWN}
        self._store.rename(found)
        self._aircraft |= {UNKNOWN} if found else set()


def _rows(
    client: Client | None,
    files: Sequence[LogFile],
    options: ScanOptions,
    settings: str,
    whose: AircraftResolver,
) -> Iterator[Row]:
    """Yield the row of each log, from this process or from workers."""
    if client is None:
        yield from (judge(file, options.judging, settings, whose) for file in files)
    else:
        yield from _judged(client, files, options, settings, whose)


def _judged(
    client: Client, files: Sequence[LogFile], options: ScanOptions, settings: str, whose: AircraftResolver
) -> Iterator[Row]:
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

    def submit(several: tuple[LogFile, ...]) -> None:
        future = client.submit(judge_several, several, options.judging, settings, whose, pure=False)
        pending[future.key] = several
        running.add(future)

    for several in islice(waiting, _IN_FLIGHT * workers):
        submit(several)
    for future in running:
        several = pending.pop(future.key)
        if future.status == "finished":
            yield from future.result()
        else:
            suspects += several
        future.release()
        for following in waiting:
            submit(following)
            break
    for file in suspects:
        future = client.submit(judge_several, (file,), options.judging, settings, whose, pure=False)
        wait([future])
        if future.status == "finished":
            yield from future.result()
        else:
            yield crashed(file, settings, whose)
