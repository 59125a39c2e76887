"""The instrumented tier: DEBUG_FLOAT_ARRAY (350) named EMA.

``array_id`` is the servo number and ``data[0..11]`` = V1…V12, NaN where not measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading
from mavhums.core.quantities import KEYS
from mavhums.log import Table
from mavhums.vehicle.clocks import Clocks, each

__all__ = ["MESSAGES", "is_instrumented", "read"]

MESSAGES = frozenset({"DEBUG_FLOAT_ARRAY"})

_FIELDS = {key: f"data[{k}]" for k, key in enumerate(KEYS)}


def is_instrumented(table: Table) -> NDArray[np.bool_]:
    """Return which rows of a DEBUG_FLOAT_ARRAY table are actuator telemetry, shape (n,)."""
    return np.array(table["name"] == b"EMA")


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator], clocks: Clocks) -> Iterator[Reading]:
    """Yield a reading for each vehicle and servo."""
    table = tables.get("DEBUG_FLOAT_ARRAY")
    if table is None:
        return
    table = table.select(is_instrumented(table))
    utc_us = clocks.utc_us(table, 1, "time_usec")
    values = table["data"][:, : len(KEYS)].astype(np.float64)
    places = dict(each(table.system.astype(np.int64) << 16 | table["array_id"]))
    for vehicle in sorted({place >> 16 for place in places}):
        for actuator in actuators:
            rows = places.get(vehicle << 16 | actuator.servo)
            if rows is not None:
                yield Reading(
                    vehicle,
                    actuator,
                    f"DEBUG_FLOAT_ARRAY[EMA,{actuator.servo}]",
                    "instrumented",
                    _FIELDS,
                    table.frame[rows],
                    utc_us[rows],
                    values[rows],
                )
