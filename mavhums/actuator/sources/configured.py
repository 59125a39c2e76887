"""Fields that the profile maps to quantities itself: any message, any field."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator, FieldMapping
from mavhums.actuator.readings import Clocks, Reading, blank
from mavhums.log import Table
from mavhums.quantities import column

__all__ = ["MESSAGES", "read"]

MESSAGES: frozenset[str] = frozenset()

_TIMES = (("time_usec", 1), ("time_boot_ms", 1000))


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator], clocks: Clocks) -> Iterator[Reading]:
    """Yield a reading for each vehicle, actuator and mapped quantity."""
    utc_us: dict[str, NDArray[np.int64]] = {}
    for actuator in actuators:
        for key, mapping in actuator.fields.items():
            table = tables.get(mapping.message)
            if table is None:
                continue
            if mapping.message not in utc_us:
                utc_us[mapping.message] = _times(table, clocks)
            yield from _mapped(table, actuator, key, mapping, utc_us[mapping.message])


def _column(table: Table, field: str) -> NDArray[Any]:
    """Return a field, or one element of an array field: ``rpm[2]``."""
    name, _, element = field.partition("[")
    values: NDArray[Any] = table[name]
    return values[:, int(element.rstrip("]"))] if element else values


def _times(table: Table, clocks: Clocks) -> NDArray[np.int64]:
    names = table.fields.dtype.names or ()
    for field, scale in _TIMES:
        if field in names:
            return clocks.utc_us(table, scale, field)
    return table.time_us


def _mapped(
    table: Table, actuator: Actuator, key: str, mapping: FieldMapping, utc_us: NDArray[np.int64]
) -> Iterator[Reading]:
    chosen = np.ones(len(table), dtype=bool)
    for field, wanted in mapping.where.items():
        values = _column(table, field)
        chosen &= values == (wanted.encode() if isinstance(wanted, str) else wanted)
    values = _column(table, mapping.field).astype(np.float64) * mapping.scale + mapping.offset
    for vehicle in np.unique(table.system[chosen]):
        rows = chosen & (table.system == vehicle)
        which = ",".join(str(value) for value in mapping.where.values())
        yield Reading(
            int(vehicle),
            actuator,
            f"{mapping.message}[{which}]" if which else mapping.message,
            "named",
            {key: mapping.field},
            table.frame[rows],
            utc_us[rows],
            blank(int(rows.sum()), [column(key)], [values[rows]]),
        )
