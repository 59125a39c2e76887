"""The equations that need the constants of a data sheet (paper, section 4).

The torque balance at the moving output shaft, and that of single samples:

    N·k_t·V5 - V11 = (T_c + μ·|load|)·sgn(ω) + N²J·dω/dt + offset + b·ω + c·V3
    N·k_t·V5 - V11 - b·ω = (T_c + μ·|load|)·sgn(ω) + offset + c·V3

The left side is measured; k_t is from the data sheet. If V11 is not measured, the hinge moment is
assumed proportional to the deflection; where friction grows with the load, to the sine of the angle, which
is the same for a surface and holds for an arm. The load is V11, or offset + c·V3 as the slots before show it.
Without a current that is evidence it follows from the voltage, V5 = (V4 - N·k_t·ω)/R. The inertia and the
viscous drag b have priors: with stepwise commands too few samples contain the acceleration to fit it.

The balance of single samples is for motion too brief for neighbouring samples. An autopilot's small
corrections last a tenth of a second: at 20 Hz and below, hardly any sample has neighbours in the same motion.
It omits the gear play after a reversal, where only a part of the friction acts, and the inertial torque,
which needs two neighbours. Both are small in the mean over a flight, but not in one window.

The voltage of the stator winding, without inductance, in motion or at rest:

    V4 = R·V5 + N·k_e·ω + offset

In SI units the back-EMF constant k_e is the torque constant k_t. Telemetry without signs shows the resistance
where the shaft is at rest: |V4| = R·|V5|, whatever the signs. Because their sign is unknown, these samples
do not show the offset. The voltage of the supply is a constant, for an ESC that measures at the bus.

Backlash and wind-up of the gear, from measured angles of rotor and output shaft:

    V3 - V2/N = -β/2·sgn(T) - T/k - f·sgn(ω) + bias

T is the load V11, β the backlash, k the stiffness; f is the wind-up by the friction of the output bearings,
between zero and the wind-up by the whole normal friction. With a small load that assists the motion the teeth
may be on either flank; with a load that opposes it the flank is certain.
"""

from __future__ import annotations

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array, Flags
from mavhums.core.quantities import column
from mavhums.core.statistics import uniform_deviation
from mavhums.health.estimation.equations.interface import (
    Equation,
    SlotLoad,
    friction_with_load,
    load_friction_prior,
)
from mavhums.health.estimation.least_squares import Prior
from mavhums.health.estimation.motion import Motion
from mavhums.health.estimation.slots import Slots
from mavhums.health.estimation.thresholds import (
    BACK_EMF_PRIOR_SHARE,
    LOADED_AT_STANDSTILL_A,
    RESISTANCE_PRIOR_SHARE,
)

_V1, _V2, _V3, _V4, _V5, _V8, _V11 = (column(f"V{k}") for k in (1, 2, 3, 4, 5, 8, 11))


def _torque_prior(actuator: Actuator) -> Prior:
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
        prior = _torque_prior(actuator)
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
        X, y, usable = _torque_rows(self._actuator, motion)
        fitted = self._slots.feed(slots, np.ascontiguousarray(X[:, :5]), y, usable)
        measured = motion.values[:, _V11]
        load = np.where(np.isfinite(measured), measured, fitted)
        shown = load[motion.moving & np.isfinite(load)]
        self._sum, self._count = self._sum + float(np.abs(shown).sum()), self._count + shown.size
        return motion._replace(load=load)


def _torque_rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
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
    moves = np.abs(motion.speed) > np.radians(actuator.moving_speed_deg_s)
    return X, y, moves & np.isfinite(y) & np.isfinite(X).all(axis=1)


TORQUE = Equation(
    "torque", ("friction", "inertia", "offset", "viscous", "hinge", "loaded"), _torque_prior, _torque_rows
)
TORQUE_PER_SAMPLE = Equation(
    "torque_per_sample", ("friction", "offset", "hinge", "loaded"), _sample_prior, _sample_rows
)


def _voltage_prior(actuator: Actuator) -> Prior:
    """Return a wide prior from the data sheet, because a fault may have changed the coefficients."""
    ema = actuator.known_ema()
    constant = ema.torque_constant * ema.gear_ratio
    return Prior(
        np.array([ema.resistance, constant, 0.0]),
        np.array([ema.resistance * RESISTANCE_PRIOR_SHARE, constant * BACK_EMF_PRIOR_SHARE, np.inf]),
    )


def _voltage_rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
    """Return terms (n, 3), left side (n,), V, and the mask of usable samples (n,)."""
    current, volts = motion.values[:, _V5], motion.values[:, _V4]
    X = np.stack([current, motion.speed, np.ones(len(volts))], axis=1)
    usable = np.isfinite(X).all(axis=1) & np.isfinite(volts)
    unsigned_v, unsigned_a, rev_min = motion.magnitudes.T
    at_rest = ~usable & (rev_min <= actuator.moving_speed_rev_min)
    # The magnitude of a small current is noise, which would read as resistance.
    at_rest &= unsigned_v > LOADED_AT_STANDSTILL_A * actuator.known_ema().resistance
    X[at_rest] = 0.0
    X[at_rest, 0] = unsigned_a[at_rest]
    return X, np.where(at_rest, unsigned_v, volts), usable | (at_rest & np.isfinite(unsigned_a))


def _supply_prior(actuator: Actuator) -> Prior:
    return Prior(np.zeros(1), np.full(1, np.inf))


def _supply_rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
    """Return terms (n, 1), left side (n,), V, and the mask of usable samples (n,)."""
    # A voltage at the motor is the controller's. It is the supply's where a shaft lags its command as far as
    # a healthy one does at full speed, and is slow: at full speed it needs no more voltage, however far the
    # command is. It moves: of a jammed one the controller may limit the current.
    slew_deg_s = actuator.slew_deg_s or np.inf
    lags = np.abs(motion.behind) >= slew_deg_s * actuator.response_lag_s
    slow = np.degrees(np.abs(motion.speed)) < slew_deg_s / 2
    asked = motion.moving & lags & slow & (actuator.esc_side == "motor")
    at_motor = np.where(asked, np.abs(motion.values[:, _V4]), np.nan)
    volts = np.where(np.isfinite(motion.bus_v), motion.bus_v, at_motor)
    return np.ones((len(volts), 1)), volts, np.isfinite(volts)


VOLTAGE = Equation("voltage", ("resistance", "back_emf", "offset"), _voltage_prior, _voltage_rows)
SUPPLY = Equation("supply", ("voltage",), _supply_prior, _supply_rows)


def _gear_prior(actuator: Actuator) -> Prior:
    """Return the prior of backlash and wind-up: between zero and their largest plausible values.

    Backlash is at most twice its limit, half of it on either flank; wind-up by friction is at most that of
    the normal friction, wind-up by load at most twice the data sheet's, which so is its mean.
    """
    limits, stiffness = actuator.known_limits(), actuator.known_ema().stiffness
    flank = _up_to(-limits.backlash_deg if limits.backlash_deg else None)
    drag = _up_to(-np.degrees(limits.normal / stiffness) if stiffness else None)
    # Without a bound on the twist, grave play under a small load would read as twist.
    twist = _up_to(-2.0 * np.degrees(1.0 / stiffness) if stiffness else None)
    known = (flank, twist, drag, _up_to(None))
    return Prior(np.array([mean for mean, _ in known]), np.array([deviation for _, deviation in known]))


def _up_to(most: float | None) -> tuple[float, float]:
    """Return mean and deviation for a value between zero and ``most``; None means unbounded."""
    return (0.0, np.inf) if most is None else (most / 2, uniform_deviation(abs(most)))


def _gear_rows(actuator: Actuator, motion: Motion) -> tuple[Array, Array, Flags]:
    """Return terms (n, 4), left side (n,), °, and the mask of usable samples (n,)."""
    values, load = motion.values, motion.values[:, _V11]
    angle = values[:, _V3] - values[:, _V2] / actuator.known_ema().gear_ratio
    X = np.stack([np.sign(load), load, np.sign(motion.speed), np.ones(len(load))], axis=1)
    # The flank is certain under a load that friction cannot hold up, or that opposes the motion.
    flank = (np.abs(load) > actuator.known_limits().normal) | (load * motion.speed > 0)
    return X, angle, motion.moving & motion.apart & flank & np.isfinite(angle)


GEAR = Equation("gear", ("flank", "twist", "drag", "bias"), _gear_prior, _gear_rows)
