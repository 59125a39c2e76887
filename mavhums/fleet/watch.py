"""Scans logs as they land: those whose size and time of modification stand still."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

from mavhums.app.settings import Settings
from mavhums.fleet.rows import AGAIN, settings_of
from mavhums.fleet.scan import ScanOptions, scanned
from mavhums.fleet.sources import logs_in
from mavhums.flights.corrections import removed_files
from mavhums.flights.queries import standings
from mavhums.flights.store import LogFile, Store
from mavhums.results.standing import Standing

__all__ = ["Landed", "Watch"]


class Landed(NamedTuple):
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


class Watch:
    """Looks for logs, again and again, and scans those that are complete.

    A log that somebody writes or copies changes its size or its time; it is judged when both have stood still
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
        self._told: set[LogFile] = set()

    def look(self, now_s: float) -> list[Landed]:
        """Scan the logs that have stood still, and return what is new of them.

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

    def _scan(self, ready: list[LogFile]) -> Iterator[Landed]:
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
            elif file in self._told:  # one that could not be downloaded is tried again, and told once
                continue
            else:
                self._told.add(file)
            yield landed

    def _landed(self, file: LogFile, stands: dict[str, tuple[Standing, ...]]) -> Landed | None:
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
        return Landed(file.path, aircraft, problem, remedy, Counter(dict(found)), findings)
