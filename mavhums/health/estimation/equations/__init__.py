"""The equations of an actuator's samples; detectors read their coefficients.

:data:`EQUATIONS` need the constants of a data sheet, :data:`OWN_EQUATIONS` none. A test holds both against
the modules of this folder.
"""

from __future__ import annotations

from mavhums.health.estimation.equations import gear, own_scale, torque, voltage
from mavhums.health.estimation.equations.interface import Equation, OwnEquation

EQUATIONS: tuple[Equation, ...] = (
    gear.GEAR,
    torque.TORQUE,
    torque.TORQUE_PER_SAMPLE,
    voltage.VOLTAGE,
    voltage.SUPPLY,
)

OWN_EQUATIONS: tuple[OwnEquation, ...] = (
    own_scale.CURRENT,
    own_scale.VOLTAGE,
    own_scale.POWER,
    own_scale.TRACKING,
)
"""The most informative first: the first one of which a flight has a record is compared."""

STROKE_EQUATIONS: tuple[OwnEquation, ...] = (own_scale.TWO_WAYS, own_scale.ROUGHNESS, own_scale.RIPPLE)
"""Of strokes at constant commanded speed: indicators beside the others."""
