"""Columns of messages of one type."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mavhums.log import convert
from mavhums.log.convert import text_of

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

__all__ = ["Table"]

_PARTS = ("frame", "time_us", "system", "component", "sequence", "flags", "fields")


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Messages of one type in the order of the log; every array has n rows.

    Attributes
    ----------
    name
        Message name, as in the MAVLink definition.
    frame
        Position of each message among all intact frames of the log.
    time_us
        Time of reception, microseconds of UTC since 1970.
    system, component, sequence
        From the frame's header.
    flags
        How the frame was received: bits of `mavhums.log.flags`.
    fields
        Record array as in the log: ``fields["voltage"]`` is a column, of shape (n,) or (n, k).
    divisors
        Divisor of a field's raw number, if the format's type defines one; ``table["Lat"]`` and
        every conversion apply it.
    """

    name: str
    frame: NDArray[np.int64]
    time_us: NDArray[np.int64]
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    sequence: NDArray[np.uint8]
    flags: NDArray[np.uint8]
    fields: NDArray[np.void]
    divisors: Mapping[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, field: str) -> NDArray[Any]:
        values = self.fields[field]
        divisor = self.divisors.get(field)
        return values if divisor is None else values / divisor

    def holds(self, widths: Mapping[str, int]) -> bool:
        """Return whether the numeric fields exist with these numbers of elements, 1 for a scalar.

        The definitions in a self-describing log may be arbitrary.
        """
        wire = self.fields.dtype
        for name, width in widths.items():
            if name not in (wire.names or ()):
                return False
            form, shape = wire[name].base, wire[name].shape
            if form.kind not in "iuf" or (shape or (1,)) != (width,):
                return False
        return True

    def holds_text(self, name: str) -> bool:
        """Return whether there is a field of characters with this name."""
        wire = self.fields.dtype
        return name in (wire.names or ()) and wire[name].kind == "S"

    def select(self, rows: NDArray[Any]) -> Table:
        """Return the rows that a mask or an index array selects."""
        if rows.dtype == np.bool_ and rows.all():
            return self
        parts: dict[str, Any] = {part: getattr(self, part)[rows] for part in _PARTS}
        return replace(self, **parts)

    @classmethod
    def concatenate(cls, tables: list[Table]) -> Table:
        """Join tables of one message type, in order."""
        if len(tables) == 1:
            return tables[0]
        parts = {part: [getattr(table, part) for table in tables] for part in _PARTS}
        wire = tables[0].fields.dtype
        parts["fields"] = [np.ascontiguousarray(rows).view(np.uint8) for rows in parts["fields"]]
        joined: dict[str, Any] = {part: np.concatenate(rows) for part, rows in parts.items()}
        return replace(tables[0], **joined | {"fields": joined["fields"].view(wire)})

    def texts(self, field: str) -> list[str]:
        """Return a char field as text, cut at the first NUL."""
        return [text_of(value) for value in self.fields[field].tolist()]

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame indexed by time of reception (UTC).

        An array field of k elements becomes k columns, ``data[0]`` … ``data[k-1]``.
        """
        return convert.to_frame(self)

    def to_arrow(self) -> pa.Table:
        """Return an Arrow table, array fields as fixed-size lists.

        Raises
        ------
        MissingExtraError
            If pyarrow is not installed.
        """
        return convert.to_arrow(self)

    def to_parquet(self, path: str | os.PathLike[str]) -> None:
        """Write a Parquet file of the Arrow table.

        Raises
        ------
        MissingExtraError
            If pyarrow is not installed.
        """
        convert.to_parquet(self, path)

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write a CSV file of the DataFrame."""
        convert.to_csv(self, path)
