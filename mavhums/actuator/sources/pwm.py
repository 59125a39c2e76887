"""The pwm tier: the commanded pulse, through the profile's calibration, is V1 and nothing more.

SERVO_OUTPUT_RAW (36), whose ``port`` 0 and 1 are servos 1–16 and 17–32 and whose 32-bit time starts
anew every 71.6 min; or ACTUATOR_OUTPUT_STATUS (375). The pulse already contains a reversal.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Clocks, Reading, blank
from mavhums.log import Table

__all__ = ["MESSAGES", "read"]

MESSAGES = frozenset({"SERVO_OUTPUT_RAW", "ACTUATOR_OUTPUT_STATUS"})

_PER_PORT = 16
_PULSES_US = (500.0, 2500.0)


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator], clocks: Clocks) -> Iterator[Reading]:
    """Yield a reading for each vehicle and servo with a pulse, if the profile tells its travel."""
    raw = tables.get("SERVO_OUTPUT_RAW")
    if raw is not None:
        utc_us = clocks.utc_us(raw, 1, "time_usec", wrap_us=2**32)
        for actuator in actuators:
            port, k = divmod(actuator.servo - 1, _PER_PORT)
            field = f"servo{k + 1}_raw"
            yield from _commands(
                raw, raw["port"] == port, raw[field].astype(np.float64), field, actuator, utc_us
            )
    status = tables.get("ACTUATOR_OUTPUT_STATUS")
    if status is not None:
        utc_us = clocks.utc_us(status, 1, "time_usec")
        for actuator in actuators:
            k = actuator.servo - 1
            every = np.ones(len(status), dtype=bool)
            pulse = status["actuator"][:, k].astype(np.float64)
            yield from _commands(status, every, pulse, f"actuator[{k}]", actuator, utc_us)


def _commands(
    table: Table,
    rows: NDArray[np.bool_],
    pulse_us: NDArray[np.float64],
    field: str,
    actuator: Actuator,
    utc_us: NDArray[np.int64],
) -> Iterator[Reading]:
    if actuator.travel_deg is None:
        return
    rows = rows & (pulse_us >= _PULSES_US[0]) & (pulse_us <= _PULSES_US[1])
    for vehicle in np.unique(table.system[rows]):
        mine = rows & (table.system == vehicle)
        angle = np.interp(
            pulse_us[mine], actuator.pwm_us, (actuator.travel_deg[0], 0.0, actuator.travel_deg[1])
        )
        yield Reading(
            int(vehicle),
            actuator,
            table.name,
            "pwm",
            {"V1": field},
            table.frame[mine],
            utc_us[mine],
            blank(int(mine.sum()), [0], [angle]),
        )
