"""The store of a fleet: logs judged alone, verdicts compared with the past, and logs that do not count.

Only the scanning process writes; each commit is written whole or not at all. A folder is locked against a
second scan. An object store cannot be locked: a commit that another overtook is made again.
"""

from __future__ import annotations

import logging
import os
import random
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

from pydantic import ValidationError

from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.flights.store_tables import (
    COPIES,
    LOGS,
    SETTLED,
    STANDINGS,
    VERDICTS,
    Tables,
    schemas,
)

FORMAT: Final = 1
"""Version of the stored flights; those of another version are not read, and their logs are judged again."""

OF_THIS_FORMAT: Final = f"coalesce(format, 1) = {FORMAT}"
"""Holds of the logs whose flights this version reads; the first version stored none."""

Key = TypeVar("Key")
Result = TypeVar("Result")

_LOG = logging.getLogger(__name__)
_COMPACT_FILES: Final = 64
_FEW: Final = 1_000
_ATTEMPTS: Final = 12
_PAUSE_S: Final = 0.2
_DAY_NS: Final = 86_400 * 10**9
_LATEST: Final = {SETTLED: "aircraft", STANDINGS: f"aircraft, stored // {_DAY_NS}"}
"""Tables of which only the latest row of each group is kept; of the standings, what each day ended with."""


class LogFile(NamedTuple):
    """A log on disk or in an object store; ``time_ns`` is its time of modification."""

    path: str
    size: int
    time_ns: int


class Row(NamedTuple):
    """The data of a log in the store.

    ``settings`` is the hash of everything besides the log that a judgement depends on. ``board`` is the id of
    the only board that the log reports, None if it reports none or several. ``start_us`` is UTC,
    None for a log without a date. ``flight`` contains the flight judged alone; it is None if ``problem`` and
    ``remedy`` state why it could not be judged.
    """

    path: str
    size: int
    time_ns: int
    settings: str
    sha256: str | None
    aircraft: str
    board: str | None
    start_us: int | None
    duration_s: float | None
    losses: bool
    flight: bytes | None
    problem: str | None
    remedy: str | None


class Store:
    """A fleet's store.

    Parameters
    ----------
    place
        A folder, which the first commit creates, or an object store's address such as ``s3://bucket/fleet``.

    Raises
    ------
    MissingExtraError
        If the packages of the extra ``fleet`` are not installed.
    """

    def __init__(self, place: str | os.PathLike[str]) -> None:
        try:
            import deltalake  # noqa: F401
            import duckdb  # noqa: F401
        except ImportError as error:
            raise MissingExtraError("a fleet's store", "fleet") from error
        self._tables = Tables(os.fspath(place))
        self.place = self._tables.place

    @property
    def is_shared(self) -> bool:
        """Whether several scans can write at once."""
        return self._tables.is_remote

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the store against other scans.

        Raises
        ------
        MavhumsError
            If another scan writes into the store, or it cannot be written.
        """
        if self.is_shared:
            yield
            return
        import filelock

        try:
            Path(self.place).mkdir(0o700, parents=True, exist_ok=True)
            lock = filelock.FileLock(Path(self.place, ".scan.lock"), timeout=0)
            lock.acquire()
        except filelock.Timeout as error:
            problem = f"{self.place}: another scan writes into this store"
            raise MavhumsError(problem, "wait until it has ended") from error
        except OSError as error:
            problem = f"{self.place}: {(error.strerror or str(error)).lower()}"
            raise MavhumsError(problem, "name another folder with --to") from error
        try:
            yield
        finally:
            lock.release()

    def query(self, sql: str, *values: object) -> Any:
        """Return DuckDB's result; the names of :mod:`mavhums.flights.store_tables` name the tables.

        Raises
        ------
        MavhumsError
            If the store does not exist, is damaged, or cannot be reached.
        """
        import duckdb
        from deltalake.exceptions import DeltaError

        base = duckdb.connect()
        try:
            for table in schemas():
                if table in sql:
                    self._tables.show(base, table)
            return base.execute(sql, list(values))
        except (DeltaError, duckdb.Error, OSError) as error:
            raise self._unreadable(error) from error

    def opened(self) -> Store:
        """Return the store.

        Raises
        ------
        MavhumsError
            If the store does not exist, or is damaged.
        """
        if not self._has(LOGS):
            remedy = "fill it: mavhums fleet scan LOGS --to STORE"
            raise MavhumsError(f"{self.place}: no store of a fleet", remedy)
        if not self.is_shared:  # damage is an error also of a command that does not ask the damaged table
            self.query(f"SELECT {', '.join(f'(SELECT count(*) FROM {table})' for table in schemas())}")
        return self

    def parsed(self, parse: Callable[[Key], Result], text: Key) -> Result:
        """Return what a text of the store contains or names.

        Raises
        ------
        MavhumsError
            If it was damaged.
        """
        try:
            return parse(text)
        except (ValidationError, KeyError) as error:
            raise self._unreadable(error) from error

    def add_logs(self, rows: Sequence[Row], table: str = LOGS) -> None:
        """Commit logs, in one transaction."""
        now = time.time_ns()
        stamped = [row._asdict() | {"scanned": now + k, "format": FORMAT} for k, row in enumerate(rows)]
        self.append(table, stamped)

    def append(self, table: str, rows: Sequence[dict[str, object]]) -> None:
        """Commit rows, in one transaction."""
        self.retried(lambda: self._write(table, rows, mode="append"))

    def retried(self, change: Callable[[], None]) -> None:
        """Make a change; if another scan changed the same rows meanwhile, make it again.

        Raises
        ------
        MavhumsError
            If other scans overtake it again and again.
        """
        from deltalake.exceptions import CommitFailedError

        for attempt in range(1, _ATTEMPTS + 1):
            try:
                return change()
            except CommitFailedError:
                time.sleep(attempt * _PAUSE_S * random.random())
        problem = f"{self.place}: other scans change the same aircraft all the time"
        raise MavhumsError(problem, "scan again when they have ended")

    def flights(self, aircraft: str, logs: Sequence[str] | None = None) -> Iterator[bytes]:
        """Yield an aircraft's flights in time order: each log once, in its latest judgement.

        Parameters
        ----------
        aircraft
            Name of the aircraft.
        logs
            Hashes of the logs; None for all.
        """
        named = "" if logs is None else f" AND sha256 IN ({listed_sql(logs)})"
        rows = self.query(
            f"SELECT arg_max(flight, scanned) FROM logs WHERE aircraft = ? AND sha256 IS NOT NULL{named}"
            f" AND {OF_THIS_FORMAT} GROUP BY sha256 ORDER BY min(start_us), min(path)",
            aircraft,
        )
        while several := rows.fetchmany(100):
            yield from (data for (data,) in several)

    def add_verdicts(
        self, aircraft: str, rows: Sequence[dict[str, object]], copies: Sequence[dict[str, object]]
    ) -> None:
        """Commit the verdicts on logs that have none, and the names of those that do not count."""
        for table, several in ((VERDICTS, rows), (COPIES, copies)):
            if several and self.is_shared:  # another scan may have judged the same logs
                logs = listed_sql({str(row["sha256"]) for row in several})
                self._overwrite(table, several, f"aircraft = {_quoted(aircraft)} AND sha256 IN ({logs})")
            elif several:
                self._write(table, several, mode="append")

    def replace(self, table: str, aircraft: str, rows: Sequence[dict[str, object]]) -> None:
        """Replace the rows of an aircraft in a table, in one transaction."""
        if rows or self._has(table):
            self._overwrite(table, rows, f"aircraft = {_quoted(aircraft)}")

    def rewrite(self, table: str, rows: Callable[[], Sequence[dict[str, object]]]) -> None:
        """Replace all rows of a table, in one transaction; they are computed again for each attempt."""
        self.retried(lambda: self._write(table, rows(), mode="overwrite"))

    def delete(self, table: str, predicate: str) -> None:
        """Delete rows by an SQL condition, in one transaction."""
        if self._has(table):
            self.retried(lambda: self._changed(lambda: self._tables.delete(table, predicate)))

    def rename(self, names: Mapping[str, str]) -> None:
        """Give the logs with these hashes to other aircraft, in one transaction."""
        if names:
            self.retried(lambda: self._changed(lambda: self._tables.rename(LOGS, names)))

    def _overwrite(self, table: str, rows: Sequence[dict[str, object]], predicate: str) -> None:
        if not self._has(table):  # first without rows: two scans that create it must not both add theirs
            self._write(table, [], mode="ignore")
        self._write(table, rows, mode="overwrite", predicate=predicate)

    def known(self, files: Sequence[LogFile]) -> dict[LogFile, str]:
        """Return those of the logs that were scanned, each with the settings of its latest judgement."""
        few = f" AND path IN ({listed_sql({file.path for file in files})})" if 0 < len(files) <= _FEW else ""
        rows = self.query(
            f"SELECT path, size, time_ns, settings FROM logs WHERE {OF_THIS_FORMAT}{few} ORDER BY scanned"
        ).fetchall()
        return {LogFile(*file): settings for *file, settings in rows}

    def waiting(self) -> set[str]:
        """Return the aircraft that have logs without a final verdict, as after an interruption."""
        rows = self.query(
            f"WITH judged AS (SELECT * FROM logs WHERE sha256 IS NOT NULL AND {OF_THIS_FORMAT}),"
            " done AS (SELECT aircraft, sha256 FROM verdicts UNION SELECT aircraft, sha256 FROM copies)"
            " SELECT aircraft FROM (SELECT aircraft, sha256 FROM judged EXCEPT FROM done)"
            # a log that was removed, or given to another aircraft
            " UNION SELECT aircraft FROM (FROM done EXCEPT SELECT aircraft, sha256 FROM logs)"
            " UNION SELECT aircraft FROM judged GROUP BY aircraft HAVING max(scanned) >"
            "  (SELECT max(settled.scanned) FROM settled WHERE settled.aircraft = judged.aircraft)"
        ).fetchall()
        return {aircraft for (aircraft,) in rows}

    def tidy(self) -> None:
        """Compact the tables that have many files.

        All results are committed before, so what fails here costs room and time only; it is logged, and the
        next scan tries again.
        """
        try:
            self._compact()
        except Exception as error:  # whatever the libraries raise: a scan that judged its logs has not failed
            _LOG.warning("%s: small files could not be joined: %s", self.place, _words(error))

    def _compact(self) -> None:
        for name in schemas():
            if self._has(name) and self._changed(lambda name=name: self._tables.files(name)) > _COMPACT_FILES:  # type: ignore[misc]
                if name in _LATEST:
                    self._forget(name, _LATEST[name])
                self.retried(lambda name=name: self._changed(lambda: self._tables.compact(name)))  # type: ignore[misc]

    def _forget(self, table: str, of: str) -> None:
        """Keep only the latest row of each group."""
        columns = schemas()[table].names
        latest = self.query(
            f"SELECT {', '.join(columns)} FROM {table}"
            f" QUALIFY row_number() OVER (PARTITION BY {of} ORDER BY stored DESC) = 1"
        ).fetchall()
        rows = [dict(zip(columns, row, strict=True)) for row in latest]
        self.retried(lambda: self._write(table, rows, mode="overwrite"))

    def _has(self, table: str) -> bool:
        try:
            return self._tables.has(table)
        except OSError as error:
            raise self._unreadable(error) from error

    def _write(self, table: str, rows: Sequence[dict[str, object]], **how: Any) -> None:
        self._changed(lambda: self._tables.write(table, rows, **how))

    def _changed(self, change: Callable[[], Result]) -> Result:
        from deltalake.exceptions import CommitFailedError, DeltaError

        try:
            return change()
        except CommitFailedError:
            raise
        except (DeltaError, OSError) as error:
            raise self._unwritable(error) from error

    def _unreadable(self, error: Exception) -> MavhumsError:
        problem = f"{self.place}: the store cannot be read: {_words(error)}"
        if self.is_shared:
            return MavhumsError(problem, "check the address, the network and the credentials")
        return MavhumsError(problem, "restore it from a backup, or scan into a new folder")

    def _unwritable(self, error: Exception) -> MavhumsError:
        problem = f"{self.place}: cannot be written: {_words(error)}"
        return MavhumsError(problem, "free space or repair it, and scan again: the scan resumes")


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"


def listed_sql(texts: Iterable[str]) -> str:
    """Return texts as a list of SQL."""
    return ", ".join(map(_quoted, sorted(texts)))


def _words(error: Exception) -> str:
    """Return an error's message in one line, without the colours and arrows of nested causes."""
    lines = (re.sub(r"\x1b\[[\d;]*m|↳", "", line).strip() for line in str(error).splitlines())
    return ": ".join(line for line in lines if line)[:300]
