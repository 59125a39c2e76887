"""Columns of messages of one type, and their conversion to pandas and Arrow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array, Bytes, Integers, Records

if TYPE_CHECKING:
    import pandas as pd

MAVLINK1 = 1
SIGNED = 2
"""The frame has a signature, which was not verified."""
PADDED = 4
"""The CRC matched only with restored zeros, which the sender trimmed after it computed the CRC."""
ODD_TIME = 8
"""The time stamp was damaged; the time is that of a neighbouring record."""
LOOSE_TIME = 16
"""The message has no stamp, and its sender's stamped ones arrive with latencies more than 0.5 s apart."""

C_NUMBERS: Final = {
    "int8_t": "i1",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "int32_t": "<i4",
    "uint32_t": "<u4",
    "int64_t": "<i8",
    "uint64_t": "<u8",
    "float": "<f4",
    "double": "<f8",
}
"""Numpy's types of numbers under their names in C, by which MAVLink and ULog define fields."""

_PARTS = ("frame", "time_us", "system", "component", "sequence", "flags", "fields")


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Messages of one type in the order of the log; every array has n rows.

    Attributes
    ----------
    name
        Message name, as in its definition.
    frame
        Position of each message among all intact records of the log.
    time_us
        Time of reception, microseconds of UTC since 1970.
    system, component, sequence
        From the frame's header.
    flags
        How the frame was received: the bits of this module.
    fields
        Record array as in the log: ``fields["voltage"]`` is a column, of shape (n,) or (n, k).
    divisors
        Divisor of a field's raw number, if the format's type defines one; ``table["Lat"]`` and
        every conversion apply it.
    """

    name: str
    frame: Integers
    time_us: Integers
    system: Bytes
    component: Bytes
    sequence: Bytes
    flags: Bytes
    fields: Records
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
            if form.kind not in "iuf" or shape != ((width,) if width > 1 else ()):
                return False
        return True

    def numbers(self, field: str) -> Array:
        """Return a numeric field, (n,); NaN if the log defines it otherwise.

        The one way to read what a definition may lack: a damaged one is a quantity that was not measured.
        """
        if not self.holds({field: 1}):
            return np.full(len(self), np.nan)
        return self[field].astype(np.float64)

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
        for name in self.fields.dtype.names or ():
            values = self[name]
            if values.dtype.kind == "S":
                columns[name] = _as_text(values)
            elif values.ndim == 1:
                columns[name] = np.ascontiguousarray(values)
            else:
                columns |= {
                    f"{name}[{k}]": np.ascontiguousarray(values[:, k]) for k in range(values.shape[1])
                }
        index = pd.DatetimeIndex(self.time_us.view("M8[us]"), name="time").tz_localize("UTC")
        return pd.DataFrame(columns, index=index, copy=False)


def _as_text(values: NDArray[Any]) -> Any:
    """Return chars as pandas' text, each distinct value decoded once."""
    import pandas as pd

    numbers: dict[bytes, int] = {}
    codes = [numbers.setdefault(value, len(numbers)) for value in values.tolist()]
    return pd.array([text_of(value) for value in numbers], dtype="str").take(np.array(codes, dtype=np.int64))


def text_of(value: bytes) -> str:
    """Return a char field as text, cut at the first NUL."""
    return value.split(b"\0")[0].decode("utf-8", "replace")
