"""Plausibility bounds of an actuator: values beyond them count as not measured.

The bounds follow from the profile, with a factor of three for sensors, faults and data sheets: the travel;
the supply voltage U, at the motor's terminals; the stall current U/R; the no-load speed U/k_t; and the
resulting torques and powers. If the profile lacks a constant, the bound is a value that no unmanned aircraft
reaches.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import KEYS

__all__ = ["Gate", "bounds"]

_MARGIN = 3.0
_OFFSET = 10.0  # an unwrapped angle has an arbitrary start
_BACK_DRIVEN = 10.0  # times the stall torque: largest load of air and end stops on the gear
_RPM = 60 / (2 * np.pi)
_LARGEST = {
    "V1": 720.0,
    "V2": 1e7,
    "V3": 720.0,
    "V4": 1000.0,
    "V5": 1000.0,
    "V6": 1e6,
    "V7": 2e5,
    "V8": 1e3,
    "V9": 1e6,
    "V10": 2e4,
    "V11": 1e5,
    "V12": 1e6,
}

Array = NDArray[np.float64]


def bounds(actuator: Actuator) -> Array:
    """Return the largest magnitude that each of V1…V12 can have, shape (12,).

    Examples
    --------
    >>> from mavhums.actuator import load_airframe
    >>> of = dict(zip(KEYS, bounds(load_airframe("paper").actuators[0]).round(1).tolist(), strict=True))
    >>> of["V1"], of["V4"], of["V5"], of["V7"]
    (180.0, 81.0, 3.6, 52950.5)
    """
    most = dict(_LARGEST)
    if actuator.travel_deg is not None:
        most["V1"] = most["V3"] = max(_MARGIN * max(map(abs, actuator.travel_deg)), 180.0)
    ema = actuator.ema
    if ema is not None:
        volts = _MARGIN * ema.supply_voltage if ema.supply_voltage is not None else most["V4"]
        amps, rpm = volts / ema.resistance, volts / ema.torque_constant * _RPM
        stall = ema.torque_constant * ema.gear_ratio * amps
        most |= {
            "V2": _OFFSET * most["V3"] * ema.gear_ratio,
            "V4": volts,
            "V5": amps + _MARGIN * actuator.electronics_a,
            "V7": rpm,
            "V8": ema.torque_constant * amps,
            "V10": rpm / ema.gear_ratio,
            "V11": _BACK_DRIVEN / _MARGIN * stall,
        }
        most["V6"] = most["V4"] * most["V5"]
        most["V9"] = most["V8"] * most["V7"] / _RPM
        most["V12"] = most["V11"] * most["V10"] / _RPM
    return np.array([most[key] for key in KEYS])


class Gate:
    """Removes implausible values from one actuator's readings, and counts them.

    Attributes
    ----------
    told, refused
        Number of values of each quantity, and number of removed ones, shape (12,).
    """

    def __init__(self, actuator: Actuator) -> None:
        self.told = np.zeros(len(KEYS), dtype=np.int64)
        self.refused = np.zeros(len(KEYS), dtype=np.int64)
        self._bounds = bounds(actuator)

    def admit(self, values: Array) -> Array:
        """Return V1…V12, shape (n, 12), with NaN for implausible values.

        NaN means that a quantity was not measured; infinity is a value, and implausible.
        """
        size = np.abs(values)
        told = ~np.isnan(values)
        refused = size > self._bounds
        self.told += told.sum(axis=0)
        if not refused.any():
            return values
        self.refused += refused.sum(axis=0)
        return np.where(refused, np.nan, values)
