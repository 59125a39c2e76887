"""The esc-unsigned tier: ESC_TELEMETRY_a_TO_b (11030–11032, 11040–11044), magnitudes only.

10 mV, 10 mA and 1 rev/min, no sender's time. A row of zeros is an ESC that is not there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Clocks, Reading, blank
from mavhums.log import Table
from mavhums.quantities import column

__all__ = ["MESSAGES", "read"]

_BATCH = 4
_NAMES = tuple(f"ESC_TELEMETRY_{first}_TO_{first + _BATCH - 1}" for first in range(1, 33, _BATCH))
MESSAGES = frozenset(_NAMES)


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator], _: Clocks) -> Iterator[Reading]:
    """Yield a reading for each vehicle and actuator that has an ESC."""
    for actuator in actuators:
        if actuator.esc is None:
            continue
        name, k = _NAMES[actuator.esc // _BATCH], actuator.esc % _BATCH
        table = tables.get(name)
        if table is None:
            continue
        parts = [
            table[field][:, k] * scale
            for field, scale in (("voltage", 0.01), ("current", 0.01), ("rpm", 1.0))
        ]
        there = np.any([part != 0 for part in parts], axis=0)
        for vehicle in np.unique(table.system[there]):
            rows = (table.system == vehicle) & there
            columns = [column(key) for key in ("V4", "V5", "V7")]
            yield Reading(
                int(vehicle),
                actuator,
                f"{name}[{k}]",
                "esc-unsigned",
                {"V4": "voltage", "V5": "current", "V7": "rpm"},
                table.frame[rows],
                table.time_us[rows],
                blank(int(rows.sum()), columns, [part[rows] for part in parts]),
                signed=False,
            )
