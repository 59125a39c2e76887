"""Derives quantities from others and the actuator's constants (paper, section 4).

Signs of magnitudes are derived first: the sign of the speed from the command, those of current and voltage
from the voltage equation. An ESC at the supply bus gives only the motor's power.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, sqrt

import numpy as np

from mavhums.actuator.align import Aligned
from mavhums.actuator.profile import Actuator, Ema
from mavhums.core.arrays import Array, Array1, Array2, Integers, Integers1
from mavhums.core.kernels import kernel
from mavhums.core.quantities import KEYS, column
from mavhums.core.statistics import DEGREES_S_PER_REV_MIN, RAD_S_PER_REV_MIN

_V1, _V2, _V3, _V4, _V5, _V6, _V7, _V8, _V9, _V10, _V11, _V12 = (column(f"V{k}") for k in range(1, 13))
_AGREEMENT_SHARE = 0.5  # of the speed, by which it may differ from the command's rate in acceleration
_AGREEMENT_DEG_S = 5.0  # the same at low speeds; wider lets the sign of another motion in
_MAX_STEP_US = 500_000  # over which speed is integrated: over more, how the shaft turned is unknown

REPORTED = ("esc", "csrv")
"""How the tiers begin whose voltage and current an ESC or the servo measures, at the motor or at the bus."""

_OPEN = Ema.model_construct(gear_ratio=np.nan, torque_constant=np.nan, resistance=np.nan, inertia=np.nan)

_RULES: tuple[tuple[int, str, Callable[[Array, Ema], Array]], ...] = (
    (_V8, "k_t·V5", lambda v, ema: ema.torque_constant * v[:, _V5]),
    (_V6, "V4·V5", lambda v, _: v[:, _V4] * v[:, _V5]),
    (_V10, "V7/N", lambda v, ema: v[:, _V7] / ema.gear_ratio),
    (_V9, "V8·ω", lambda v, _: v[:, _V8] * v[:, _V7] * RAD_S_PER_REV_MIN),
    (_V12, "V11·ω/N", lambda v, _: v[:, _V11] * v[:, _V10] * RAD_S_PER_REV_MIN),
)


class Deriver:
    """Completes the samples of one actuator, block after block.

    Attributes
    ----------
    derived
        Derivation of each derived quantity, by key.
    dropped
        Quantities that the log carries, but that do not describe this actuator's motor.
    """

    def __init__(self, actuator: Actuator) -> None:
        self.derived: dict[str, str] = {}
        self.dropped: set[str] = set()
        self._actuator = actuator
        self._turned = np.array([np.nan, np.nan, np.nan, 0.0])
        self._at_rest, self._motion = np.zeros(4), np.zeros(5)

    def complete(self, aligned: Aligned) -> Array:
        """Return V1…V12 of shape (n, 12), including the derived values."""
        values = aligned.values.copy()
        reported = aligned.tier.startswith(REPORTED)
        if self._actuator.ema is None:
            if reported:
                self._leave_open(aligned)
            self._fill(values)
            return values
        if reported:
            if not aligned.signed:
                self._sign_speed(values, aligned.command_rate)
            if self._actuator.esc_side == "bus":
                self._from_bus(values, signed=aligned.signed)
            elif not aligned.signed:
                self._sign_current(aligned, values)
        if aligned.tier == "csrv":
            self._fill_rotor_speed(values)
        self._fill(values)
        self._integrate(aligned.utc_us, values)
        return values

    def _leave_open(self, aligned: Aligned) -> None:
        """Record which ESC readings need the EMA's constants for conversion to motor quantities."""
        if self._actuator.esc_side == "bus":
            self.derived |= {key: f"{{{key}}} at the bus" for key in ("V4", "V5")}
        if not aligned.signed:
            self.derived |= {key: f"magnitude from {{{key}}}, without its sign" for key in ("V4", "V5", "V7")}

    def _sign_speed(self, values: Array, command_rate: Array) -> None:
        """Give V7 the sign of the command's rate; NaN where the two are inconsistent."""
        speed_deg_s = values[:, _V7] * DEGREES_S_PER_REV_MIN / self._actuator.known_ema().gear_ratio
        apart = np.abs(speed_deg_s - np.abs(command_rate))
        fits = apart <= _AGREEMENT_SHARE * speed_deg_s + _AGREEMENT_DEG_S
        signed = np.where(fits & (command_rate != 0), np.sign(command_rate) * values[:, _V7], np.nan)
        values[:, _V7] = np.where(values[:, _V7] == 0, 0.0, signed)
        self.derived["V7"] = "magnitude from {V7}, sign of the command's rate"

    def _sign_current(self, aligned: Aligned, values: Array) -> None:
        """Give V5 and V4 the signs of the voltage equation; NaN where it does not show them."""
        ema, rev_min = self._actuator.known_ema(), np.ascontiguousarray(aligned.values[:, _V7])
        constants = ema.resistance, ema.torque_constant, self._actuator.moving_speed_rev_min
        _decide(aligned.utc_us, values, rev_min, constants, self._at_rest, self._motion)
        self.derived |= {key: f"magnitude from {{{key}}}, {SIGNED_BY_VOLTAGE}" for key in ("V4", "V5")}

    def _from_bus(self, values: Array, *, signed: bool) -> None:
        """Replace the bus's voltage and current by the motor's power, the only motor quantity they determine.

        R·I² + k_t·ω·I = P has two roots: a driving and a braking current.
        If the winding's voltage exceeds the back-EMF, both roots are plausible, so that
        the motor's current stays unknown.
        """
        if signed:
            values[:, _V6] = values[:, _V4] * (values[:, _V5] - self._actuator.electronics_a)
            self.derived["V6"] = "power balance of {V4} and {V5} at the bus"
        values[:, [_V4, _V5]] = np.nan
        self.dropped.update(("V4", "V5"))

    def _fill_rotor_speed(self, values: Array) -> None:
        """Fill in the rotor's speed from the shaft's, the only speed that a servo reports."""
        speed = values[:, _V10] * self._actuator.known_ema().gear_ratio
        empty = np.isnan(values[:, _V7]) & np.isfinite(speed)
        if empty.any():
            values[empty, _V7] = speed[empty]
            self.derived["V7"] = "V10·N"

    def _fill(self, values: Array) -> None:
        for target, how, rule in _RULES:
            missing = np.isnan(values[:, target])
            if not missing.any():
                continue
            result = rule(values, self._actuator.ema or _OPEN)
            empty = missing & np.isfinite(result)
            if empty.any():
                values[empty, target] = result[empty]
                self.derived[KEYS[target]] = how

    def _integrate(self, utc_us: Integers, values: Array) -> None:
        """Fill V2 with the integral of V7, which drifts, and V3 with V2."""
        ratio = self._actuator.known_ema().gear_ratio
        if _integrate(utc_us, values, ratio, self._turned):
            self.derived["V2"] = "integral of V7, drifts"
        empty = np.isnan(values[:, _V3]) & np.isfinite(values[:, _V2])
        if empty.any():
            values[empty, _V3] = values[empty, _V2] / ratio
            self.derived["V3"] = "V2/N"


@kernel
def _integrate(utc_us: Integers1, values: Array2, ratio: float, turned: Array1) -> bool:
    """Fill in V2 from the first known V7 on, and return whether anything was filled in.

    It continues from the latest V2, measured or not, but not over a gap, which hides a motion. It starts,
    and after a gap starts anew, at the command, and at zero if no command was ever known. ``turned`` keeps
    time, V7, V2, and whether a command was known, between blocks.
    """
    filled = False
    for k in range(utc_us.size):
        if utc_us[k] - turned[0] > _MAX_STEP_US:
            turned[2] = np.nan
        commanded = not np.isnan(values[k, _V1])
        turned[3] = 1.0 if commanded else turned[3]
        unknown = np.isnan(values[k, _V7])
        if np.isnan(turned[2]) and (unknown or (turned[3] > 0.0 and not commanded)):
            turned[0] = utc_us[k]
            continue
        speed = 0.0 if unknown else values[k, _V7]
        if np.isnan(values[k, _V2]):
            filled = True
            if np.isnan(turned[2]):
                values[k, _V2] = values[k, _V1] * ratio if commanded else 0.0
            else:
                step_s = (utc_us[k] - turned[0]) * 1e-6
                values[k, _V2] = turned[2] + step_s * (speed + turned[1]) / 2 * DEGREES_S_PER_REV_MIN
        turned[0], turned[1], turned[2] = utc_us[k], speed, values[k, _V2]
    return filled


SIGNED_BY_VOLTAGE = "sign from the voltage equation"
"""How a provenance ends whose magnitude the log carries and whose sign is derived here."""

_STEP_V, _STEP_A = 0.01, 0.01  # of ESC_TELEMETRY; noise of voltage and current is taken to have their ratio

_SURE = 2.5
"""Back-EMF over noise from which a sign is decided; 0.6 % of the signs are wrong there. At 2 the friction is
1 % too small in the mean; at 3 a third more actuators in little motion stay undecided."""
_LASTING_S = 0.1
"""How long the current keeps its sign in one motion. With 0.2 s a third fewer actuators stay undecided, but
a healthy actuator brakes between the steps of its command, and its interval misses the truth more often."""
_AT_REST = 0.2  # times the moving speed: an ESC's speed noise at standstill
_LOADED = 3.0  # steps of the current: less is noise, whose ratio to the voltage is no resistance
_RESISTANCE_DEVIATION = 0.2  # of the data sheet's: temperature, wear and individuals
_PRIOR_SAMPLES = 20.0  # weight of the assumption that the noise is one step of the current
_LEAST_NOISE = 12**-0.5  # standard deviation of rounding, in steps of the current
_MISFIT_V = 0.5  # sampling and quantisation
_MISFIT_SHARE = 0.3  # an aged winding or magnet


@kernel
def _winding(at_rest: Array1, nominal: float) -> tuple[float, float]:
    """Return resistance, Ω, and variance of |U| − R·|I|, V², from samples at standstill.

    The line through the origin has errors in both variables (W. E. Deming, "Statistical Adjustment of
    Data", 1943).

    Parameters
    ----------
    at_rest
        Number of samples, and sums of U², U·I and I², shape (4,).
    nominal
        Resistance of the data sheet, Ω.
    """
    count, volts, both, amperes = at_rest
    step = (nominal * _STEP_A) ** 2
    if both <= 0.0:
        return nominal, step
    ratio = (_STEP_V / _STEP_A) ** 2
    apart = volts - ratio * amperes
    seen = (apart + sqrt(apart * apart + 4.0 * ratio * both * both)) / (2.0 * both)
    residual = max(volts - 2.0 * seen * both + seen * seen * amperes, 0.0)
    variance = max((_PRIOR_SAMPLES * step + residual) / (_PRIOR_SAMPLES + count), step * _LEAST_NOISE**2)
    weight = amperes / (amperes + variance / (_RESISTANCE_DEVIATION * nominal) ** 2)
    return nominal + weight * (seen - nominal), variance


@kernel
def _decide(
    utc_us: Integers1,
    values: Array2,
    rev_min: Array1,
    constants: tuple[float, float, float],
    at_rest: Array1,
    motion: Array1,
) -> None:
    """Set the signs sample by sample; ``at_rest`` and ``motion`` are kept between blocks.

    ``motion`` holds, of the latest motion one way, its last time and direction, the log-odds of a driving
    current, its expectation (in units of a certain sign), and its variance.
    """
    nominal, torque_constant, moving = constants
    for k in range(utc_us.size):
        volts, amperes, speed = values[k, _V4], values[k, _V5], values[k, _V7]
        values[k, _V4] = values[k, _V5] = np.nan
        if np.isnan(volts) or np.isnan(amperes):
            continue
        resistance, variance = _winding(at_rest, nominal)
        if rev_min[k] <= _AT_REST * moving and volts > _LOADED * _STEP_A * nominal:
            at_rest[0] += 1.0
            at_rest[1] += volts * volts
            at_rest[2] += volts * amperes
            at_rest[3] += amperes * amperes
        if not abs(speed) > moving:
            continue
        drop, back_emf = resistance * amperes, torque_constant * abs(speed) * RAD_S_PER_REV_MIN
        driving = abs(volts - (back_emf + drop))
        opposing = abs(volts - abs(back_emf - drop))
        if min(driving, opposing) > _MISFIT_V + _MISFIT_SHARE * max(back_emf, drop):
            continue
        way = 1.0 if speed > 0 else -1.0
        information = back_emf * back_emf / variance
        fading = exp((motion[0] - utc_us[k]) * 1e-6 / _LASTING_S)
        if way != motion[1] or information > _SURE**2:
            fading = 0.0  # another motion, or a sample that needs no other
        motion[0], motion[1] = utc_us[k], way
        motion[2] = fading * motion[2] + (opposing * opposing - driving * driving) / variance
        motion[3] = fading * motion[3] + information
        motion[4] = fading * fading * motion[4] + information
        if motion[3] <= _SURE * sqrt(motion[4]):
            continue
        current = way * amperes if motion[2] > 0 else -way * amperes
        values[k, _V5] = current
        values[k, _V4] = volts * np.sign(resistance * current + torque_constant * speed * RAD_S_PER_REV_MIN)
