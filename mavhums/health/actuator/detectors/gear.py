"""Faults that the gear equation shows: backlash, and the bias of the output shaft's position sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.health.actuator.detector import EquationDetector, sharp
from mavhums.health.decision.limits import Estimates, Levels
from mavhums.health.decision.thresholds import AGREEING
from mavhums.health.estimation.equations.data_sheet import GEAR
from mavhums.health.estimation.least_squares import Fit


class BacklashDetector(EquationDetector):
    """Backlash at the output shaft; needs both angles and the load."""

    fault: ClassVar[str] = "backlash"
    quantity: ClassVar[str] = "backlash"
    unit: ClassVar[str] = "°"
    inspect: ClassVar[str] = "gear and linkage for play"
    equations: ClassVar[tuple[str, ...]] = ("gear",)
    needs_limits: ClassVar[bool] = True

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        self.levels = Levels(actuator.known_limits().backlash_deg)

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the backlash; undecidable unless the load acts on both flanks."""
        fit = fits["gear"]
        half_play, half_error = fit["flank"]
        # A load on one flank only never shows the play.
        both = fit.spread & (fit.both_ways("flank", "bias") >= AGREEING)
        play, error = -2.0 * half_play, 2.0 * half_error
        return Estimates.of(play, error, fit.freedom, both & sharp(play, error, self.levels.normal))


class SensorBiasDetector(EquationDetector):
    """Difference of the two angles that backlash and wind-up do not explain."""

    fault: ClassVar[str] = "sensor_bias"
    quantity: ClassVar[str] = "bias of the position sensor"
    unit: ClassVar[str] = "°"
    inspect: ClassVar[str] = "the position sensor's mounting and calibration"
    equations: ClassVar[tuple[str, ...]] = ("gear",)
    needs_limits: ClassVar[bool] = True
    two_sided: ClassVar[bool] = True

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        self.levels = Levels(actuator.known_limits().sensor_bias_deg)
        self._play = float(GEAR.prior(actuator).deviation[GEAR.terms.index("flank")])

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the bias; with load on only one flank, its error includes the possible backlash."""
        fit = fits["gear"]
        one_sided = fit.both_ways("flank", "bias") < AGREEING
        bias, error = fit["bias"]
        # On one flank play and bias look alike.
        error = np.maximum(error, np.where(one_sided, self._play, 0.0))
        return Estimates.of(bias, error, fit.freedom, fit.spread & sharp(bias, error, self.levels.normal))
