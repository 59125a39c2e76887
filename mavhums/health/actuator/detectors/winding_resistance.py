"""Resistance of the stator winding and its connections, from the voltage equation.

Copper gains 0.39 % per kelvin: a limit must allow for a warm motor.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from mavhums.actuator.profile import Actuator
from mavhums.health.actuator.detector import EquationDetector, sharp
from mavhums.health.actuator.thresholds import WIDEST_RESISTANCE_SHARE
from mavhums.health.decision.limits import Levels
from mavhums.health.estimation.fits import Estimates
from mavhums.health.estimation.least_squares import Fit


class WindingResistanceDetector(EquationDetector):
    """Winding resistance, relative to the data sheet's."""

    fault: ClassVar[str] = "winding_resistance"
    quantity: ClassVar[str] = "winding resistance"
    unit: ClassVar[str] = "Ω"
    inspect: ClassVar[str] = "winding, connectors and wiring for a poor contact"
    equations: ClassVar[tuple[str, ...]] = ("voltage",)

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        gain = actuator.limits.resistance_gain if actuator.limits else None
        nominal = actuator.known_ema().resistance
        self.levels = Levels(None if gain is None else nominal * (1.0 + gain))

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the resistance; undecidable if the current varies too little."""
        fit, nominal = fits["voltage"], self.actuator.known_ema().resistance
        resistance, error = fit.corrected("resistance", noisy="resistance")
        shown = fit.spread & sharp(resistance, error, WIDEST_RESISTANCE_SHARE * nominal, self.levels.normal)
        return Estimates.of(resistance, error, fit.freedom, shown)
