"""The surfaces that an airframe profile names, for the verdict on its axes."""

from __future__ import annotations

from typing import Final

from mavhums.actuator.profile import Actuator, Airframe
from mavhums.vehicle.signals import ALL_OUTPUTS
from mavhums.vehicle.surfaces import KINDS, Moved, Surfaces

__all__ = ["named_surface", "of_airframe"]

_OTHERS: Final = ("spoiler", "flap", "airbrake")  # named by autopilots, of no axis


def named_surface(actuator: Actuator) -> str | None:
    """Return the kind of surface that a profile names for an actuator; None if it names none.

    Examples
    --------
    >>> named_surface(Actuator(name="ruddervator_left", servo=2, pwm_us=(1000, 1500, 2000)))
    'tail'
    """
    text = f"{actuator.surface} {actuator.name}".lower().replace("_", " ").replace("ruddervator", "tail")
    return next((kind for kind in (*KINDS, *_OTHERS) if kind in text), None)


def of_airframe(airframe: Airframe) -> Surfaces | None:
    """Return the surfaces that a profile names; None if it names none that moves an axis."""
    found = []
    for actuator in airframe.actuators:
        kind = named_surface(actuator)
        if kind not in KINDS or actuator.servo > ALL_OUTPUTS:
            continue
        text = f"{actuator.surface} {actuator.name}".lower()
        side = next((side for side in ("left", "right") if side in text), "")
        low, zero, high = actuator.pwm_us
        turned = actuator.travel_deg is not None and actuator.travel_deg[0] > actuator.travel_deg[1]
        half = (low - high) / 2 if turned else (high - low) / 2
        found.append(Moved(actuator.servo, f"{side} {kind}".strip(), zero, half))
    return Surfaces(tuple(found), "profile") if found else None
