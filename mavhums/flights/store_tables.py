"""The tables of a store: their columns, where they lie, and how they are read and written.

A column is only ever added. A table that an older version wrote lacks the newest columns, which read as
NULL; the first write adds them.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import unquote

from mavhums.core.errors import MavhumsError

if TYPE_CHECKING:
    import pyarrow as pa
    from deltalake import DeltaTable, WriterProperties
    from duckdb import DuckDBPyConnection

LOGS: Final = "logs"
VERDICTS: Final = "verdicts"
COPIES: Final = "copies"
DATES: Final = "dates"
INSTALLED: Final = "installed"
SETTLED: Final = "settled"
NAMING: Final = "naming"
STANDINGS: Final = "standings"
CORRECTIONS: Final = "corrections"
REMOVED: Final = "removed"
_ROW_GROUP: Final = 2_000
_TYPES: Final = {
    "string": "VARCHAR",
    "int64": "BIGINT",
    "double": "DOUBLE",
    "bool": "BOOLEAN",
    "binary": "BLOB",
}
"""DuckDB's names of the types of columns."""
_ENCODED: Final = re.compile("%[0-9A-Fa-f]{2}")
_PATIENCE: Final = {"max_retries": "4", "retry_timeout": "30s", "connect_timeout": "5s"}


class Tables:
    """The Delta tables under a folder, or under an address such as ``s3://bucket/fleet``.

    An object store's credentials and region come from the environment, as for its own tools.

    Parameters
    ----------
    place
        The folder or the address.
    """

    def __init__(self, place: str) -> None:
        self.place = place.rstrip("/") if "://" in place else place
        self.is_remote = "://" in place
        self._options = _PATIENCE if self.is_remote else None
        # delta-rs decodes such a path when it reads, twice, and not when it makes folders: no quoting helps.
        encoded = None if self.is_remote else _ENCODED.search(os.path.abspath(place))  # noqa: PTH100
        if encoded:
            problem = f"{place}: a store's path must not have {encoded[0]!r} in it, which stands for"
            raise MavhumsError(
                f"{problem} {unquote(encoded[0])!r} in an address", "choose another folder, or rename it"
            )

    def has(self, table: str) -> bool:
        """Return whether a table exists."""
        from deltalake import DeltaTable

        return DeltaTable.is_deltatable(self._uri(table), storage_options=self._options)

    def opened(self, table: str) -> DeltaTable:
        """Return a table as of now."""
        from deltalake import DeltaTable

        return DeltaTable(self._uri(table), storage_options=self._options)

    def show(self, base: DuckDBPyConnection, table: str) -> None:
        """Make a table visible to DuckDB, with all columns of this version."""
        from duckdb import BinderException

        schema = schemas()[table]
        content = self.opened(table) if self.has(table) else None
        # Paths of this machine come as in an address: "a%20store".
        files = [unquote(uri) for uri in content.file_uris()] if content else []
        if content is None or not files:
            base.execute(_without_rows(table, schema))
            return
        source = f"read_parquet({_quoted(files)}, union_by_name = true)"
        if self.is_remote:
            base.execute("SET disabled_optimizers = 'top_n'")  # its filters of Arrow data stop DuckDB 1.3
            base.register(source := f"{table}_stored", content.to_pyarrow_dataset())
        columns = ", ".join(schema.names)
        try:
            base.execute(f"CREATE VIEW {table} AS SELECT {columns} FROM {source}")
        except BinderException:  # a column that no file has yet
            base.execute(_without_rows(f"no_{table}", schema))
            filled = f"SELECT * FROM {source} UNION ALL BY NAME SELECT * FROM no_{table}"
            base.execute(f"CREATE VIEW {table} AS SELECT {columns} FROM ({filled})")

    def write(self, table: str, rows: Sequence[dict[str, object]], **how: Any) -> None:
        """Write rows in one transaction; an object store refuses it if another has changed the same rows."""
        import pyarrow as pa
        from deltalake import write_deltalake

        write_deltalake(
            self._uri(table),
            pa.Table.from_pylist(list(rows), schema=schemas()[table]),
            writer_properties=_written(),
            schema_mode="merge",
            storage_options=self._options,
            **how,
        )

    def rename(self, table: str, names: Mapping[str, str]) -> None:
        """Give the rows of some logs, by their hashes, to other aircraft, in one transaction."""
        import pyarrow as pa

        source = pa.table({"sha256": [*names], "aircraft": [*names.values()]})
        self.opened(table).merge(
            source, "old.sha256 = new.sha256", source_alias="new", target_alias="old"
        ).when_matched_update({"aircraft": "new.aircraft"}).execute()

    def delete(self, table: str, predicate: str) -> None:
        """Delete rows in one transaction."""
        self.opened(table).delete(predicate)

    def files(self, table: str) -> int:
        """Return the number of files of a table."""
        return len(self.opened(table).file_uris())

    def compact(self, table: str) -> None:
        """Join small files, and remove files that no version of the last week needs."""
        content = self.opened(table)
        content.optimize.compact(writer_properties=_written())
        content.vacuum(dry_run=False)

    def _uri(self, table: str) -> str:
        return f"{self.place}/{table}" if self.is_remote else os.path.join(self.place, table)  # noqa: PTH118


def schemas() -> dict[str, pa.Schema]:
    """Return the columns of the tables."""
    import pyarrow as pa

    text, whole, number = pa.string(), pa.int64(), pa.float64()
    log = [("path", text), ("size", whole), ("time_ns", whole), ("settings", text), ("sha256", text)]
    log += [("aircraft", text), ("board", text), ("start_us", whole), ("duration_s", number)]
    log += [("losses", pa.bool_())]
    log += [("flight", pa.binary()), ("problem", text), ("remedy", text)]
    log += [("scanned", whole), ("format", whole)]
    verdict = [("aircraft", text), ("path", text), ("sha256", text), ("start_us", whole), ("vehicle", whole)]
    verdict += [("actuator", text), ("condition", text), ("worst", text), ("urgency", number)]
    verdict += [("friction_nm", number), ("airframe", text), ("verdict", text)]
    copy = [("aircraft", text), ("path", text), ("sha256", text), ("vehicle", whole), ("counted", text)]
    date = [("aircraft", text), ("actuator", text), ("since_us", whole)]
    installed = [("aircraft", text), ("entry", text)]
    settled = [
        ("aircraft", text),
        ("scanned", whole),
        ("digest", text),
        ("known", pa.binary()),
        ("stored", whole),
    ]
    columns = {LOGS: log, VERDICTS: verdict, COPIES: copy, DATES: date, INSTALLED: installed}
    columns[SETTLED] = settled
    columns[NAMING] = [("rule", text), ("boards", text), ("stored", whole)]
    columns[STANDINGS] = [("aircraft", text), ("standings", text), ("stored", whole)]
    columns[CORRECTIONS] = [("kind", text), ("log", text), ("sha256", text), ("before", text)]
    columns[CORRECTIONS] += [("after", text), ("who", text), ("note", text), ("at_ns", whole)]
    columns[REMOVED] = log
    return {table: pa.schema(of) for table, of in columns.items()}


def _written() -> WriterProperties:
    """Return how tables are written: in small groups of rows, of which a query skips most."""
    from deltalake import WriterProperties

    return WriterProperties(compression="ZSTD", max_row_group_size=_ROW_GROUP)


def _without_rows(name: str, schema: pa.Schema) -> str:
    """Return the SQL of an empty table, which DuckDB 1.3 filters as it does not filter an Arrow table."""
    return f"CREATE TABLE {name} ({', '.join(f'{field.name} {_TYPES[str(field.type)]}' for field in schema)})"


def _quoted(files: Sequence[str]) -> str:
    paths = ", ".join("'" + file.removeprefix("file://").replace("'", "''") + "'" for file in files)
    return f"[{paths}]"
