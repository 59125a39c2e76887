"""Columns of messages of one type."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["MAVLINK1", "ODD_TIME", "PADDED", "SIGNED", "Table"]

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
        How the frame came: ``MAVLINK1``, ``SIGNED`` (not verified), ``PADDED`` (accepted with
        zeros put back that the sender trimmed after it had computed the CRC), ``ODD_TIME`` (its
        time stamp was damaged; ``time_us`` is that of its neighbour).
    fields
        Record array: ``fields["voltage"]`` is a column, of shape (n,) or (n, k).
    """

    name: str
    frame: NDArray[np.int64]
    time_us: NDArray[np.int64]
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    sequence: NDArray[np.uint8]
    flags: NDArray[np.uint8]
    fields: NDArray[np.void]

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, field: str) -> NDArray[Any]:
        return self.fields[field]

    def select(self, rows: NDArray[Any]) -> Table:
        """Return the rows that a mask or an index array names."""
        return Table(self.name, **{part: getattr(self, part)[rows] for part in _PARTS})

    @classmethod
    def concatenate(cls, tables: list[Table]) -> Table:
        """Join tables of one message type, in order."""
        if len(tables) == 1:
            return tables[0]
        parts = {part: [getattr(table, part) for table in tables] for part in _PARTS}
        wire = tables[0].fields.dtype
        parts["fields"] = [np.ascontiguousarray(rows).view(np.uint8) for rows in parts["fields"]]
        joined = {part: np.concatenate(rows) for part, rows in parts.items()}
        return cls(tables[0].name, **joined | {"fields": joined["fields"].view(wire)})

    def texts(self, field: str) -> list[str]:
        """Return a char field as text, cut at the first NUL."""
        return [bytes(value).split(b"\0")[0].decode("utf-8", "replace") for value in self.fields[field]]

    def to_frame(self) -> pd.DataFrame:
        """Return a DataFrame indexed by time of reception (UTC).

        An array field of k elements becomes k columns, ``data[0]`` … ``data[k-1]``.
        """
        import pandas as pd

        columns: dict[str, Any] = {
            "system": self.system,
            "component": self.component,
            "sequence": self.sequence,
        }
        for field in self.fields.dtype.names or ():
            values = self.fields[field]
            if values.dtype.kind == "S":
                columns[field] = self.texts(field)
            elif values.ndim == 1:
                columns[field] = values
            else:
                columns |= {f"{field}[{k}]": values[:, k] for k in range(values.shape[1])}
        index = pd.DatetimeIndex(self.time_us.astype("datetime64[us]"), tz="UTC", name="time")
        return pd.DataFrame(columns, index=index)
