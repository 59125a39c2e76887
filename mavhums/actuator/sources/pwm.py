"""The pwm tier: the commanded pulse, converted by the profile's calibration, gives only V1.

SERVO_OUTPUT_RAW (36), whose ``port`` 0 and 1 are servos 1–16 and 17–32 and whose 32-bit time starts
anew every 71.6 min; or ACTUATOR_OUTPUT_STATUS (375). The pulse already contains a reversal. For servos on
UAVCAN, here 33–48, PX4 sends a number from 0 to 1000 instead of a pulse.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading, blank
from mavhums.actuator.tier import Tier
from mavhums.log import Table
from mavhums.vehicle.clocks import each

__all__ = ["MESSAGES", "TIER", "commands", "read"]

MESSAGES = frozenset({"SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS"})
TIER = Tier("pwm", "V1, the command, alone", judged=False)

_PER_PORT = 16
_PER_STATUS = 32
_PULSES_US = (500.0, 2500.0)
_UAVCAN = (0.0, 1000.0)


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle and servo with a pulse, if the profile has its travel."""
    moved = [actuator for actuator in actuators if actuator.travel_deg is not None]
    raw = tables.get("SERVO_OUTPUT_RAW")
    if raw is not None:
        for actuator in moved:
            port, k = divmod(actuator.servo - 1, _PER_PORT)
            field = f"servo{k + 1}_raw"
            pulse_us = np.where(raw["port"] == port, raw[field], 0).astype(np.float64)
            yield from commands(raw, pulse_us, field, actuator)
    status = tables.get("ACTUATOR_OUTPUT_STATUS")
    if status is not None:
        for actuator in moved:
            k = actuator.servo - 1
            if k >= _PER_STATUS:
                continue
            pulse_us = status["actuator"][:, k].astype(np.float64)
            yield from commands(status, pulse_us, f"actuator[{k}]", actuator)


def commands(
    table: Table, pulse_us: NDArray[np.float64], field: str, actuator: Actuator
) -> Iterator[Reading]:
    """Yield a reading of V1 for each vehicle; ``pulse_us`` (n,) is the commanded pulse, µs."""
    low_deg, high_deg = actuator.travel_deg or (0.0, 0.0)
    least, most = _PULSES_US if actuator.servo <= _PER_STATUS else _UAVCAN
    least, most = max(least, actuator.range_us[0]), min(most, actuator.range_us[1])
    there = (pulse_us >= least) & (pulse_us <= most)  # beyond its calibration a pulse tells no angle
    for vehicle, rows in each(table.system, there):
        angle = np.interp(pulse_us[rows], actuator.pwm_us, (low_deg, 0.0, high_deg))
        yield Reading(
            vehicle,
            actuator,
            table.name,
            "pwm",
            {"V1": field},
            table.frame[rows],
            table.time_us[rows],
            blank([0], angle[:, None]),
        )
