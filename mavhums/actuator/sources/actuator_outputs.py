"""The pwm tier of a ULog: the topic actuator_outputs, sixteen outputs of each driver.

Its multi ids follow the order in which drivers start. As with SERVO_OUTPUT_RAW's ports, 0 is assumed to be
the MAIN outputs (servos 1–16), 1 AUX (17–32), 2 UAVCAN (33–48).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading
from mavhums.actuator.sources import pwm
from mavhums.actuator.sources.pwm import commands
from mavhums.log import Table

__all__ = ["MESSAGES", "TIER", "read"]

MESSAGES = frozenset({"actuator_outputs"})
TIER = pwm.TIER

_PER_DRIVER = 16


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle and servo with a pulse, if the profile has its travel."""
    table = tables.get("actuator_outputs")
    if table is None or not table.holds({"output": _PER_DRIVER}):
        return
    drivers = {driver: table.select(table.component == driver) for driver in np.unique(table.component)}
    for actuator in actuators:
        driver, k = divmod(actuator.servo - 1, _PER_DRIVER)
        if actuator.travel_deg is not None and driver in drivers:
            own = replace(drivers[driver], name=f"actuator_outputs[{driver}]")
            pulse_us = own["output"][:, k].astype(np.float64)
            yield from commands(own, pulse_us, f"output[{k}]", actuator)
