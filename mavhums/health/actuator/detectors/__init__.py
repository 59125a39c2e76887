"""Detectors of an actuator's faults; a test holds :data:`DETECTORS` against the modules of this folder."""

from __future__ import annotations

from mavhums.actuator.profile import Actuator
from mavhums.health.actuator.detector import Detector
from mavhums.health.actuator.detectors.electrical import (
    SupplySagDetector,
    TorqueConstantDetector,
    WindingResistanceDetector,
)
from mavhums.health.actuator.detectors.following import FollowingDetector, JamDetector
from mavhums.health.actuator.detectors.friction import FrictionDetector
from mavhums.health.actuator.detectors.gear import BacklashDetector, SensorBiasDetector
from mavhums.health.estimation.equations import OWN_EQUATIONS, STROKE_EQUATIONS

DETECTORS: tuple[type[Detector], ...] = (
    BacklashDetector,
    FollowingDetector,
    FrictionDetector,
    JamDetector,
    SensorBiasDetector,
    SupplySagDetector,
    TorqueConstantDetector,
    WindingResistanceDetector,
)


def to_inspect(fault: str) -> str | None:
    """Return the parts to inspect for a fault of an actuator; None if nothing covers it.

    Examples
    --------
    >>> to_inspect("backlash"), to_inspect("friction_current")
    ('gear and linkage for play', 'gearbox, bearings and hinge line')
    """
    parts = {each.fault: each.inspect for each in DETECTORS}
    parts |= {each.fault: each.inspect for each in (*OWN_EQUATIONS, *STROKE_EQUATIONS)}
    return parts.get(fault)


def detectors_for(actuator: Actuator) -> list[Detector]:
    """Return the detectors of all faults that are detectable with this actuator's profile.

    Examples
    --------
    >>> from mavhums.actuator.profile import load_airframe
    >>> [detector.fault for detector in detectors_for(load_airframe("paper").actuators[0])][:3]
    ['backlash', 'following', 'friction']
    """
    return [detector(actuator) for detector in DETECTORS if detector.suits(actuator)]
