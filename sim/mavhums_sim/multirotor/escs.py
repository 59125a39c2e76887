"""What the ESCs of a multirotor report: the speeds of its rotors."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums_sim.dataflash import Kind, records
from mavhums_sim.multirotor.flight import LOGGED_HZ, Flown

Array = NDArray[np.float64]
FULL_RPM: Final = 9000.0


def rotor_rpm(flown: Flown) -> Array:
    """Return the speed of each rotor, rev/min, shape (n, motors): by the root of its lagged thrust."""
    craft, event = flown.craft, flown.plan.event
    given = craft.hover * (flown.command / craft.hover) ** craft.exponent
    keep = np.exp(-1.0 / (LOGGED_HZ * craft.lag_s))
    for k in range(1, len(given)):
        given[k] += keep * (given[k - 1] - given[k])
    if not np.isnan(event.fault_s) and not event.by_propeller:
        given[flown.time_s >= event.fault_s, event.motor] *= 1.0 - event.loss
    rpm: Array = FULL_RPM * np.sqrt(given)
    return rpm


def esc_records(flown: Flown, rate_hz: float, seed: int) -> list[Kind]:
    """Return what each ESC reports: speed, to the time between two commutations (ESC)."""
    rng = np.random.default_rng([seed, 14])
    rpm = rotor_rpm(flown)
    kinds = []
    for k in range(rpm.shape[1]):
        time_s = np.arange(rng.uniform(0, 1 / rate_hz), flown.time_s[-1], 1 / rate_hz)
        speed = np.interp(time_s, flown.time_s, rpm[:, k]) * (1 + rng.normal(0.0, 0.002, time_s.size))
        kinds.append(records("ESC", time_s, Instance=k, RPM=speed, Volt=14.8, Curr=5.0, Temp=0.0))
    return kinds
