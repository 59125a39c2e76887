"""The reason why a flight shows no friction: the first condition of the estimate that does not hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mavhums.health.detector import Detector
from mavhums.health.detectors.actuator.friction import CONTRADICTION, FRICTIONLESS, MIN_SAMPLES
from mavhums.health.detectors.actuator.friction import Detector as Friction
from mavhums.health.detectors.actuator.torque_constant import contradicts
from mavhums.health.least_squares import Fit

__all__ = ["why_no_friction"]

_MOVE_IT = "analyse a flight in which the surface moves, or sweep it before take-off"
_CHECK = "check torque_constant and gear_ratio of the profile, and the units and signs of V4, V5, V7 and V11"


def why_no_friction(
    detector: Detector | None, flight: Mapping[str, Fit], *, moving: int, samples: int, rate_hz: float
) -> tuple[str, str] | None:
    """Return reason and remedy if a whole flight shows no friction; None if it does, or without a detector.

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
    if not isinstance(detector, Friction) or not flight:
        return None
    if np.isfinite(detector.conclusion(flight).value[0]):
        return None
    fit, actuator = flight["torque"], detector.actuator
    if rate_hz < actuator.min_rate_hz:
        reason = f"its telemetry comes at {rate_hz:.1f} Hz, less than the profile's min_rate_hz of "
        return f"{reason}{actuator.min_rate_hz:g}", "record its telemetry faster"
    if fit.count[0] < MIN_SAMPLES or not fit.spread[0]:
        return _too_few(int(fit.count[0]), moving, samples)
    return _contradiction(detector, flight) or _too_wide(detector, flight)


def _too_few(usable: int, moving: int, samples: int) -> tuple[str, str]:
    share = f"{100 * moving / max(samples, 1):.0f} %"
    if moving >= MIN_SAMPLES and usable < moving / 2:
        return (
            f"it moves in {share} of the samples, but only {usable} of these have a current of known sign",
            "record current and speed together, with their signs",
        )
    return f"the actuator moves in {share} of the samples, too little to show friction", _MOVE_IT


def _contradiction(detector: Friction, flight: Mapping[str, Fit]) -> tuple[str, str] | None:
    """Return what contradicts the torque balance, if anything does."""
    ema, limits = detector.actuator.known_ema(), detector.actuator.known_limits()
    contradicted, constant = contradicts(flight["voltage"], ema, turned=detector.turned)
    if contradicted[0]:
        share = f"the back-EMF shows {100 * constant[0]:.0f} % of the profile's torque constant"
        return f"{share}, so the current does not tell the torque", _CHECK
    friction, error = (float(column[0]) for column in flight["torque"]["friction"])
    if friction <= -CONTRADICTION * error:
        return f"the torque balance comes to a friction of {friction:.3g} N·m, below zero", _CHECK
    if friction + 2 * error <= FRICTIONLESS * limits.normal:
        return (
            "the torque balance comes to no friction at all: the current does not follow the motion",
            _CHECK,
        )
    return None


def _too_wide(detector: Friction, flight: Mapping[str, Fit]) -> tuple[str, str]:
    fit, limits = flight["torque"], detector.actuator.known_limits()
    if not fit.both_ways("friction", "offset")[0]:
        return "the actuator moves one way only, which does not tell friction from load", _MOVE_IT
    error = float(fit["friction"].std_error[0])
    return (
        f"it moves too little both ways: its friction is known to ± {2 * error:.2g} N·m, "
        f"and its limits are {limits.emergency - limits.normal:.2g} N·m apart",
        _MOVE_IT,
    )
