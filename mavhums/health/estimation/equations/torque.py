"""The torque balance at the moving output shaft (paper, section 4), and that of single samples.

    N·k_t·V5 - V11 = T_c·sgn(ω) + N²J·dω/dt + offset + b·ω + c·V3

The left side is measured; k_t is from the data sheet. If V11 is not measured, the hinge moment is
assumed proportional to the deflection. The inertia and the viscous drag b have priors: with stepwise
commands too few samples contain the acceleration to fit it.

    N·k_t·V5 - V11 - b·ω = T_c·sgn(ω) + offset + c·V3

is the balance of single samples, for motion too brief for neighbouring samples. An autopilot's small
corrections last a tenth of a second: at 20 Hz and below, hardly any sample has neighbours in the same motion.
It omits the gear play after a reversal, where only a part of the friction acts, and the inertial torque,
which needs two neighbours. Both are small in the mean over a flight, but not in one window.
"""

from __future__ import annotations

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags
from mavhums.core.quantities import column
from mavhums.health.estimation.equations.interface import Equation
from mavhums.health.estimation.least_squares import Prior
from mavhums.health.estimation.motion import Motion
from mavhums.health.estimation.thresholds import CERTAIN_DIRECTION_MOVING_SPEEDS

_V1, _V3, _V5, _V8, _V11 = (column(key) for key in ("V1", "V3", "V5", "V8", "V11"))


def _prior(actuator: Actuator) -> Prior:
    """Return the prior of the coefficients from the data sheet."""
    ema, inertia, unknown = actuator.known_ema(), actuator.inertia_output, np.inf
    # A data sheet's uncertainty is two standard deviations.
    inertia_deviation, viscous_deviation = inertia * ema.inertia_uncertainty / 2, ema.viscous_uncertainty / 2
    return Prior(
        np.array([0.0, inertia, 0.0, ema.viscous, 0.0]),
        np.array([unknown, inertia_deviation, unknown, viscous_deviation, unknown]),
    )


def _measured(actuator: Actuator, motion: Motion) -> tuple[Array, Array]:
    """Return the torque less a measured load, N·m, and the deflection, rad, instead of an unmeasured load."""
    values, ema = motion.values, actuator.known_ema()
    current = values[:, _V5] * ema.torque_constant
    torque = np.where(np.isfinite(current), current, values[:, _V8]) * ema.gear_ratio
    load = values[:, _V11]
    loaded = np.isfinite(load)
    angle = np.where(np.isfinite(values[:, _V3]), values[:, _V3], values[:, _V1])
    return torque - np.where(loaded, load, 0.0), np.where(loaded, 0.0, np.radians(angle))


def _rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
    """Return terms (n, 5), left side (n,), N·m, and the mask of usable samples (n,)."""
    y, deflection = _measured(actuator, motion)
    terms = (np.sign(motion.speed), motion.acceleration, np.ones(len(y)), motion.speed_around, deflection)
    return np.stack(terms, axis=1), y, motion.moving & np.isfinite(y) & np.isfinite(deflection)


def _uninformative(actuator: Actuator) -> Prior:
    count = len(TORQUE_PER_SAMPLE.terms)
    return Prior(np.zeros(count), np.full(count, np.inf))


def _sample_rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
    """Return terms (n, 3), left side (n,), N·m, and the mask of usable samples (n,)."""
    left, deflection = _measured(actuator, motion)
    X = np.stack([np.sign(motion.speed), np.ones(len(left)), deflection], axis=1)
    y = left - actuator.known_ema().viscous * motion.speed
    # Slower ones may be sensor noise or have a wrong derived sign.
    least = CERTAIN_DIRECTION_MOVING_SPEEDS * np.radians(actuator.moving_speed_deg_s)
    return X, y, (np.abs(motion.speed) > least) & np.isfinite(y) & np.isfinite(deflection)


TORQUE = Equation("torque", ("friction", "inertia", "offset", "viscous", "hinge"), _prior, _rows)
TORQUE_PER_SAMPLE = Equation(
    "torque_per_sample", ("friction", "offset", "hinge"), _uninformative, _sample_rows
)
