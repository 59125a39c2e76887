"""Voltage lost on the actuator's supply, for logs with the supply voltage.

An ESC at the supply bus measures it. The motor's voltage V4 equals the supply voltage only for milliseconds
at full controller output, so a motor-side ESC cannot measure it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.health.actuator.detector import EquationDetector
from mavhums.health.actuator.thresholds import SUPPLY_SENSOR_V
from mavhums.health.decision.limits import Levels
from mavhums.health.estimation.fits import Estimates
from mavhums.health.estimation.least_squares import Fit


class SupplySagDetector(EquationDetector):
    """Supply voltage drop relative to the healthy supply."""

    fault: ClassVar[str] = "supply_sag"
    quantity: ClassVar[str] = "supply voltage lost"
    unit: ClassVar[str] = "V"
    inspect: ClassVar[str] = "battery, regulator and wiring of its supply"
    equations: ClassVar[tuple[str, ...]] = ("supply",)

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        self.levels = Levels(actuator.limits.supply_sag_v if actuator.limits else None)
        self._supply = actuator.known_ema().supply_voltage or np.nan

    @staticmethod
    def suits(actuator: Actuator) -> bool:
        """Return whether the ESC is at the bus and the profile has the healthy supply's voltage."""
        known = actuator.ema is not None and actuator.ema.supply_voltage is not None
        return known and actuator.esc_side == "bus"

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the sag; undecidable without the voltage at the bus."""
        fit = fits["supply"]
        voltage, error = fit["voltage"]
        # The sensor's own error does not average out.
        error = np.hypot(error, SUPPLY_SENSOR_V)
        return Estimates.of(self._supply - voltage, error, fit.freedom, fit.spread)
