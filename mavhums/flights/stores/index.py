"""A folder of flights with an index: the cost of one more flight does not depend on the number of flights.

The index lists the reference flights of each indicator. Only their files are read, and :class:`FlightHistory`
computes the same baselines from them as from the whole folder. The index is a cache: it follows the files'
times and sizes, and is rebuilt if it is missing, damaged or of another version.
"""

from __future__ import annotations

import os
import sqlite3
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from datetime import UTC, datetime, timedelta
from functools import cache, partial
from pathlib import Path
from stat import S_ISDIR
from typing import Final, NamedTuple
from weakref import finalize

from pydantic import TypeAdapter

from mavhums.core.collecting import no_collection
from mavhums.core.errors import MavhumsError
from mavhums.flights.belonging import Owner, owners_of
from mavhums.flights.duplicates import Recording, copies
from mavhums.flights.history import REFERENCE_FLIGHTS, FlightHistory, PastFlight, Since, is_healthy
from mavhums.flights.stores.folder import UnusedError, assessment_files, read_file, read_history
from mavhums.health.decision.baseline import Baselines
from mavhums.health.self_baseline.past import PastRecord
from mavhums.report.assessment import Assessment
from mavhums.report.flight import CLOCKS_APART_S

__all__ = ["INDEX", "IndexedFolder"]

INDEX: Final = ".mavhums-index.sqlite"
_VERSION: Final = 3
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_WAIT_S: Final = 30.0
_LAST: Final = 1 << 62
_TABLES: Final = """
CREATE TABLE file (name TEXT PRIMARY KEY, time_ns INTEGER, size INTEGER) WITHOUT ROWID;
CREATE TABLE told (name TEXT, failed INTEGER, problem TEXT, remedy TEXT);
CREATE TABLE flight (name TEXT, place INTEGER, same TEXT, log TEXT, PRIMARY KEY (name, place)) WITHOUT ROWID;
CREATE TABLE slim (name TEXT, start INTEGER, stop INTEGER, written REAL, content BLOB);
CREATE TABLE shown (airframe TEXT, vehicle INTEGER, actuator TEXT, fault TEXT, start INTEGER, same TEXT,
    name TEXT, place INTEGER, stop INTEGER,
    PRIMARY KEY (airframe, vehicle, actuator, fault, start, same, name, place)) WITHOUT ROWID;
CREATE TABLE series (airframe TEXT, vehicle INTEGER, actuator TEXT, fault TEXT,
    PRIMARY KEY (airframe, vehicle, actuator, fault)) WITHOUT ROWID;
CREATE TABLE recording (airframe TEXT, vehicle INTEGER, board TEXT, boot REAL, start INTEGER, name TEXT,
    place INTEGER, stop INTEGER, content TEXT,
    PRIMARY KEY (airframe, vehicle, board, boot, start, name, place)) WITHOUT ROWID;
CREATE TABLE owner (vehicle INTEGER, board TEXT, aircraft TEXT, start INTEGER, name TEXT, place INTEGER);
CREATE INDEX owner_all ON owner (vehicle, board, aircraft, start);
CREATE INDEX owner_name ON owner (name);
CREATE INDEX recording_name ON recording (name, place);
CREATE INDEX flight_log ON flight (log);
CREATE INDEX flight_same ON flight (same);
CREATE INDEX shown_name ON shown (name);
CREATE INDEX slim_name ON slim (name);
CREATE INDEX told_name ON told (name);
"""
_LATEST: Final = """
NOT EXISTS (SELECT 1 FROM flight AS other JOIN file AS theirs ON theirs.name = other.name
    WHERE other.same = flight.same
    AND (theirs.time_ns, other.name, other.place) > (file.time_ns, flight.name, flight.place))
"""
_REFERENCES: Final = f"""
SELECT shown.name, flight.log FROM shown JOIN flight USING (name, place) JOIN file USING (name)
WHERE airframe = ? AND vehicle = ? AND actuator = ? AND fault = ? AND start >= ? AND start <= ? AND stop <= ?
AND {_LATEST}
ORDER BY start, shown.same
"""
_BOOTS: Final = """
SELECT DISTINCT board, boot FROM flight CROSS JOIN recording USING (name, place)
WHERE airframe = ? AND log = ? AND vehicle = ?
"""
_RECORDINGS: Final = f"""
SELECT boot, log, name, content FROM recording JOIN flight USING (name, place) JOIN file USING (name)
WHERE airframe = ? AND vehicle = ? AND board = ? AND boot >= ? AND boot <= ? AND stop <= ? AND {_LATEST}
ORDER BY start, flight.same
"""


class _Slim(NamedTuple):
    assessment: Assessment
    recordings: tuple[Recording, ...]


_CONTENT: Final = TypeAdapter(Recording)
_SLIM: Final = TypeAdapter(_Slim)
_Near = dict[tuple[str, int], tuple[Recording, str]]


class _File(NamedTuple):
    name: str
    time_ns: int
    size: int


class IndexedFolder:
    """The flights in a folder of assessments; only the files that a baseline needs are read.

    Parameters
    ----------
    folder
        The same as for :func:`mavhums.flights.stores.folder.read_history`.
    progress
        Called with the number of new or changed files read, and the total.

    Raises
    ------
    MavhumsError
        If the folder does not exist.
    """

    def __init__(
        self, folder: str | os.PathLike[str], *, progress: Callable[[int, int], None] | None = None
    ) -> None:
        self._folder = Path(folder)
        files = [*_files(self._folder)]
        try:
            self._base = _opened(self._folder / INDEX)
            self._follow(files, progress)
        except sqlite3.Error as error:  # damaged, or in a read-only folder
            if not isinstance(error, sqlite3.OperationalError):
                (self._folder / INDEX).unlink(missing_ok=True)
            self._base = _opened(":memory:")
            self._follow(files, progress)
        finalize(self, self._base.close)

    @property
    def flights(self) -> tuple[PastFlight, ...]:
        """All flights; this reads the whole folder."""
        return read_history(self._folder).flights

    @property
    def errors(self) -> tuple[MavhumsError, ...]:
        """Files of the folder that could not be read."""
        told = self._base.execute("SELECT problem, remedy FROM told WHERE failed ORDER BY name")
        return tuple(MavhumsError(problem, remedy) for problem, remedy in told)

    @property
    def notices(self) -> tuple[str, ...]:
        """Files that were ignored without loss of data."""
        told = self._base.execute("SELECT problem FROM told WHERE NOT failed ORDER BY name").fetchall()
        (twice,) = self._base.execute("SELECT COUNT(*) - COUNT(DISTINCT same) FROM flight").fetchone()
        older = [f"{self._folder}: {twice} older assessments of logs that were judged again"] if twice else []
        return (*(problem for (problem,) in told), *older)

    def baselines(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> Baselines:
        """Return the same as :meth:`FlightHistory.baselines` for the whole folder."""
        if before is None:
            return {}
        return self._flights(self._references(airframe, before, since)).baselines(airframe, before, since)

    def past(
        self, airframe: str | None, before: datetime | None, since: Since | None = None
    ) -> dict[tuple[int, str], list[PastRecord]]:
        """Return the same as :meth:`FlightHistory.past` for the whole folder."""
        if before is None:
            return {}
        rows = self._base.execute(
            "SELECT name, start, stop, written, content FROM slim WHERE stop <= ?", (_microseconds(before),)
        )
        with no_collection():
            flights = tuple(self._slim(*row) for row in rows)
        return FlightHistory(flights).past(airframe, before, since)

    @property
    def name(self) -> str:
        """What the history is called in messages."""
        return str(self._folder)

    def owners(self) -> list[Owner]:
        """Return the same as :meth:`FlightHistory.owners` for the whole folder."""
        rows = self._base.execute(
            "SELECT vehicle, board, aircraft, MIN(start), MAX(start) FROM owner"
            " GROUP BY vehicle, board, aircraft"
        )
        return [
            Owner(vehicle, board, aircraft, (_moment(first), _moment(last)))
            for vehicle, board, aircraft, first, last in rows
        ]

    def near(self, flight: PastFlight) -> list[PastFlight]:
        """Return the flights in other logs that may be the same flight; only their files are read."""
        named = flight.assessment.airframe or ""
        names = {
            name
            for each in flight.recordings
            for _, name in self._near(
                named, _LAST, each.flight.vehicle, each.flight.board or "", each.boot_s
            ).values()
        }
        return self._flights(names).near(flight)

    def with_flight(self, assessment: Assessment) -> IndexedFolder:
        """Return the folder with one more flight, which is already stored in it."""
        self._follow([*_files(self._folder)], None)
        return self

    def _slim(self, name: str, start: int, stop: int, written: float, content: bytes) -> PastFlight:
        assessment, recordings = _SLIM.validate_json(zlib.decompress(content))
        times = _moment(start), _moment(stop)
        return PastFlight(assessment, *times, self._folder / name, written, recordings)

    def _references(self, airframe: str | None, before: datetime, since: Since | None) -> set[str]:
        """Return the names of the files with the reference flights of any actuator."""
        dates, named, last = since or {}, airframe or "", _microseconds(before)
        names: set[str] = set()
        series = self._base.execute(
            "SELECT vehicle, actuator, fault FROM series WHERE airframe = ?", (named,)
        ).fetchall()
        better = cache(partial(self._better, named, last))
        for vehicle, actuator, fault in series:
            date = dates.get(actuator, dates.get(None))
            first = -_LAST if date is None else _microseconds(date)
            left = REFERENCE_FLIGHTS
            for name, log in self._base.execute(
                _REFERENCES, (named, vehicle, actuator, fault, first, last, last)
            ):
                taken = better(log, vehicle)
                names.add(taken or name)
                left -= taken is None
                if not left:
                    break
        return names

    def _better(self, airframe: str, last: int, log: str, vehicle: int) -> str | None:
        """Return the file of the log that is taken instead of this one for a vehicle's flight, if any."""
        for board, boot in self._base.execute(_BOOTS, (airframe, log, vehicle)).fetchall():
            near = self._near(airframe, last, vehicle, board, boot)
            taken = copies({key: recording for key, (recording, _) in near.items()}).get((log, vehicle))
            if taken is not None:
                return near[taken][1]
        return None

    def _near(self, airframe: str, last: int, vehicle: int, board: str, boot_s: float) -> _Near:
        """Return the recordings, with their files, that may be of the flight with this boot time."""
        first_s = last_s = boot_s
        while True:
            reach = (first_s - CLOCKS_APART_S, last_s + CLOCKS_APART_S)
            rows = self._base.execute(_RECORDINGS, (airframe, vehicle, board, *reach, last)).fetchall()
            boots = [boot for boot, *_ in rows]
            if not rows or (min(boots) >= first_s and max(boots) <= last_s):
                return {(log, vehicle): (_recording(content), name) for _, log, name, content in rows}
            first_s, last_s = min(first_s, *boots), max(last_s, *boots)

    def _flights(self, names: Iterable[str]) -> FlightHistory:
        read = [flight for name in names for flight in read_file(self._folder / name)]
        return FlightHistory(tuple(flight for flight in read if isinstance(flight, PastFlight)))

    def _follow(self, files: list[_File], progress: Callable[[int, int], None] | None) -> None:
        """Update the index to the present files of the folder."""
        known = {_File(*row) for row in self._base.execute("SELECT name, time_ns, size FROM file")}
        there = set(files)
        new = sorted(there - known)
        with self._base:
            for file in known - there:
                for table in ("file", "told", "flight", "slim", "shown", "recording", "owner"):
                    self._base.execute(f"DELETE FROM {table} WHERE name = ?", (file.name,))
            for number, file in enumerate(new, 1):
                if progress:
                    progress(number, len(new))
                self._base.execute("INSERT OR REPLACE INTO file VALUES (?, ?, ?)", file)
                for place, outcome in enumerate(read_file(self._folder / file.name)):
                    self._add(file.name, place, outcome)

    def _add(self, name: str, place: int, outcome: PastFlight | MavhumsError) -> None:
        if not isinstance(outcome, PastFlight):
            told = (name, not isinstance(outcome, UnusedError), outcome.problem, outcome.remedy)
            self._base.execute("INSERT INTO told VALUES (?, ?, ?, ?)", told)
            return
        judged = outcome.assessment.airframe or ""
        same = f"{outcome.log}\n{judged}"
        self._base.execute("INSERT INTO flight VALUES (?, ?, ?, ?)", (name, place, same, outcome.log))
        times = _microseconds(outcome.start), name, place, _microseconds(outcome.end)
        slim = outcome.without("evidence", "provenance", "indicators")
        content = _SLIM.dump_json(
            _Slim(slim.assessment, outcome.recordings), by_alias=True, exclude_defaults=True
        )
        row = (name, times[0], times[-1], outcome.written, zlib.compress(content, 1))
        self._base.execute("INSERT INTO slim VALUES (?, ?, ?, ?, ?)", row)
        recordings = [(each, _CONTENT.dump_json(each).decode()) for each in outcome.recordings]
        self._base.executemany(
            "INSERT INTO owner VALUES (?, ?, ?, ?, ?, ?)",
            [(*owner[:3], times[0], name, place) for owner in owners_of(outcome.assessment, outcome.start)],
        )
        for airframe in {judged, *judged.split(", ")}:
            series = [
                (airframe, verdict.vehicle, verdict.actuator, shown.fault)
                for verdict in outcome.assessment.verdicts
                if verdict.vehicle is not None and is_healthy(verdict)
                for shown in verdict.indicators
            ]
            self._base.executemany("INSERT OR IGNORE INTO series VALUES (?, ?, ?, ?)", series)
            self._base.executemany(
                "INSERT OR IGNORE INTO shown VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                [(*which, times[0], same, *times[1:]) for which in series],
            )
            self._base.executemany(
                "INSERT OR IGNORE INTO recording VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                [
                    (airframe, each.flight.vehicle, each.flight.board, each.boot_s, *times, content)
                    for each, content in recordings
                ],
            )


def _opened(path: Path | str) -> sqlite3.Connection:
    """Open the index; create it if there is none of this version."""
    base = sqlite3.connect(path, timeout=_WAIT_S, isolation_level="IMMEDIATE", check_same_thread=False)
    try:
        (version,) = base.execute("PRAGMA user_version").fetchone()
        if version != _VERSION:
            with closing(base.cursor()) as cursor:
                there = cursor.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
                drops = "".join(f'DROP TABLE "{name}";' for (name,) in there)
                cursor.executescript(f"BEGIN;{drops}{_TABLES}PRAGMA user_version = {_VERSION};COMMIT;")
    except sqlite3.Error:
        base.close()
        raise
    return base


def _files(folder: Path) -> Iterator[_File]:
    for entry in assessment_files(folder):
        try:
            status = entry.stat()
        except OSError:
            yield _File(entry.name, 0, -1)
            continue
        if not S_ISDIR(status.st_mode):
            yield _File(entry.name, status.st_mtime_ns, status.st_size)


def _recording(content: str) -> Recording:
    return _CONTENT.validate_json(content)


def _moment(microseconds: int) -> datetime:
    return _EPOCH + timedelta(microseconds=microseconds)


def _microseconds(time: datetime) -> int:
    return (time - _EPOCH) // timedelta(microseconds=1)
