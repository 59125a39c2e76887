"""The esc-signed tier of a ULog: the topic esc_status, up to eight ESCs in one record.

An ESC that has not yet reported has the time stamp 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading, blank
from mavhums.actuator.sources import esc_signed
from mavhums.core.quantities import column
from mavhums.log import Table
from mavhums.vehicle.clocks import each

__all__ = ["MESSAGES", "TIER", "read"]

MESSAGES = frozenset({"esc_status"})
TIER = esc_signed.TIER

_FIELDS = {"V4": "esc_voltage", "V5": "esc_current", "V7": "esc_rpm"}
_COLUMNS = [column(key) for key in _FIELDS]


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle and actuator that has an ESC."""
    table = tables.get("esc_status")
    for actuator in actuators if table is not None else ():
        if actuator.esc is None:
            continue
        prefix = f"esc[{actuator.esc}]."
        names = [prefix + field for field in _FIELDS.values()]
        if table is None or not table.holds(dict.fromkeys([prefix + "timestamp", *names], 1)):
            continue
        values = np.stack([table[name].astype(np.float64) for name in names], axis=1)
        for vehicle, rows in each(table.system, table[prefix + "timestamp"] != 0):
            yield Reading(
                vehicle,
                actuator,
                f"esc_status[{actuator.esc}]",
                "esc-signed",
                _FIELDS,
                table.frame[rows],
                table.time_us[rows],
                blank(_COLUMNS, values[rows]),
            )
