"""Incremental writers of tables, as CSV or Parquet."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import pandas as pd

from mavhums.core.errors import MavhumsError, MissingExtraError
from mavhums.core.text import no_formula

__all__ = ["TableWriter", "writer_for"]

_ROW_GROUP = 1 << 16
_TIME = "%Y-%m-%dT%H:%M:%S.%fZ"


class TableWriter(ABC):
    """A context manager that writes frames with the same columns to one file.

    Parameters
    ----------
    path
        Path of the file.

    Attributes
    ----------
    rows
        Number of rows written.
    """

    def __init__(self, path: Path) -> None:
        self.rows = 0
        self._path = path
        self._pending: list[pd.DataFrame] = []
        self._pending_rows = 0

    def __enter__(self) -> TableWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self._pending:
            self._flush()
        self._close()

    def write(self, frame: pd.DataFrame) -> None:
        """Append rows."""
        self.rows += len(frame)
        self._pending.append(frame)
        self._pending_rows += len(frame)
        if self._pending_rows >= _ROW_GROUP:
            self._flush()

    def _flush(self) -> None:
        frame = pd.concat(self._pending, ignore_index=True)
        self._pending.clear()
        self._pending_rows = 0
        self._append(frame)

    @abstractmethod
    def _append(self, frame: pd.DataFrame) -> None: ...

    @abstractmethod
    def _close(self) -> None: ...


class _CsvWriter(TableWriter):
    _is_new = True

    def _append(self, frame: pd.DataFrame) -> None:
        with self._path.open("w" if self._is_new else "a", encoding="utf-8", newline="") as file:
            _harmless(frame).to_csv(file, header=self._is_new, index=False, date_format=_TIME)
        self._is_new = False

    def _close(self) -> None:
        pass


def _harmless(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the table without texts that a spreadsheet would evaluate."""
    texts = [name for name in frame.columns if _is_text(frame[name])]
    return frame.assign(**{name: frame[name].map(_cell) for name in texts}) if texts else frame


def _is_text(column: pd.Series[Any]) -> bool:
    return bool(pd.api.types.is_object_dtype(column) or pd.api.types.is_string_dtype(column))


def _cell(value: object) -> object:
    return no_formula(value) if isinstance(value, str) else value


class _ParquetWriter(TableWriter):
    _file: Any = None

    def _append(self, frame: pd.DataFrame) -> None:
        import pyarrow as pa
        from pyarrow import parquet

        table = pa.Table.from_pandas(frame, preserve_index=False)
        if self._file is None:
            self._file = parquet.ParquetWriter(self._path, table.schema)
        self._file.write_table(table)

    def _close(self) -> None:
        if self._file is not None:
            self._file.close()


def writer_for(output: Path) -> Callable[[Path], TableWriter]:
    """Return the writer class for the file extension of ``output``.

    Raises
    ------
    MavhumsError
        If the extension is not supported.
    MissingExtraError
        If the format is Parquet and pyarrow is not installed.
    """
    match output.suffix.lower():
        case ".csv":
            return _CsvWriter
        case ".parquet":
            try:
                import_module("pyarrow.parquet")
            except ImportError as error:
                raise MissingExtraError("writing Parquet", "arrow") from error
            return _ParquetWriter
        case _:
            raise MavhumsError(
                f"{output}: not a supported table format", "use the extension .parquet or .csv"
            )
