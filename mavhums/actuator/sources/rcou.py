"""The pwm tier of a DataFlash log: RCOU, RCO2 and RCO3, the pulses of outputs 1–14, 15–18 and 19–32."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.actuator.readings import Reading
from mavhums.actuator.sources import pwm
from mavhums.actuator.sources.pwm import commands
from mavhums.log import Table

__all__ = ["MESSAGES", "TIER", "read"]

MESSAGES = frozenset({"RCOU", "RCO2", "RCO3"})
TIER = pwm.TIER


def read(tables: Mapping[str, Table], actuators: Sequence[Actuator]) -> Iterator[Reading]:
    """Yield a reading for each vehicle and servo with a pulse, if the profile has its travel."""
    for name in sorted(MESSAGES & tables.keys()):
        table = tables[name]
        for actuator in actuators:
            field = f"C{actuator.servo}"
            if actuator.travel_deg is not None and field in (table.fields.dtype.names or ()):
                pulse_us = table[field].astype(np.float64)
                yield from commands(table, pulse_us, field, actuator)
