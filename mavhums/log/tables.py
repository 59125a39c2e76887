"""Columns of messages of one type."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Table"]


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
    fields
        Record array: ``fields["voltage"]`` is a column, of shape (n,) or (n, k).
    """

    name: str
    frame: NDArray[np.int64]
    time_us: NDArray[np.int64]
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    sequence: NDArray[np.uint8]
    fields: NDArray[np.void]

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, field: str) -> NDArray[Any]:
        return self.fields[field]

    def select(self, rows: NDArray[Any]) -> Table:
        """Return the rows that a mask or an index array names."""
        return Table(
            self.name,
            self.frame[rows],
            self.time_us[rows],
            self.system[rows],
            self.component[rows],
            self.sequence[rows],
            self.fields[rows],
        )

    @classmethod
    def concatenate(cls, tables: list[Table]) -> Table:
        """Join tables of one message type, in order."""
        return cls(
            tables[0].name,
            np.concatenate([table.frame for table in tables]),
            np.concatenate([table.time_us for table in tables]),
            np.concatenate([table.system for table in tables]),
            np.concatenate([table.component for table in tables]),
            np.concatenate([table.sequence for table in tables]),
            np.concatenate([table.fields for table in tables]),
        )

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
