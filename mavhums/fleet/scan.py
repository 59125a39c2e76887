"""Scans logs into a fleet's store, once or as they land: workers judge, and only this process commits."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from time import monotonic
from typing import TYPE_CHECKING, Final, NamedTuple

from mavhums.app.settings import Options, Settings
from mavhums.core.errors import MavhumsError
from mavhums.fleet.judging import AGAIN, Judging, connected, judge, judged_by_workers, settings_of
from mavhums.fleet.second_pass import second_pass
from mavhums.fleet.sources import logs_in
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
from mavhums.flights.naming import check_aircraft_named, names_of, remember, renamed, resolver_of_store
from mavhums.flights.queries import standings
from mavhums.flights.store import LogFile, Row, Store
from mavhums.flights.store_tables import REMOVED
from mavhums.results.standing import Standing

if TYPE_CHECKING:
    from distributed import Client

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
        Address of a Dask scheduler whose workers judge instead, such as ``tls://10.0.0.1:8786``. They must
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
    given = Settings.read(named).resolver
    alone = replace(options.judging, history=None)
    settings = settings_of(alone)
    kept = Store(store)
    with kept.locked():
        resolver = resolver_of_store(kept, given)
        known = kept.known(files)
        gone = removed_files(kept)
        new = [file for file in files if known.get(file) != settings and file not in gone]
        table = resolver.table if given.table.installed else given.table
        touched = reassigned(kept, table) | renamed(kept, known, replace(resolver, rule=given.rule))
        commits = _Commits(kept, touched, given if asks else None)
        remember(kept, given)
        judging, client = Judging(alone, settings, resolver), None
        exits = ExitStack()
        try:
            rows: Iterator[Row] = (judge(file, judging) for file in new)
            if new and (options.workers or options.scheduler):
                client = exits.enter_context(connected(options.workers, options.scheduler))
                rows = judged_by_workers(client, new, judging)
            for done, row in enumerate(rows, 1):
                commits.add(row)
                if progress:
                    progress(done, len(new))
        except BaseException:
            exits.close()
            commits.close()
            raise
        with exits:
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
        Folder or address of the store.
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
        Settings.read(named)  # a mistake in an option ends the watch before it begins
        self._settings = settings_of(options.judging)
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
        known = self._store.known(ready)
        self._done |= {file for file in ready if known.get(file) == self._settings}
        self._done |= removed_files(self._store) & {*ready}
        new = [file for file in ready if file not in self._done]
        if not new:
            return
        scanned(new, self._store.place, self._options)
        known = self._store.known(new)
        stands = standings(self._store)
        for file in new:
            landed = self._landed(file, stands)
            if landed is None:  # a copy of a log that was removed
                self._done.add(file)
                continue
            if known.get(file) != AGAIN:
                self._done.add(file)
            elif file in self._reported:  # one that could not be downloaded is tried again, and reported once
                continue
            else:
                self._reported.add(file)
            yield landed

    def _landed(self, file: LogFile, stands: dict[str, tuple[Standing, ...]]) -> ScannedFlight | None:
        row = self._store.query(
            "SELECT aircraft, problem, remedy FROM logs WHERE path = ? ORDER BY scanned DESC LIMIT 1",
            file.path,
        ).fetchone()
        if row is None:
            return None
        aircraft, problem, remedy = row
        found = self._store.query(
            "SELECT worst, count(*) FROM verdicts WHERE path = ? GROUP BY worst ORDER BY max(urgency) DESC",
            file.path,
        ).fetchall()
        standing = stands.get(aircraft, ())
        findings = tuple(one for one in standing if one.is_finding and one.log == file.path)
        return ScannedFlight(file.path, aircraft, problem, remedy, Counter(dict(found)), findings)
