"""The same log by pymavlink's DFReader, the oracle of values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.DFReader import DFReader_binary

from mavhums.log import Table


def by_dfreader(path: Path) -> dict[str, tuple[list[str], list[list[Any]]]]:
    """Return field names and rows by message."""
    found: dict[str, tuple[list[str], list[list[Any]]]] = {}
    reader = DFReader_binary(str(path))
    while (message := reader.recv_msg()) is not None:
        fields = list(message.fmt.columns)
        rows = found.setdefault(message.get_type(), (fields, []))[1]
        rows.append([getattr(message, field) for field in fields])
    reader.filehandle.close()
    return found


def differing_columns(
    tables: dict[str, Table], theirs: dict[str, tuple[list[str], list[list[Any]]]]
) -> list[str]:
    """Return the columns in which a value differs, and the messages whose number does."""
    out = sorted(set(tables) ^ set(theirs))
    for name in set(tables) & set(theirs):
        table, (fields, rows) = tables[name], theirs[name]
        if len(table) != len(rows) or list(table.fields.dtype.names or ()) != fields:
            out.append(name)
            continue
        out += [f"{name}.{f}" for k, f in enumerate(fields) if not _same(table[f], [row[k] for row in rows])]
    return out


def _same(ours: np.ndarray[Any, Any], theirs: list[Any]) -> bool:
    if ours.dtype.kind == "S":
        return all(a == _chars(b) for a, b in zip(ours.tolist(), theirs, strict=True))
    values = np.array([list(value) if ours.ndim == 2 else value for value in theirs], dtype=np.float64)
    return np.array_equal(ours.astype(np.float64), values, equal_nan=True)


def _chars(value: Any) -> bytes:
    """Return chars up to the first NUL of text; of FILE's data only the zeros at its end are gone."""
    raw = value.encode("utf-8", "surrogateescape") if isinstance(value, str) else bytes(value)
    return raw.rstrip(b"\0")
