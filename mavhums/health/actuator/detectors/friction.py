"""Coulomb friction of motor, gear and bearings, from the torque balance.

The balance takes the data sheet's torque constant; the friction is that of the torque constant that the
voltage equation shows over the flight so far, as far as it shows one, else of the profile's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags
from mavhums.core.statistics import ERRORS_95
from mavhums.health.actuator.detector import Detector, EquationDetector
from mavhums.health.actuator.detectors.electrical import contradicts, relative_constant
from mavhums.health.actuator.thresholds import MODEL_ERROR_LIMIT_SHARE
from mavhums.health.decision.limits import Estimates, Levels, half_width, tail_of
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.estimation.least_squares import Fit
from mavhums.health.estimation.thresholds import LEAST_SAMPLES, MOST_LOAD_FRICTION
from mavhums.results.reasons import Reason


class FrictionDetector(EquationDetector):
    """Coulomb friction at the output shaft, against the profile's limits."""

    fault: ClassVar[str] = "friction"
    quantity: ClassVar[str] = "Coulomb friction"
    unit: ClassVar[str] = "N·m"
    inspect: ClassVar[str] = "gearbox, bearings and hinge line"
    equations: ClassVar[tuple[str, ...]] = ("torque", "torque_per_sample", "voltage")
    needs_limits: ClassVar[bool] = True

    def __init__(self, actuator: Actuator) -> None:
        super().__init__(actuator)
        limits = actuator.known_limits()
        self.levels = Levels(limits.normal, limits.emergency)
        self._normal, self._widest = limits.normal, limits.emergency - limits.normal

    def overall(self, flight: Mapping[str, Fit]) -> Estimates:
        """Return the friction over the whole flight; effects outside the balance do not average out."""
        return self._widened(self.read(flight, flight))

    def conclusion(self, flight: Mapping[str, Fit]) -> Estimates:
        """Return the friction over the whole flight, from lasting motion or from single samples.

        The one with the smaller error is used; in calm air the autopilot moves only briefly.
        """
        tail = tail_of(FALSE_ALARMS)
        lasting, sampled = self.overall(flight), self._per_sample(flight)
        shows_less = half_width(lasting, tail=tail) > half_width(sampled, tail=tail)
        # The one with the smaller error decides; ties go to lasting motion, which leaves nothing out.
        return sampled if np.isnan(lasting.value[0]) or shows_less[0] else lasting

    def _per_sample(self, flight: Mapping[str, Fit]) -> Estimates:
        """Return the friction from single samples; NaN if their balance does not hold.

        A rotor that winds up its gear against a jammed shaft also moves, but most torque is unexplained.
        """
        fit = flight["torque_per_sample"]
        # A rotor that winds up its gear against a jammed shaft moves, too, but most of its torque is
        # unexplained.
        holds = fit.variance < self.actuator.known_limits().emergency ** 2
        return Estimates.of(*self._widened(self._scaled(fit, flight)), holds)

    def read(self, fits: Mapping[str, Fit], flight: Mapping[str, Fit]) -> Estimates:
        """Return the friction; undecidable without motion both ways in several slots.

        Its 95 % interval is narrower than what lies between the limits or, of a grave friction, which
        scatters more, than what lies between it and the normal limit.

        An estimate well below zero contradicts the balance: the constants are not this actuator's, or a
        sensor lies. So does one that is surely next to nothing, as of a current that does not change.
        """
        return self._scaled(fits["torque"], flight)

    def _widened(self, mean: Estimates) -> Estimates:
        left_out = MODEL_ERROR_LIMIT_SHARE * self.actuator.known_limits().normal
        return mean._replace(error=np.hypot(mean.error, left_out))

    def _scaled(self, fit: Fit, flight: Mapping[str, Fit]) -> Estimates:
        """Return the friction of a torque balance with the torque constant that the flight shows."""
        scale, scale_error = relative_constant(
            flight["voltage"], self.actuator.known_ema(), turned=self.turned
        )
        friction, error = fit["friction"]
        whole_error = np.hypot(error * scale, friction * scale_error)
        shown = fit.spread & (fit.count >= LEAST_SAMPLES)
        # The interval must be able to separate the limits; a grave friction scatters more and is above
        # either.
        shown &= 2 * ERRORS_95 * whole_error < np.maximum(self._widest, friction * scale - self._normal)
        # Well below zero: the constants are not this actuator's, or a sensor lies.
        shown &= friction > -ERRORS_95 * error
        shown &= (
            friction + ERRORS_95 * error
        ) * scale > MODEL_ERROR_LIMIT_SHARE * self.actuator.known_limits().normal
        shown &= ~self._by_load(fit, scale, whole_error)
        return Estimates.of(friction * scale, whole_error, fit.freedom, shown)

    def _by_load(self, fit: Fit, scale: Array, error: Array) -> Flags:
        """Return whether a friction may be an emergency only because its part by load is unknown."""
        emergency = self.actuator.known_limits().emergency
        if self.actuator.known_ema().load_friction is not None:
            return np.zeros(scale.shape, dtype=np.bool_)
        least = fit.given("friction", "loaded", MOST_LOAD_FRICTION) * scale
        may_be: Flags = fit["friction"].value * scale + ERRORS_95 * error >= emergency
        return may_be & (least + ERRORS_95 * error < emergency)


def why_no_friction(
    detector: Detector | None, flight: Mapping[str, Fit], *, moving: int, samples: int, rate_hz: float
) -> Reason | None:
    """Return the reason if a whole flight shows no friction; None if it does, or without a detector.

    Parameters
    ----------
    detector
        That of friction.
    flight
        Fits of the whole flight.
    moving, samples
        Numbers of samples in motion, and of all.
    rate_hz
        Samples per second.
    """
    if not isinstance(detector, FrictionDetector) or not flight:
        return None
    if np.isfinite(detector.conclusion(flight).value[0]):
        return None
    fit, actuator = flight["torque"], detector.actuator
    # In the order of what can be done: first the recording, then the flight, then the profile.
    if rate_hz < actuator.min_rate_hz:
        return Reason("telemetry_too_slow", rate_hz=rate_hz, needed_hz=actuator.min_rate_hz)
    if fit.count[0] < LEAST_SAMPLES or not fit.spread[0]:
        return _too_few(int(fit.count[0]), moving, samples)
    return _contradiction(detector, flight) or _too_wide(detector, flight)


def _too_few(usable: int, moving: int, samples: int) -> Reason:
    percent = 100 * moving / max(samples, 1)
    # It moves, but most of its samples have no current of known sign.
    if moving >= LEAST_SAMPLES and usable < moving / 2:
        return Reason("unsigned_current", percent=percent, usable=usable)
    return Reason("still", percent=percent)


def _contradiction(detector: FrictionDetector, flight: Mapping[str, Fit]) -> Reason | None:
    """Return what contradicts the torque balance, if anything does."""
    ema, limits = detector.actuator.known_ema(), detector.actuator.known_limits()
    contradicted, constant = contradicts(flight["voltage"], ema, turned=detector.turned)
    if contradicted[0]:
        return Reason("other_constant", percent=100 * constant[0])
    friction, error = (float(column[0]) for column in flight["torque"]["friction"])
    if friction <= -ERRORS_95 * error:
        return Reason("negative_friction", friction=friction)
    if friction + ERRORS_95 * error <= MODEL_ERROR_LIMIT_SHARE * limits.normal:
        return Reason("no_friction")
    return None


def _too_wide(detector: FrictionDetector, flight: Mapping[str, Fit]) -> Reason:
    fit, limits = flight["torque"], detector.actuator.known_limits()
    if detector.actuator.known_ema().load_friction is None and fit["friction"].value[0] > limits.normal:
        return Reason("load_friction", friction=fit["friction"].value[0])
    if not fit.both_ways("friction", "offset")[0]:
        return Reason("one_way")
    error = float(fit["friction"].std_error[0])
    apart = limits.emergency - limits.normal
    return Reason("friction_uncertain", error=ERRORS_95 * error, apart=apart)
