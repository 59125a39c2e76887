"""The esc-unsigned tier of a DataFlash log: ESC, one record per ESC, identified by ``Instance``.

Most ESCs report magnitudes, and no record distinguishes them, so all values are treated as magnitudes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading, blank
from mavhums.actuator.sources import esc_unsigned
from mavhums.core.quantities import column
from mavhums.log import Table
from mavhums.vehicle.clocks import each

__all__ = ["MESSAGES", "TIER", "read"]

MESSAGES = frozenset({"ESC"})
TIER = esc_unsigned.TIER

_FIELDS = {"V4": "Volt", "V5": "Curr", "V7": "RPM"}
_COLUMNS = [column(key) for key in _FIELDS]


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle and actuator that has an ESC."""
    table = tables.get("ESC")
    if table is None or not {"Instance", *_FIELDS.values()} <= set(table.fields.dtype.names or ()):
        return
    values = np.abs(np.stack([table[field].astype(np.float64) for field in _FIELDS.values()], axis=1))
    places = dict(each(table.system.astype(np.int64) << 8 | table["Instance"]))
    for vehicle in sorted({place >> 8 for place in places}):
        for actuator in actuators:
            rows = None if actuator.esc is None else places.get(vehicle << 8 | actuator.esc)
            if rows is not None:
                yield Reading(
                    vehicle,
                    actuator,
                    f"ESC[{actuator.esc}]",
                    "esc-unsigned",
                    _FIELDS,
                    table.frame[rows],
                    table.time_us[rows],
                    blank(_COLUMNS, values[rows]),
                    signed=False,
                )
