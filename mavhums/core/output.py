"""Output: files that are written whole, tables row by row, and text that nothing interprets.

pandas is imported with the first table: most programs write none.
"""

from __future__ import annotations

import atexit
import os
import shutil
import stat
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any

from mavhums.core.errors import MavhumsError, MissingExtraError

if TYPE_CHECKING:
    import pandas as pd


_unfinished: set[Path] = set()


@atexit.register
def remove_unfinished() -> None:
    """Remove the temporary files of a program that ends, wherever a signal interrupted it."""
    for path in list(_unfinished):
        path.unlink(missing_ok=True)


class WholeFile:
    """A temporary file that replaces its target when it is complete.

    What is written may hold positions, so a new file is readable by its owner only. A regular file is
    replaced by rename and keeps its permissions. A symbolic link is kept, and its target
    is replaced. A device, a FIFO or a socket is never replaced: the complete content is copied into it.

    Parameters
    ----------
    path
        Path of the target.

    Attributes
    ----------
    temporary
        Path for writing; an empty file, or in a folder of its own.

    Raises
    ------
    OSError
        If ``path`` is a folder, or no file can be created there.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        self._mode = _mode(self._path)
        self._through = self._mode is not None and not stat.S_ISREG(self._mode)
        if self._through:
            self.temporary = Path(tempfile.mkdtemp(prefix="mavhums-")) / self._path.name
        else:
            self._path = Path(os.path.realpath(self._path))
            self.temporary = self._path.with_name(f".{self._path.name[:200]}.{token_hex(4)}.part")
        _unfinished.add(self.temporary)  # before it exists: a signal may interrupt what follows
        if not self._through:
            self.temporary.touch(0o600, exist_ok=False)

    def publish(self) -> None:
        """Move the complete file to its target.

        Raises
        ------
        OSError
            If that fails; a regular target file is then unchanged.
        """
        if self._through:
            with self.temporary.open("rb") as source, self._path.open("wb") as target:
                shutil.copyfileobj(source, target)
            return
        if self._mode is not None:
            self.temporary.chmod(stat.S_IMODE(self._mode))
        self.temporary.replace(self._path)

    def discard(self) -> None:
        """Remove the temporary file; no effect after :meth:`publish`."""
        self.temporary.unlink(missing_ok=True)
        _unfinished.discard(self.temporary)
        if self._through:
            shutil.rmtree(self.temporary.parent, ignore_errors=True)


@contextmanager
def written_whole(
    path: str | os.PathLike[str],
    *,
    error: type[MavhumsError] = MavhumsError,
    remedy: str = "choose another place",
) -> Iterator[Path]:
    """Yield the path of a temporary file, and move it to ``path`` on success (:class:`WholeFile`).

    Parameters
    ----------
    path
        Path of the target.
    error, remedy
        Type and remedy of the error if it cannot be written.

    Raises
    ------
    MavhumsError
        If the file cannot be written.
    """
    try:
        file = WholeFile(path)
        try:
            yield file.temporary
            file.publish()
        finally:
            file.discard()
    except OSError as problem:
        raise error(f"cannot write {path}: {problem.strerror or problem}", remedy) from problem


def _mode(path: Path) -> int | None:
    """Return type and permissions of the file at a path; None if there is none."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(21, "is a folder")
    return mode


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
        import pandas as pd

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
    return frame.assign(**{name: frame[name].map(_cell) for name in texts})


def _is_text(column: pd.Series[Any]) -> bool:
    import pandas as pd

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


def as_utf8(path: str | os.PathLike[str]) -> str:
    r"""Return a path as a text that JSON, a database and a viewer can hold: other bytes become ``\\xNN``.

    Examples
    --------
    >>> as_utf8("flight\udcfc.tlog")
    'flight\\xfc.tlog'
    """
    return os.fspath(path).encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


_FORMULA = ("=", "+", "-", "@", "\t", "\r", "＝", "＋", "－", "＠")


def printable(text: str) -> str:
    r"""Return an external text without control sequences for a terminal or a viewer.

    Examples
    --------
    >>> printable("S1\x1b[31m")
    'S1�[31m'
    """
    return "".join(letter if letter.isprintable() else "�" for letter in text)


def no_formula(text: str) -> str:
    """Return a text that a spreadsheet displays and does not evaluate: a formula gets an apostrophe.

    Examples
    --------
    >>> no_formula("=HYPERLINK(1)"), no_formula("elevator")
    ("'=HYPERLINK(1)", 'elevator')
    """
    return f"'{text}" if text.startswith(_FORMULA) else text
