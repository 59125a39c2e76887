"""The torque balance at the moving output shaft (paper, section 4), and that of single samples.

    N·k_t·V5 - V11 = (T_c + μ·|load|)·sgn(ω) + N²J·dω/dt + offset + b·ω + c·V3

The left side is measured; k_t is from the data sheet. If V11 is not measured, the hinge moment is
assumed proportional to the deflection; where friction grows with the load, to the sine of the angle, which
is the same for a surface and holds for an arm. The load is V11, or offset + c·V3 as the slots before show it.
Without a current that is evidence it follows from the voltage, V5 = (V4 - N·k_t·ω)/R. The inertia and the
viscous drag b have priors: with stepwise commands too few samples contain the acceleration to fit it.

    N·k_t·V5 - V11 - b·ω = (T_c + μ·|load|)·sgn(ω) + offset + c·V3

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
from mavhums.health.estimation.equations.terms import SlotLoad, friction_with_load, load_friction_prior
from mavhums.health.estimation.least_squares import Prior
from mavhums.health.estimation.motion import Motion
from mavhums.health.estimation.slots import Slots
from mavhums.health.estimation.thresholds import CERTAIN_DIRECTION_MOVING_SPEEDS

_V1, _V3, _V4, _V5, _V8, _V11 = (column(key) for key in ("V1", "V3", "V4", "V5", "V8", "V11"))


def _prior(actuator: Actuator) -> Prior:
    """Return the prior of the coefficients from the data sheet."""
    ema, inertia, unknown = actuator.known_ema(), actuator.inertia_output, np.inf
    # A data sheet's uncertainty is two standard deviations.
    inertia_deviation, viscous_deviation = inertia * ema.inertia_uncertainty / 2, ema.viscous_uncertainty / 2
    load_friction, load_deviation = load_friction_prior(ema)
    return Prior(
        np.array([0.0, inertia, 0.0, ema.viscous, 0.0, load_friction]),
        np.array([unknown, inertia_deviation, unknown, viscous_deviation, unknown, load_deviation]),
    )


def _measured(actuator: Actuator, motion: Motion) -> tuple[Array, Array]:
    """Return the torque less a measured load, N·m, and the deflection, rad, instead of an unmeasured load."""
    values, ema = motion.values, actuator.known_ema()
    current = values[:, _V5] * ema.torque_constant
    if actuator.esc_side == "motor":
        # No current is evidence: the voltage shows it, less well, with the resistance of the data sheet.
        back_emf = ema.torque_constant * ema.gear_ratio * motion.speed
        unknown = np.isnan(current) & np.isnan(values[:, _V8])
        from_voltage = (values[:, _V4] - back_emf) / ema.resistance * ema.torque_constant
        current = np.where(unknown, from_voltage, current)
    torque = np.where(np.isfinite(current), current, values[:, _V8]) * ema.gear_ratio
    load = values[:, _V11]
    loaded = np.isfinite(load)
    angle = np.where(np.isfinite(values[:, _V3]), values[:, _V3], values[:, _V1])
    deflection = np.radians(angle)
    if ema.load_friction != 0.0:
        deflection = np.sin(deflection)
    return torque - np.where(loaded, load, 0.0), np.where(loaded, 0.0, deflection)


class Load:
    """The load of an actuator, block after block, where its friction may depend on it.

    Parameters
    ----------
    actuator
        The actuator, with its constants.
    """

    def __init__(self, actuator: Actuator) -> None:
        self._actuator = actuator
        prior = _prior(actuator)
        self._slots = SlotLoad(Prior(prior.mean[:5], prior.deviation[:5]), (2, 4))
        self._sum, self._count = 0.0, 0

    @property
    def mean(self) -> float | None:
        """Mean size of the load in motion so far, N·m; None before it is known."""
        return self._sum / self._count if self._count else None

    def feed(self, slots: Slots, motion: Motion) -> Motion:
        """Return the motion with the load at its samples; NaN where it is not known yet."""
        if self._actuator.known_ema().load_friction == 0.0:
            return motion
        X, y, usable = _rows(self._actuator, motion)
        fitted = self._slots.feed(slots, np.ascontiguousarray(X[:, :5]), y, usable)
        measured = motion.values[:, _V11]
        load = np.where(np.isfinite(measured), measured, fitted)
        shown = load[motion.moving & np.isfinite(load)]
        self._sum, self._count = self._sum + float(np.abs(shown).sum()), self._count + shown.size
        return motion._replace(load=load)


def _rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
    """Return terms (n, 6), left side (n,), N·m, and the mask of usable samples (n,)."""
    y, deflection = _measured(actuator, motion)
    loaded = friction_with_load(motion.speed, motion.load)
    terms = (np.sign(motion.speed), motion.acceleration, np.ones(len(y)), motion.speed_around, deflection)
    known = np.isfinite(y) & np.isfinite(deflection) & np.isfinite(loaded)
    return np.stack([*terms, loaded], axis=1), y, motion.moving & known


def _sample_prior(actuator: Actuator) -> Prior:
    load_friction, deviation = load_friction_prior(actuator.known_ema())
    return Prior(np.array([0.0, 0.0, 0.0, load_friction]), np.array([np.inf, np.inf, np.inf, deviation]))


def _sample_rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
    """Return terms (n, 4), left side (n,), N·m, and the mask of usable samples (n,)."""
    left, deflection = _measured(actuator, motion)
    loaded = friction_with_load(motion.speed, motion.load)
    X = np.stack([np.sign(motion.speed), np.ones(len(left)), deflection, loaded], axis=1)
    y = left - actuator.known_ema().viscous * motion.speed
    # Slower ones may be sensor noise or have a wrong derived sign.
    least = CERTAIN_DIRECTION_MOVING_SPEEDS * np.radians(actuator.moving_speed_deg_s)
    return X, y, (np.abs(motion.speed) > least) & np.isfinite(y) & np.isfinite(X).all(axis=1)


TORQUE = Equation("torque", ("friction", "inertia", "offset", "viscous", "hinge", "loaded"), _prior, _rows)
TORQUE_PER_SAMPLE = Equation(
    "torque_per_sample", ("friction", "offset", "hinge", "loaded"), _sample_prior, _sample_rows
)
