"""Tables of messages as pandas, Arrow, Parquet and CSV."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mavhums.core.errors import MissingExtraError

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

    from mavhums.log.tables import Table

__all__ = ["as_text", "text_of", "to_arrow", "to_csv", "to_frame", "to_parquet"]

_MANY_TEXTS = 4096
"""Rows from which on texts are compared as integers; below, the dictionary is faster (0.1 ms a column)."""


def to_frame(table: Table) -> pd.DataFrame:
    """Return a DataFrame indexed by time of reception (UTC); array fields are one column an element."""
    import pandas as pd

    columns: dict[str, Any] = {
        "system": table.system,
        "component": table.component,
        "sequence": table.sequence,
    }
    for name, values in _flat(table):
        columns[name] = as_text(values) if values.dtype.kind == "S" else np.ascontiguousarray(values)
    index = pd.DatetimeIndex(table.time_us.view("M8[us]"), name="time").tz_localize("UTC")
    return pd.DataFrame(columns, index=index, copy=False)


def to_arrow(table: Table) -> pa.Table:
    """Return an Arrow table; ``time`` is its first column, array fields are fixed-size lists.

    Raises
    ------
    MissingExtraError
        If pyarrow is not installed.
    """
    pa = _pyarrow()
    columns = {
        "time": pa.array(table.time_us, pa.int64()).cast(pa.timestamp("us", tz="UTC")),
        "system": pa.array(table.system),
        "component": pa.array(table.component),
        "sequence": pa.array(table.sequence),
    }
    for name in table.fields.dtype.names or ():
        values = table[name]
        if values.dtype.kind == "S":
            columns[name] = pa.array(table.texts(name), pa.string())
        elif values.ndim == 1:
            columns[name] = pa.array(np.ascontiguousarray(values))
        else:
            flat = pa.array(np.ascontiguousarray(values).reshape(-1))
            columns[name] = pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
    return pa.table(columns)


def to_parquet(table: Table, path: str | os.PathLike[str]) -> None:
    """Write a Parquet file.

    Raises
    ------
    MissingExtraError
        If pyarrow is not installed.
    """
    _pyarrow()
    import pyarrow.parquet as pq

    pq.write_table(to_arrow(table), os.fspath(path))


def to_csv(table: Table, path: str | os.PathLike[str]) -> None:
    """Write a CSV file with the columns of the DataFrame, its index first."""
    to_frame(table).to_csv(path)


def _flat(table: Table) -> list[tuple[str, NDArray[Any]]]:
    """Return columns by name; an array field of k elements becomes ``name[0]`` … ``name[k-1]``."""
    out: list[tuple[str, NDArray[Any]]] = []
    for name in table.fields.dtype.names or ():
        values = table[name]
        if values.ndim == 1:
            out.append((name, values))
        else:
            out += [(f"{name}[{k}]", values[:, k]) for k in range(values.shape[1])]
    return out


def as_text(values: NDArray[Any]) -> Any:
    """Return chars as pandas' text, each distinct value decoded once."""
    import pandas as pd

    if len(values) < _MANY_TEXTS:
        numbers: dict[bytes, int] = {}
        numbered = [numbers.setdefault(value, len(numbers)) for value in values.tolist()]
        codes = np.array(numbered, dtype=np.int64)
        distinct = list(numbers)
    else:
        codes, first = _distinct_texts(values)
        distinct = values[first].tolist()
    return pd.array([text_of(value) for value in distinct], dtype="str").take(codes)


def _distinct_texts(values: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the number of each row's text, and the first row of each text.

    Eight characters are compared at a time, as one integer; an object per row takes three times as long.
    """
    import pandas as pd

    rows = len(values)
    chars = np.zeros((rows, -(-values.itemsize // 8) * 8), dtype=np.uint8)
    chars[:, : values.itemsize] = np.ascontiguousarray(values).view(np.uint8).reshape(rows, -1)
    codes = np.zeros(rows, dtype=np.int64)
    for word in chars.view(np.uint64).T:
        of_word, words = pd.factorize(word)
        if len(words) > 1:
            codes = pd.factorize(codes * len(words) + of_word)[0]
    first = np.empty(int(codes.max()) + 1, dtype=np.int64)
    first[codes[::-1]] = np.arange(rows)[::-1]
    return codes, first


def text_of(value: bytes) -> str:
    """Return a char field as text, cut at the first NUL."""
    return value.split(b"\0")[0].decode("utf-8", "replace")


def _pyarrow() -> Any:
    try:
        import pyarrow as pa
    except ModuleNotFoundError as error:
        raise MissingExtraError("Arrow tables", "arrow") from error
    return pa
