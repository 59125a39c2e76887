"""The esc-signed tier: ESC_STATUS (291), signed speed, voltage and current of four ESCs.

PX4 is known to repeat ESCs 0–3 in the batch whose index is 4; such a repetition is ignored.
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

MESSAGES = frozenset({"ESC_STATUS"})
TIER = Tier(
    "esc-signed",
    "V4, V5 and V7 with their signs, where an ESC drives a servo and no propeller",
    from_esc=True,
)

_BATCH = 4
_FIELDS = {"V4": "voltage", "V5": "current", "V7": "rpm"}
_COLUMNS = [column(key) for key in _FIELDS]
_READINGS = ("time_usec", "rpm", "voltage", "current")


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle and actuator that has an ESC."""
    table = tables.get("ESC_STATUS")
    if table is None:
        return
    table = table.select(~_repeated(table))
    values = np.stack([table[field].astype(np.float64) for field in _FIELDS.values()], axis=2)
    places = dict(each(table.system.astype(np.int64) << 8 | table["index"]))
    for vehicle in sorted({place >> 8 for place in places}):
        for actuator in actuators:
            if actuator.esc is None:
                continue
            k = actuator.esc % _BATCH
            rows = places.get(vehicle << 8 | actuator.esc - k)
            if rows is not None:
                yield Reading(
                    vehicle,
                    actuator,
                    f"ESC_STATUS[{actuator.esc}]",
                    "esc-signed",
                    _FIELDS,
                    table.frame[rows],
                    table.time_us[rows],
                    blank(_COLUMNS, values[rows, k]),
                )


def _repeated(table: Table) -> NDArray[np.bool_]:
    """Return which batches repeat the time and values of the previous batch, shape (n,)."""
    repeated = np.zeros(len(table), dtype=bool)
    if len(table) > 1:
        same = table["index"][1:] != table["index"][:-1]
        same &= table.system[1:] == table.system[:-1]
        for field in _READINGS:
            equal = table[field][1:] == table[field][:-1]
            same &= equal.all(axis=1) if equal.ndim == 2 else equal
        repeated[1:] = same
    return repeated
