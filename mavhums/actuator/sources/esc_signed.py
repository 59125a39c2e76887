"""The esc-signed tier: ESC_STATUS (291), speed, voltage and current of four ESCs, with their signs.

PX4 is known to repeat ESCs 0–3 in the batch whose index is 4; such a repetition is ignored.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Clocks, Reading, blank
from mavhums.log import Table
from mavhums.quantities import column

__all__ = ["MESSAGES", "read"]

MESSAGES = frozenset({"ESC_STATUS"})

_BATCH = 4
_READINGS = ("time_usec", "rpm", "voltage", "current")


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator], clocks: Clocks) -> Iterator[Reading]:
    """Yield a reading for each vehicle and actuator that has an ESC."""
    table = tables.get("ESC_STATUS")
    if table is None:
        return
    table = table.select(~_repeated(table))
    utc_us = clocks.utc_us(table, 1, "time_usec")
    for vehicle in np.unique(table.system):
        for actuator in actuators:
            if actuator.esc is None:
                continue
            batch, k = actuator.esc // _BATCH * _BATCH, actuator.esc % _BATCH
            rows = (table.system == vehicle) & (table["index"] == batch)
            if not rows.any():
                continue
            columns = [column(key) for key in ("V4", "V5", "V7")]
            parts = [table[field][rows, k].astype(np.float64) for field in ("voltage", "current", "rpm")]
            yield Reading(
                int(vehicle),
                actuator,
                f"ESC_STATUS[{actuator.esc}]",
                "esc-signed",
                {"V4": "voltage", "V5": "current", "V7": "rpm"},
                table.frame[rows],
                utc_us[rows],
                blank(int(rows.sum()), columns, parts),
            )


def _repeated(table: Table) -> NDArray[np.bool_]:
    """Return which batches say the same, at the same time, as the batch just before them."""
    repeated = np.zeros(len(table), dtype=bool)
    if len(table) > 1:
        same = table["index"][1:] != table["index"][:-1]
        same &= table.system[1:] == table.system[:-1]
        for field in _READINGS:
            equal = table[field][1:] == table[field][:-1]
            same &= equal.all(axis=1) if equal.ndim == 2 else equal
        repeated[1:] = same
    return repeated
