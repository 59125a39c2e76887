"""Watches folders, and scans the logs in them as they land."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from sqlalchemy import Connection, func, select

from mavhums.app.settings import Settings
from mavhums.fleet.judging import AGAIN
from mavhums.fleet.scan import ScanOptions, scan_files
from mavhums.fleet.sources import logs_in
from mavhums.flights.queries import standings
from mavhums.flights.store import LogFile, Store
from mavhums.flights.store.logs import known_files, removed_files
from mavhums.flights.store.tables import AIRCRAFT, FLIGHT, LOG, VERDICT
from mavhums.results.standing import Standing


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
        The states of the actuators that need somebody's attention, if this is their last flight.
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
            states = standings(connection)
            landed = {file: _landed(connection, file, states) for file in new}
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
    connection: Connection, file: LogFile, states: dict[str, tuple[Standing, ...]]
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
    findings = tuple(one for one in states.get(row.name or "", ()) if one.is_finding and one.log == file.path)
    return ScannedFlight(file.path, row.name or "", row.problem, row.remedy, conditions, findings)
