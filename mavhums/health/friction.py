"""Coulomb friction from the torque balance.

Where the shaft moves, at the output (paper, section 4):

    N·V8 - V11 = T_c·sgn(ω) + N²J·dω/dt + offset

The left side is measured; T_c, the inertia and a constant offset (torque sensor, gravity) are
fitted by least squares over a window. Where V11 is not measured, the hinge moment is fitted, too,
as proportional to the deflection V3.

The 95 % interval comes from the delete-one-slot jackknife over the window's one-second slots,
which takes the correlation of the residuals within a second as it is, and from the uncertainty of
the torque scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from mavhums.actuator.profile import Actuator
from mavhums.assessment import Interval
from mavhums.health.motion import Motion
from mavhums.quantities import column

__all__ = ["Moments", "estimate_friction", "friction_moments"]

_MIN_SLOTS = 4
_MIN_SAMPLES = 20
_MAX_CONDITION = 1e4
_REGRESSORS = 4  # sign of the speed, acceleration, offset, deflection


@dataclass(frozen=True, slots=True)
class Moments:
    """What least squares needs to know of a slot; sums over its usable samples.

    Attributes
    ----------
    count
        Number of usable samples.
    xx, xy
        Regressor products, shape (4, 4), and regressor times torque, shape (4,).
    load_measured
        Whether V11 was taken from the log; the deflection is then no regressor.
    """

    count: int
    xx: NDArray[np.float64]
    xy: NDArray[np.float64]
    load_measured: bool


def friction_moments(actuator: Actuator, motion: Motion) -> Moments:
    """Return the torque balance's moments over the moving samples of a slot."""
    values = motion.values
    ema = actuator.known_ema()
    rotor_torque = values[:, column("V8")]
    from_current = values[:, column("V5")] * ema.torque_constant
    torque = np.where(np.isfinite(rotor_torque), rotor_torque, from_current) * ema.gear_ratio
    load = values[:, column("V11")]
    load_measured = bool(np.isfinite(load).all())
    if load_measured:
        torque = torque - load
        deflection = np.zeros_like(load)
    else:
        angle, command = values[:, column("V3")], values[:, column("V1")]
        deflection = np.radians(np.where(np.isfinite(angle), angle, command))
    X = np.stack([np.sign(motion.speed), motion.acceleration, np.ones(len(torque)), deflection], axis=1)
    usable = motion.moving & np.isfinite(torque) & np.isfinite(X).all(axis=1)
    X, y = X[usable], torque[usable]
    return Moments(len(y), X.T @ X, X.T @ y, load_measured)


def estimate_friction(slots: Sequence[Moments], torque_uncertainty: float) -> Interval | None:
    """Return T_c in N·m with its 95 % interval, or None where the window cannot show it.

    It takes at least four slots with motion, motion both ways, and slots that agree on whether
    V11 is measured. An interval that lies below zero contradicts the balance: the constants are not
    this actuator's, or a sensor lies.
    """
    slots = [slot for slot in slots if slot.count > 0]
    if len(slots) < _MIN_SLOTS or sum(slot.count for slot in slots) < _MIN_SAMPLES:
        return None
    if len({slot.load_measured for slot in slots}) > 1:
        return None
    p = _REGRESSORS - slots[0].load_measured
    xx = np.stack([slot.xx[:p, :p] for slot in slots])
    xy = np.stack([slot.xy[:p] for slot in slots])
    left_out = np.concatenate([np.zeros((1, p, p)), xx]), np.concatenate([np.zeros((1, p)), xy])
    whole_xx, whole_xy = xx.sum(axis=0) - left_out[0], xy.sum(axis=0) - left_out[1]
    scale = np.sqrt(np.diagonal(whole_xx, axis1=1, axis2=2))
    if not (scale > 0).all():
        return None
    normal = whole_xx / scale[:, :, None] / scale[:, None, :]
    if np.linalg.cond(normal).max() > _MAX_CONDITION:
        return None
    solved = np.linalg.solve(normal, (whole_xy / scale)[:, :, None])[:, 0, 0] / scale[:, 0]
    friction, leave_one_out = solved[0], solved[1:]
    n = len(slots)
    error = np.sqrt((n - 1) / n * np.sum((leave_one_out - leave_one_out.mean()) ** 2))
    half = float(stdtrit(n - 1, 0.975) * error + torque_uncertainty * abs(friction))
    if friction + half < 0.0:
        return None
    return Interval(estimate=float(friction), low=float(friction) - half, high=float(friction) + half)
