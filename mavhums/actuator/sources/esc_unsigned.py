"""The esc-unsigned tier: ESC_TELEMETRY_a_TO_b (11030–11032, 11040–11044), magnitudes only.

Resolutions are 10 mV, 10 mA and 1 rev/min; there is no sender time. A row of zeros is an absent ESC.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading, blank
from mavhums.actuator.tier import Tier
from mavhums.core.quantities import column
from mavhums.log import Table
from mavhums.vehicle.clocks import each

__all__ = ["MESSAGES", "TIER", "read"]

_BATCH = 4
_NAMES = tuple(f"ESC_TELEMETRY_{first}_TO_{first + _BATCH - 1}" for first in range(1, 33, _BATCH))
MESSAGES = frozenset(_NAMES)
TIER = Tier(
    "esc-unsigned", "magnitudes of V4, V5 and V7, where an ESC drives a servo and no propeller", from_esc=True
)

_FIELDS = {"V4": "voltage", "V5": "current", "V7": "rpm"}
_COLUMNS = [column(key) for key in _FIELDS]
_UNITS = (0.01, 0.01, 1.0)


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle and actuator that has an ESC."""
    values = {name: _values(tables[name]) for name in _NAMES if name in tables}
    for actuator in actuators:
        if actuator.esc is None:
            continue
        name, k = _NAMES[actuator.esc // _BATCH], actuator.esc % _BATCH
        if name not in values:
            continue
        table, there = tables[name], (values[name][:, k] != 0).any(axis=1)
        for vehicle, rows in each(table.system, there):
            yield Reading(
                vehicle,
                actuator,
                f"{name}[{k}]",
                "esc-unsigned",
                _FIELDS,
                table.frame[rows],
                table.time_us[rows],
                blank(_COLUMNS, values[name][rows, k]),
                signed=False,
            )


def _values(table: Table) -> NDArray[np.float64]:
    """Return voltage (V), current (A) and speed (rev/min) of the four ESCs, shape (n, 4, 3)."""
    parts = [table[field] * unit for field, unit in zip(_FIELDS.values(), _UNITS, strict=True)]
    return np.stack(parts, axis=2)
