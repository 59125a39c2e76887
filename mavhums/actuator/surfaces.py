"""The surfaces that an airframe profile names, for the verdict on its axes."""

from __future__ import annotations

from mavhums.actuator.profile import Airframe
from mavhums.vehicle.signals import ALL_OUTPUTS
from mavhums.vehicle.surfaces import KINDS, Moved, Surfaces

__all__ = ["of_airframe"]


def of_airframe(airframe: Airframe) -> Surfaces | None:
    """Return the surfaces that a profile names; None if it names none that moves an axis."""
    found = []
    for actuator in airframe.actuators:
        text = f"{actuator.surface} {actuator.name}".lower().replace("_", " ").replace("vtail", "tail")
        kind = next((kind for kind in KINDS if kind in text), None)
        if kind is None or actuator.servo > ALL_OUTPUTS:
            continue
        side = next((side for side in ("left", "right") if side in text), "")
        low, zero, high = actuator.pwm_us
        turned = actuator.travel_deg is not None and actuator.travel_deg[0] > actuator.travel_deg[1]
        half = (low - high) / 2 if turned else (high - low) / 2
        found.append(Moved(actuator.servo, f"{side} {kind}".strip(), zero, half))
    return Surfaces(tuple(found), "profile") if found else None
