"""What pyulog makes of a ULog, and whether ours is the same."""

from __future__ import annotations

import contextlib
import io
from typing import Any

import numpy as np
import pyulog
from numpy.typing import NDArray

from mavhums.log import Table

Columns = dict[tuple[str, int], dict[str, NDArray[Any]]]


def pyulog_reads(log: bytes) -> pyulog.ULog:
    with contextlib.redirect_stdout(io.StringIO()):
        return pyulog.ULog(io.BytesIO(log))


def columns_of_peer(log: bytes) -> Columns:
    """Columns by (topic, multi id) and flat name, without padding."""
    return {
        (topic.name, topic.multi_id): {
            name: values for name, values in topic.data.items() if not is_padding(name)
        }
        for topic in pyulog_reads(log).data_list
    }


def columns_of_ours(tables: dict[str, Table], *, both: bool = True) -> Columns:
    """The same, of our tables; a char is a column as pyulog has it, a number of one byte."""
    out: Columns = {}
    for name, table in tables.items():
        if name in ("parameter", "logged_string", "info", "dropout"):
            continue
        for instance in np.unique(table.component).tolist():
            rows = table.fields[table.component == instance]
            out[name, instance] = flat(rows, both=both)
    return out


def flat(rows: NDArray[np.void], *, both: bool = True) -> dict[str, NDArray[Any]]:
    """Lay arrays out flat; with ``both``, a char goes by the name of a char and of an array of one."""
    columns: dict[str, NDArray[Any]] = {}
    for field in rows.dtype.names or ():
        values = np.ascontiguousarray(rows[field])
        if values.dtype.kind == "S":
            size = values.dtype.itemsize
            values = np.frombuffer(values.tobytes(), dtype=np.int8).reshape(-1, size)
            if size > 1 or both:
                columns |= {f"{field}[{k}]": values[:, k] for k in range(size)}
            if size == 1 or both:
                columns[field] = values[:, 0]
        elif values.ndim == 2:
            columns |= {f"{field}[{k}]": values[:, k] for k in range(values.shape[1])}
        else:
            columns[field] = values
    return columns


def is_padding(name: str) -> bool:
    return name.rpartition(".")[2].startswith("_padding")


def differences(ours: Columns, theirs: Columns) -> list[str]:
    """Name every column that is not there, or not the same bit for bit."""
    wrong = [f"{topic}: not there" for topic in theirs if topic not in ours]
    wrong += [f"{topic}: only ours" for topic in ours if topic not in theirs]
    for topic, columns in theirs.items():
        for name, values in columns.items() if topic in ours else ():
            mine = ours[topic].get(name)
            if mine is None or mine.tobytes() != np.ascontiguousarray(values).tobytes():
                wrong.append(f"{topic} {name}")
    return wrong
