"""Messages as columns: sending times, and each field in its wire unit."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums_sim._arrays import Array
from mavhums_sim.link import BOOT_US
from mavhums_sim.tiers import Stream

Columns = dict[str, Any]

_CLASSES = {kind.msgname: kind for kind in mavlink.mavlink_map.values()}


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """All messages of one type.

    Attributes
    ----------
    name
        Name of the message, as in MAVLink's XML.
    times
        Sending times, s since the log began, shape (n,).
    columns
        Field to values, shape (n,) or (n, length) for an array; a scalar applies to all rows. Fields that are
        absent are 0.
    """

    name: str
    times: Array
    columns: Columns = field(default_factory=dict)

    def rows(self) -> NDArray[np.void]:
        """Return the payloads as structured rows in wire order, shape (n,)."""
        rows = np.zeros(self.times.size, dtype=layout(self.name))
        for name, values in self.columns.items():
            rows[name] = values
        return rows

    def stream(self) -> Stream:
        """Return the table as messages that pymavlink builds one by one."""
        kind, rows = _CLASSES[self.name], self.rows()
        return Stream(self.times, lambda k: kind(*(_plain(rows[k][name]) for name in kind.fieldnames)))


def layout(name: str) -> np.dtype[np.void]:
    """Return the wire layout of a message's payload.

    Examples
    --------
    >>> layout("HEARTBEAT").itemsize
    9
    """
    kind = _CLASSES[name]
    types = dict(zip(kind.fieldnames, kind.fieldtypes, strict=True))
    return np.dtype(
        [
            _field(field_name, types[field_name], length)
            for field_name, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True)
        ]
    )


def boot_us(times: Array) -> NDArray[np.int64]:
    """Return the vehicle's clock, µs since power-on."""
    return BOOT_US + np.rint(times * 1e6).astype(np.int64)


def boot_ms(times: Array) -> NDArray[np.int64]:
    """Return the vehicle's clock in ms."""
    return boot_us(times) // 1000


def whole(values: Array, low: float = -32768, high: float = 32767) -> NDArray[np.int64]:
    """Return the values rounded and clipped to the integers of a field."""
    return np.clip(np.rint(values), low, high).astype(np.int64)


def text_rows(texts: list[tuple[float, str]]) -> Table:
    """Return STATUSTEXT of severity 6 from (time, text)."""
    times = np.array([time for time, _ in texts])
    return Table(
        "STATUSTEXT",
        times,
        {"severity": 6, "text": np.array([text.encode()[:50] for _, text in texts], "S50")},
    )


def _field(name: str, kind: str, length: int) -> tuple[Any, ...]:
    if kind == "char":
        return (name, f"S{max(length, 1)}")
    number = {"float": "<f4", "double": "<f8"}.get(kind)
    if number is None:
        sign = "u" if kind.startswith("u") else "i"
        bits = int("".join(c for c in kind if c.isdigit()))
        number = f"<{sign}{bits // 8}"
    return (name, number, (length,)) if length else (name, number)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value.item() if isinstance(value, np.generic) else value
