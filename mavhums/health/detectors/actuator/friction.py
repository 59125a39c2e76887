"""Coulomb friction of motor, gear and bearings, from the torque balance.

The balance takes the data sheet's torque constant; the friction is that of the torque constant that the
voltage equation shows over the flight so far, as far as it shows one, else of the profile's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.health.decision import FALSE_ALARMS, half_width, tail_of
from mavhums.health.detector import EquationDetector, Estimates, Levels
from mavhums.health.detectors.actuator.torque_constant import relative_constant
from mavhums.health.least_squares import Fit

__all__ = ["CONTRADICTION", "FRICTIONLESS", "MIN_SAMPLES", "Detector"]

MIN_SAMPLES = 20
CONTRADICTION = 3.0  # standard errors below zero
_BRIEF_ERROR = 0.05  # what motion in single samples leaves out; share of the friction
FRICTIONLESS = 0.01  # of the normal limit: no gear turns with less
_MODEL_ERROR = 0.02  # play, wind-up and stick-slip, which the balance leaves out; share of the normal limit


class Detector(EquationDetector):
    """Coulomb friction at the output shaft, against the profile's limits."""

    fault: ClassVar[str] = "friction"
    quantity: ClassVar[str] = "Coulomb friction"
    unit: ClassVar[str] = "N·m"
    inspect: ClassVar[str] = "gearbox, bearings and hinge line"
    equations: ClassVar[tuple[str, ...]] = ("torque", "brief", "voltage")

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        limits = actuator.known_limits()
        self.levels = Levels(limits.normal, limits.emergency)
        self._normal, self._widest = limits.normal, limits.emergency - limits.normal

    @staticmethod
    def suits(actuator: Actuator) -> bool:
        """Return whether the profile has the actuator's constants and limits."""
        return not actuator.blanks

    def overall(self, flight: Mapping[str, Fit]) -> Estimates:
        """Return the friction over the whole flight; effects outside the balance do not average out."""
        return self._widened(self.read(flight, flight), 0.0)

    def conclusion(self, flight: Mapping[str, Fit]) -> Estimates:
        """Return the friction over the whole flight, from lasting motion or from single samples.

        The one with the smaller error is used; in calm air the autopilot moves only briefly.
        """
        tail = tail_of(FALSE_ALARMS)
        lasting, brief = self.overall(flight), self._brief(flight)
        shows_less = half_width(lasting, tail=tail) > half_width(brief, tail=tail)
        return brief if np.isnan(lasting.value[0]) or shows_less[0] else lasting

    def _brief(self, flight: Mapping[str, Fit]) -> Estimates:
        """Return the friction from single samples; NaN if their balance does not hold.

        A rotor that winds up its gear against a jammed shaft also moves, but most torque is unexplained.
        """
        fit = flight["brief"]
        mean = self._widened(self._scaled(fit, flight), _BRIEF_ERROR)
        holds = fit.variance < self.actuator.known_limits().emergency ** 2
        return Estimates.of(mean.value, mean.error, mean.freedom, holds)

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the friction; undecidable without motion both ways in several slots.

        Its 95 % interval is narrower than what lies between the limits or, of a grave friction, which
        scatters more, than what lies between it and the normal limit.

        An estimate well below zero contradicts the balance: the constants are not this actuator's, or a
        sensor lies. So does one that is surely next to nothing, as a current has that stands still.
        """
        return self._scaled(fits["torque"], flight)

    def _widened(self, mean: Estimates, share: float) -> Estimates:
        left_out = np.hypot(share * mean.value, _MODEL_ERROR * self.actuator.known_limits().normal)
        return Estimates(mean.value, np.hypot(mean.error, left_out), mean.freedom)

    def _scaled(self, fit: Fit, flight: Mapping[str, Fit]) -> Estimates:
        """Return the friction of a torque balance with the torque constant that the flight shows."""
        scale, scale_error = relative_constant(
            flight["voltage"], self.actuator.known_ema(), turned=self.turned
        )
        friction, error = fit["friction"]
        whole_error = np.hypot(error * scale, friction * scale_error)
        shown = fit.spread & (fit.count >= MIN_SAMPLES)
        shown &= 2 * 2 * whole_error < np.maximum(self._widest, friction * scale - self._normal)
        shown &= friction > -CONTRADICTION * error
        shown &= (friction + 2 * error) * scale > FRICTIONLESS * self.actuator.known_limits().normal
        return Estimates.of(friction * scale, whole_error, fit.freedom, shown)
