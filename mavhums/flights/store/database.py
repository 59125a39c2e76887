"""A store's database: how it is opened, read in one state, and written by one at a time."""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from typing import Final, NamedTuple

from pydantic import ValidationError
from sqlalchemy import Connection, Engine, NullPool, create_engine, event, inspect, select
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError, OperationalError, SQLAlchemyError

from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.core.output import as_utf8
from mavhums.flights.store.tables import METADATA, SETTING

SCHEMA: Final = "3"
"""Version of the tables."""

FORMAT: Final = 3
"""Version of the stored flights; the logs of those of another version are judged again."""

# Longest wait for another command that writes; the verdicts of 10,000 flights take a minute and a half.
_PATIENCE_S: Final = 300.0
_PRAGMAS: Final = ("foreign_keys = ON", "synchronous = NORMAL", "cache_size = -32000", "temp_store = MEMORY")
_PASSWORD: Final = re.compile(r"(://[^/@:]*:)[^/]*@")
_REMEDIES: Final = {
    "locked": "another command writes into it: try again when it has ended",
    "lock timeout": "another command writes into it: try again when it has ended",
    "full": "free space, and do it again: what was committed is kept",
    "disk I/O": "check the disk and its space, and do it again: what was committed is kept",
    "readonly": "make the file and its folder writable, or name another store",
}


class LogFile(NamedTuple):
    """A log on disk or in an object store; ``time_ns`` is its time of modification."""

    path: str
    size: int
    time_ns: int

    @classmethod
    def at(cls, path: Path) -> LogFile:
        """Return the log at an absolute path; the judgement of one that is not there reports why."""
        try:
            status = path.stat()
        except OSError:
            return cls(as_utf8(path), -1, 0)
        return cls(as_utf8(path), status.st_size, status.st_mtime_ns)


class Row(NamedTuple):
    """A log as a worker returns it.

    ``settings`` is the hash of everything besides the log that a judgement depends on. ``board`` is the id of
    the only board that the log reports, None if it reports none or several. ``start_us`` is UTC,
    None for a log without a date. ``flight`` contains the flight judged alone; it is None if ``problem`` and
    ``remedy`` state why it could not be judged.
    """

    path: str
    size: int
    time_ns: int
    settings: str
    aircraft: str
    sha256: str | None = None
    board: str | None = None
    start_us: int | None = None
    duration_s: float | None = None
    losses: bool = False
    flight: bytes | None = None
    problem: str | None = None
    remedy: str | None = None


class Store:
    """A store of aircraft and their flights.

    Parameters
    ----------
    place
        A file, which the first write creates, or an address such as ``postgresql://user@host/fleet``.

    Attributes
    ----------
    address
        The place.
    place
        The same to be shown: without a password.

    Raises
    ------
    MavhumsError
        If the place is a folder.
    """

    def __init__(self, place: str | os.PathLike[str]) -> None:
        self.address = os.fspath(place)
        self.is_file = "://" not in self.address
        self.place = self.address if self.is_file else _PASSWORD.sub(r"\1***@", self.address)
        if self.is_file and Path(self.place).is_dir():
            raise MavhumsError(f"{self.place}: is a folder, not a store", "name its file, or a new file")

    def __str__(self) -> str:
        return self.place

    @property
    def exists(self) -> bool:
        """Whether the file exists; a server is asked when it is read."""
        return not self.is_file or Path(self.place).is_file()

    def opened(self) -> Store:
        """Return the store.

        Raises
        ------
        MavhumsError
            If the store does not exist, is damaged, or cannot be reached.
        """
        version = None
        if self.exists:  # SQLite makes a file that it is asked to open
            with self._failing(reads=True), self._engine.connect() as connection:
                if inspect(connection).has_table(SETTING.name):
                    version = connection.scalar(select(SETTING.c.value).where(SETTING.c.name == "schema"))
        if version is None:
            remedy = "keep a first one: mavhums analyse LOG --keep"
            raise MavhumsError(f"{self.place}: no store of flights", remedy)
        if version != SCHEMA:
            problem = f"{self.place}: has the schema {version}, not {SCHEMA}"
            raise MavhumsError(problem, "update mavhums, or scan the logs into a new store")
        return self

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Return a connection that sees one state of the store.

        Raises
        ------
        MavhumsError
            If it is damaged, or cannot be reached.
        """
        with self._failing(reads=True), self._engine.connect() as connection:
            yield connection

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """Return a connection whose changes are committed together at the end; a new store is created.

        Raises
        ------
        MavhumsError
            If the store cannot be written, or another command writes for too long.
        """
        with self._failing(reads=False):
            if self.is_file and not Path(self.place).exists():
                Path(self.place).absolute().parent.mkdir(0o700, parents=True, exist_ok=True)
                os.close(os.open(self.place, os.O_CREAT | os.O_WRONLY, 0o600))
            with self._engine.connect().execution_options(writes=True) as connection, connection.begin():
                if not inspect(connection).has_table(SETTING.name):
                    METADATA.create_all(connection)
                    connection.execute(SETTING.insert().values(name="schema", value=SCHEMA))
                yield connection

    @cached_property
    def _engine(self) -> Engine:
        if not self.is_file:
            try:
                address = self.address.replace("postgresql://", "postgresql+psycopg://", 1)
                engine = create_engine(address, poolclass=NullPool, connect_args={"connect_timeout": 10})
            except (ArgumentError, NoSuchModuleError, ValueError) as error:
                problem = f"{self.place}: is not an address of a database"
                raise MavhumsError(problem, "name a file, or postgresql://USER@HOST/NAME") from error
            except ModuleNotFoundError as error:
                raise MissingExtraError("a store in PostgreSQL", "fleet") from error
        else:
            engine = create_engine("sqlite://", poolclass=NullPool, creator=self._connected)
        event.listen(engine, "begin", _begin)
        return engine

    def _connected(self) -> sqlite3.Connection:
        path = Path(self.place).absolute()
        # SQLite makes files beside the one that it reads, unless it knows that nobody writes into it.
        sealed = not os.access(path.parent, os.W_OK) and not Path(f"{path}-wal").exists()
        address = path.as_uri() + "?immutable=1" * sealed
        connection = sqlite3.connect(
            address, timeout=_PATIENCE_S, isolation_level=None, check_same_thread=False, uri=True
        )
        for pragma in _PRAGMAS:
            connection.execute(f"PRAGMA {pragma}")
        return connection

    def unreadable(self, error: Exception) -> MavhumsError:
        """Return the error of a store whose content is damaged."""
        remedy = "restore it from a backup, or scan into a new store"
        return MavhumsError(f"{self.place}: the store cannot be read: {_words(error)}", remedy)

    @contextmanager
    def _failing(self, *, reads: bool) -> Iterator[None]:
        """Name the store and the remedy in what a database reports."""
        try:
            yield
        except ValidationError as error:
            raise self.unreadable(error) from error
        except (SQLAlchemyError, OSError) as error:
            said = _words(error)
            remedy = next((remedy for word, remedy in _REMEDIES.items() if word in said), None)
            if remedy is not None:
                does = "read" if reads else "written"
                raise MavhumsError(f"{self.place}: cannot be {does}: {said}", remedy) from error
            if not self.is_file:
                check = "check the address, the network and the password"
                raise MavhumsError(f"{self.place}: {said}", check) from error
            if reads or "malformed" in said or "not a database" in said:
                raise self.unreadable(error) from error
            raise MavhumsError(f"{self.place}: cannot be written: {said}", "name another file") from error


def _begin(connection: Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    if connection.dialect.name != "sqlite":
        connection.exec_driver_sql(f"SET LOCAL lock_timeout = '{_PATIENCE_S:.0f}s'")
        if writes:
            connection.exec_driver_sql("SELECT pg_advisory_xact_lock(7731)")
        else:
            connection.exec_driver_sql("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ")
    elif writes:
        # Readers go on meanwhile; the mode is kept in the file, and cannot be changed in a transaction, nor
        # while another writes a new file: this one then waits its turn, and the next sets the mode.
        with suppress(OperationalError):
            connection.exec_driver_sql("PRAGMA journal_mode = WAL")
        connection.exec_driver_sql("BEGIN IMMEDIATE")
    else:
        connection.exec_driver_sql("BEGIN")


def _words(error: Exception) -> str:
    """Return an error's message in one line."""
    cause = error.orig if isinstance(error, DBAPIError) and error.orig else error
    if isinstance(cause, OSError):
        return (cause.strerror or str(cause)).lower()
    return ": ".join(line.strip() for line in str(cause).splitlines() if line.strip())[:300]
