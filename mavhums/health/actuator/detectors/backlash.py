"""Backlash of the gear, from the angle between rotor and output shaft when the load changes flanks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from mavhums.actuator.profile import Actuator
from mavhums.health.actuator.detector import EquationDetector, sharp
from mavhums.health.actuator.thresholds import LEAST_FLANK_SLOTS, WIDEST_GEAR_ERROR_DEG
from mavhums.health.decision.limits import Levels
from mavhums.health.estimation.fits import Estimates
from mavhums.health.estimation.least_squares import Fit


class BacklashDetector(EquationDetector):
    """Backlash at the output shaft; needs both angles and the load."""

    fault: ClassVar[str] = "backlash"
    quantity: ClassVar[str] = "backlash"
    unit: ClassVar[str] = "°"
    inspect: ClassVar[str] = "gear and linkage for play"
    equations: ClassVar[tuple[str, ...]] = ("gear",)

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        self.levels = Levels(actuator.known_limits().backlash_deg)

    @staticmethod
    def suits(actuator: Actuator) -> bool:
        """Return whether the profile has the actuator's constants and limits."""
        return not actuator.blanks

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the backlash; undecidable unless the load acts on both flanks."""
        fit = fits["gear"]
        half_play, half_error = fit["flank"]
        # A load on one flank only never shows the play.
        both = fit.spread & (fit.both_ways("flank", "bias") >= LEAST_FLANK_SLOTS)
        play, error = -2.0 * half_play, 2.0 * half_error
        shown = both & sharp(play, error, WIDEST_GEAR_ERROR_DEG, self.levels.normal)
        return Estimates.of(play, error, fit.freedom, shown)
