"""The csrv tier: ArduPilot's record of servo telemetry in a DataFlash log.

The servo fills the fields that it measures; the others are NaN. A serial Volz servo gives position, command,
voltage and current; a DroneCAN servo gives position, torque and speed. The servo number is the output counted
from 0 if the autopilot itself drives the servo (the record then has its command), and from 1 on DroneCAN,
whose servos do not repeat the command. A profile's ``csrv`` overrides this.

ArduPilot before 4.7 logs no command and gives the angle in radians. Voltage and current are those
of the servo's supply, unless the profile assigns them to the motor.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import pi

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading, blank
from mavhums.actuator.tier import Tier
from mavhums.core.quantities import column
from mavhums.log import Table

__all__ = ["MESSAGES", "TIER", "read"]

MESSAGES = frozenset({"CSRV"})
TIER = Tier("csrv", "V1, V3, V4, V5, V10 and V11, as far as the servo reports them")

_DEGREES = {
    "PosCmd": ("V1", 1.0),
    "Pos": ("V3", 1.0),
    "V": ("V4", 1.0),
    "A": ("V5", 1.0),
    "Speed": ("V10", 1 / 6),
    "Force": ("V11", 1.0),
}
_RADIANS = {"Pos": ("V3", 180 / pi), "Speed": ("V10", 30 / pi), "Force": ("V11", 1.0)}


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle and servo."""
    table = tables.get("CSRV")
    if table is None:
        return
    names = table.fields.dtype.names or ()
    gives = _DEGREES if "PosCmd" in names else _RADIANS
    fields = {field: gives[field] for field in gives if field in names}
    if "Id" not in names or not fields:
        return
    number = table["Id"].astype(np.int64)
    servo = number + np.isfinite(table["PosCmd"]) if "PosCmd" in names else number
    told = {actuator.csrv for actuator in actuators if actuator.csrv is not None}
    for vehicle in np.unique(table.system).tolist():
        ours = table.system == vehicle
        for actuator in actuators:
            if actuator.csrv is None:
                rows = np.flatnonzero(ours & (servo == actuator.servo) & ~np.isin(number, list(told)))
            else:
                rows = np.flatnonzero(ours & (number == actuator.csrv))
            if rows.size:
                yield _reading(table, actuator, rows, fields)


def _reading(
    table: Table, actuator: Actuator, rows: NDArray[np.int64], fields: Mapping[str, tuple[str, float]]
) -> Reading:
    values = np.stack(
        [table[field][rows].astype(np.float64) * scale for field, (_, scale) in fields.items()], axis=1
    )
    values[~np.isfinite(values)] = np.nan
    keys = [key for key, _ in fields.values()]
    return Reading(
        int(table.system[rows[0]]),
        actuator,
        f"CSRV[{int(table['Id'][rows[0]])}]",
        "csrv",
        {key: field for field, (key, _) in fields.items()},
        table.frame[rows],
        table.time_us[rows],
        blank([column(key) for key in keys], values),
    )
