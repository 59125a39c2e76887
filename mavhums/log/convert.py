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

__all__ = ["to_arrow", "to_csv", "to_frame", "to_parquet"]


def to_frame(table: Table) -> pd.DataFrame:
    """Return a DataFrame indexed by time of reception (UTC)."""
    import pandas as pd

    columns: dict[str, Any] = {
        "system": table.system,
        "component": table.component,
        "sequence": table.sequence,
    }
    for name, values in _flat(table):
        columns[name] = _as_text(values) if values.dtype.kind == "S" else np.ascontiguousarray(values)
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


def _as_text(values: NDArray[Any]) -> Any:
    """Return chars as pandas' text, each distinct value decoded once."""
    import pandas as pd

    codes, distinct = pd.factorize(np.array(values.tolist(), dtype=object))
    return pd.array([text_of(value) for value in distinct], dtype="str").take(codes)


def text_of(value: bytes) -> str:
    """Return a char field as text, cut at the first NUL."""
    return value.split(b"\0")[0].decode("utf-8", "replace")


def _pyarrow() -> Any:
    try:
        import pyarrow as pa
    except ModuleNotFoundError as error:
        raise MissingExtraError("Arrow tables", "arrow") from error
    return pa
