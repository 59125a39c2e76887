"""The instrumented tier: DEBUG_FLOAT_ARRAY (350) named EMA, or PX4's topic debug_array of that name.

``array_id``, or ``id``, is the servo number and ``data[0..11]`` = V1…V12, NaN where not measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading
from mavhums.actuator.tier import Tier
from mavhums.core.quantities import KEYS
from mavhums.log import Table
from mavhums.vehicle.clocks import each

__all__ = ["MESSAGES", "TIER", "is_marked", "read"]

_SENT, _LOGGED = "DEBUG_FLOAT_ARRAY", "debug_array"
MESSAGES = frozenset({_SENT, _LOGGED})
TIER = Tier("instrumented", "V1–V12")

_SERVO = {_SENT: "array_id", _LOGGED: "id"}
_ELEMENTS = 58
_FIELDS = {key: f"data[{k}]" for k, key in enumerate(KEYS)}


def is_marked(table: Table) -> NDArray[np.bool_]:
    """Return which rows of a table are actuator telemetry, shape (n,)."""
    if not table.holds({_SERVO[table.name]: 1, "data": _ELEMENTS}) or not table.holds_text("name"):
        return np.zeros(len(table), dtype=bool)
    return np.array(table["name"] == b"EMA")


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle and servo."""
    for name, servo_field in _SERVO.items():
        whole = tables.get(name)
        if whole is None:
            continue
        rows_told = is_marked(whole)
        if not rows_told.any():
            continue
        table = whole.select(rows_told)
        values = table["data"][:, : len(KEYS)].astype(np.float64)
        places = dict(each(table.system.astype(np.int64) << 16 | table[servo_field]))
        for vehicle in sorted({place >> 16 for place in places}):
            for actuator in actuators:
                rows = places.get(vehicle << 16 | actuator.servo)
                if rows is not None:
                    yield Reading(
                        vehicle,
                        actuator,
                        f"{name}[EMA,{actuator.servo}]",
                        "instrumented",
                        _FIELDS,
                        table.frame[rows],
                        table.time_us[rows],
                        values[rows],
                    )
