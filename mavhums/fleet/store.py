"""The store: a folder with Delta tables, for logs judged alone and for verdicts compared with the past.

A third table names the logs that do not count, because another log of the same flight is better. Only the
scanning process writes, under a lock; each commit is written whole or not at all.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.fleet.rows import LogFile, Row

if TYPE_CHECKING:
    import pyarrow as pa
    from deltalake import WriterProperties

__all__ = ["COPIES", "INSTALLED", "LOGS", "VERDICTS", "Store", "schemas"]

LOGS: Final = "logs"
VERDICTS: Final = "verdicts"
COPIES: Final = "copies"
INSTALLED: Final = "installed"
_COMPACT_FILES: Final = 64
_ROW_GROUP: Final = 2_000


class Store:
    """A fleet's store.

    Parameters
    ----------
    folder
        The folder; the first commit creates it.

    Raises
    ------
    MissingExtraError
        If the packages of the extra ``fleet`` are not installed.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        try:
            import deltalake  # noqa: F401
            import duckdb  # noqa: F401
        except ImportError as error:
            raise MissingExtraError("a fleet's store", "fleet") from error
        self.folder = Path(folder)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the store against other scans.

        Raises
        ------
        MavhumsError
            If another scan writes into the store, or it cannot be written.
        """
        import locket

        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            lock = locket.lock_file(str(self.folder / ".scan.lock"), timeout=0)
            lock.acquire()
        except locket.LockError as error:
            problem = f"{self.folder}: another scan writes into this store"
            raise MavhumsError(problem, "wait until it has ended") from error
        except OSError as error:
            problem = f"{self.folder}: {(error.strerror or str(error)).lower()}"
            raise MavhumsError(problem, "name another folder with --to") from error
        try:
            yield
        finally:
            lock.release()

    def has(self, table: str) -> bool:
        """Return whether a table exists."""
        return (self.folder / table / "_delta_log").is_dir()

    def query(self, sql: str, *values: object) -> Any:
        """Return DuckDB's result; ``logs``, ``verdicts``, ``copies`` and ``installed`` name the tables.

        Raises
        ------
        MavhumsError
            If the store does not exist, or is damaged.
        """
        import duckdb
        from deltalake import DeltaTable
        from deltalake.exceptions import DeltaError

        base = duckdb.connect()
        try:
            for table in schemas():
                if not self.has(table):
                    base.register(table, schemas()[table].empty_table())
                    continue
                files = DeltaTable(self.folder / table).file_uris()
                if files:
                    base.execute(f"CREATE VIEW {table} AS SELECT * FROM read_parquet({_quoted(files)})")
                else:
                    base.register(table, schemas()[table].empty_table())
            return base.execute(sql, list(values))
        except (DeltaError, duckdb.Error, OSError) as error:
            problem = f"{self.folder}: the store cannot be read: {str(error).splitlines()[0][:200]}"
            raise MavhumsError(problem, "restore it from a backup, or scan into a new folder") from error

    def opened(self) -> Store:
        """Return the store.

        Raises
        ------
        MavhumsError
            If the store does not exist.
        """
        if not self.has(LOGS):
            remedy = "fill it: mavhums fleet scan LOGS --to STORE"
            raise MavhumsError(f"{self.folder}: no store of a fleet", remedy)
        return self

    def add_logs(self, rows: Sequence[Row]) -> None:
        """Commit logs, in one transaction."""
        now = time.time_ns()
        self._write(LOGS, [row._asdict() | {"scanned": now + k} for k, row in enumerate(rows)], mode="append")

    def replace_verdicts(self, aircraft: str, rows: Sequence[dict[str, object]]) -> None:
        """Replace the verdicts of an aircraft, in one transaction."""
        self._replace(VERDICTS, aircraft, rows)

    def replace_copies(self, aircraft: str, rows: Sequence[dict[str, object]]) -> None:
        """Replace the names of an aircraft's logs that do not count, in one transaction."""
        if rows or self.has(COPIES):
            self._replace(COPIES, aircraft, rows)

    def replace_installed(self, aircraft: str, rows: Sequence[dict[str, object]]) -> None:
        """Replace the actuators of an aircraft, in one transaction."""
        self._replace(INSTALLED, aircraft, rows)

    def rename(self, names: Mapping[str, str]) -> None:
        """Give the logs with these hashes to other aircraft, in one transaction."""
        import pyarrow as pa
        from deltalake import DeltaTable
        from deltalake.exceptions import DeltaError

        if not names:
            return
        source = pa.table({"sha256": [*names], "aircraft": [*names.values()]})
        try:
            DeltaTable(self.folder / LOGS).merge(
                source, "logs.sha256 = new.sha256", source_alias="new", target_alias="logs"
            ).when_matched_update({"aircraft": "new.aircraft"}).execute()
        except (DeltaError, OSError) as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: Exception) -> MavhumsError:
        problem = f"{self.folder}: cannot be written: {str(error).splitlines()[0][:200]}"
        return MavhumsError(problem, "make room or mend it, and scan again: it resumes")

    def _replace(self, table: str, aircraft: str, rows: Sequence[dict[str, object]]) -> None:
        if self.has(table):
            predicate = f"aircraft = '{aircraft.replace(chr(39), chr(39) * 2)}'"
            self._write(table, rows, mode="overwrite", predicate=predicate)
        else:
            self._write(table, rows, mode="append")

    def known(self) -> dict[LogFile, str]:
        """Return the scanned logs, each with the settings of its latest judgement."""
        rows = self.query("SELECT path, size, time_ns, settings FROM logs ORDER BY scanned").fetchall()
        return {LogFile(*file): settings for *file, settings in rows}

    def waiting(self) -> set[str]:
        """Return the aircraft that have logs without a verdict, as after an interruption."""
        rows = self.query(
            "SELECT DISTINCT aircraft FROM logs WHERE flight IS NOT NULL AND sha256 NOT IN"
            " (SELECT sha256 FROM verdicts UNION ALL SELECT sha256 FROM copies)"
        ).fetchall()
        return {aircraft for (aircraft,) in rows}

    def compact(self) -> None:
        """Compact small files, and remove files that no version of the last week needs."""
        from deltalake import DeltaTable

        for name in schemas():
            if self.has(name):
                table = DeltaTable(self.folder / name)
                if len(table.file_uris()) > _COMPACT_FILES:
                    table.optimize.compact(writer_properties=_written())
                    table.vacuum(dry_run=False)

    def _write(self, table: str, rows: Sequence[dict[str, object]], **how: Any) -> None:
        import pyarrow as pa
        from deltalake import write_deltalake
        from deltalake.exceptions import DeltaError

        content = pa.Table.from_pylist(list(rows), schema=schemas()[table])
        try:
            write_deltalake(self.folder / table, content, writer_properties=_written(), **how)
        except (DeltaError, OSError) as error:
            raise self._unwritable(error) from error


def schemas() -> dict[str, pa.Schema]:
    """Return the columns of the tables."""
    import pyarrow as pa

    text, whole, number = pa.string(), pa.int64(), pa.float64()
    log = [("path", text), ("size", whole), ("time_ns", whole), ("settings", text), ("sha256", text)]
    log += [
        ("aircraft", text),
        ("board", text),
        ("start_us", whole),
        ("duration_s", number),
        ("losses", pa.bool_()),
    ]
    log += [("flight", pa.binary()), ("problem", text), ("remedy", text)]
    log += [("scanned", whole)]
    verdict = [("aircraft", text), ("path", text), ("sha256", text), ("start_us", whole), ("vehicle", whole)]
    verdict += [("actuator", text), ("condition", text), ("worst", text), ("urgency", number)]
    verdict += [("friction_nm", number), ("airframe", text), ("verdict", text)]
    copy = [("aircraft", text), ("path", text), ("sha256", text), ("vehicle", whole), ("counted", text)]
    return {LOGS: pa.schema(log), VERDICTS: pa.schema(verdict), COPIES: pa.schema(copy)} | {
        INSTALLED: pa.schema([("aircraft", text), ("entry", text)])
    }


def _written() -> WriterProperties:
    """Return how tables are written: in small groups of rows, of which a query skips most."""
    from deltalake import WriterProperties

    return WriterProperties(compression="ZSTD", max_row_group_size=_ROW_GROUP)


def _quoted(files: Sequence[str]) -> str:
    paths = ", ".join("'" + file.removeprefix("file://").replace("'", "''") + "'" for file in files)
    return f"[{paths}]"
