"""Signs of a motor's current and voltage, for telemetry that gives only their magnitudes.

The voltage equation |U| = |R·I + k_t·ω| distinguishes a driving current (along ω) from an opposing one by
twice the back-EMF E = k_t·|ω|, or by twice R·|I| if that is smaller. Near standstill this is less than the
noise of the measured voltage and current, and the smaller misfit is a guess. Friction makes most currents
drive, so that wrong guesses make the mean current too small, and the friction with it. A resistance that
differs from the data sheet's, as a warm winding's does, makes the guesses of a whole flight wrong one way.

Resistance and noise are therefore measured where the shaft stands and |U| = R·|I|. A sign is decided only
where the back-EMF exceeds the noise several times, by itself or together with the latest samples of the same
motion; the other currents stay unknown. Which ones do depends on the speed alone: a selection by the
current would bias the friction.
"""

from __future__ import annotations

from math import exp, sqrt

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array
from mavhums.core.kernels import kernel
from mavhums.core.quantities import column
from mavhums.core.statistics import RAD_S_PER_REV_MIN

__all__ = ["SIGNED_BY_VOLTAGE", "CurrentSigns"]

SIGNED_BY_VOLTAGE = "sign from the voltage equation"
"""How a provenance ends whose magnitude the log carries and whose sign is derived here."""

_V4, _V5, _V7 = column("V4"), column("V5"), column("V7")
_STEP_V, _STEP_A = 0.01, 0.01  # of ESC_TELEMETRY; noise of voltage and current is taken to have their ratio

_SURE = 2.5
"""Back-EMF over noise from which a sign is decided; 0.6 % of the signs are wrong there. At 2 the friction is
1 % too small in the mean; at 3 a third more actuators in little motion stay undecided."""
_LASTING_S = 0.1
"""How long the current keeps its sign in one motion. With 0.2 s a third fewer actuators stay undecided, but
a healthy actuator brakes between the steps of its command, and its interval misses the truth more often."""
_STANDING = 0.2  # times the moving speed: an ESC's speed noise at standstill
_LOADED = 3.0  # steps of the current: less is noise, whose ratio to the voltage is no resistance
_RESISTANCE_DEVIATION = 0.2  # of the data sheet's: temperature, wear and individuals
_PRIOR_SAMPLES = 20.0  # weight of the assumption that the noise is one step of the current
_LEAST_NOISE = 12**-0.5  # standard deviation of rounding, in steps of the current
_MISFIT_V = 0.5  # sampling and quantisation
_MISFIT_SHARE = 0.3  # an aged winding or magnet


class CurrentSigns:
    """Gives the magnitudes of one actuator's current and voltage their signs, block after block.

    Parameters
    ----------
    actuator
        The actuator, with its constants.

    Attributes
    ----------
    resistance, noise
        As the samples at standstill show them so far, each weighted with a prior: the data sheet's
        resistance, and one step of the current's resolution.
    """

    def __init__(self, actuator: Actuator) -> None:
        ema = actuator.known_ema()
        self._ema = ema
        self._moving = actuator.moving_speed_rev_min
        self._standing = np.zeros(4)
        self._motion = np.zeros(5)

    @property
    def resistance(self) -> float:
        """Resistance of the winding, Ω."""
        return _winding(self._standing, self._ema.resistance)[0]

    @property
    def noise(self) -> float:
        """Standard deviation of |U| − R·|I|, V."""
        return sqrt(_winding(self._standing, self._ema.resistance)[1])

    def complete(self, utc_us: NDArray[np.int64], values: Array, rev_min: Array) -> None:
        """Set the signs of V4 and V5 in V1…V12 of shape (n, 12), in place; NaN where they stay unknown.

        Parameters
        ----------
        utc_us
            Times, shape (n,).
        values
            V4 and V5 are magnitudes; V7 is signed, or NaN where its sign is unknown.
        rev_min
            Magnitude of V7, shape (n,).
        """
        constants = self._ema.resistance, self._ema.torque_constant, self._moving
        _decide(utc_us, values, rev_min, constants, self._standing, self._motion)


@kernel
def _winding(standing: Array, nominal: float) -> tuple[float, float]:
    """Return resistance, Ω, and variance of |U| − R·|I|, V², from samples at standstill.

    The line through the origin has errors in both variables (W. E. Deming, "Statistical Adjustment of
    Data", 1943).

    Parameters
    ----------
    standing
        Number of samples, and sums of U², U·I and I², shape (4,).
    nominal
        Resistance of the data sheet, Ω.
    """
    count, volts, both, amperes = standing
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
    utc_us: NDArray[np.int64],
    values: Array,
    rev_min: Array,
    constants: tuple[float, float, float],
    standing: Array,
    motion: Array,
) -> None:
    """Set the signs sample by sample; ``standing`` and ``motion`` are kept between blocks.

    ``motion`` holds, of the latest motion one way, its last time and direction, the log-odds of a driving
    current, its expectation (in units of a certain sign), and its variance.
    """
    nominal, torque_constant, moving = constants
    for k in range(utc_us.size):
        volts, amperes, speed = values[k, _V4], values[k, _V5], values[k, _V7]
        values[k, _V4] = values[k, _V5] = np.nan
        if np.isnan(volts) or np.isnan(amperes):
            continue
        resistance, variance = _winding(standing, nominal)
        if rev_min[k] <= _STANDING * moving and volts > _LOADED * _STEP_A * nominal:
            standing[0] += 1.0
            standing[1] += volts * volts
            standing[2] += volts * amperes
            standing[3] += amperes * amperes
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
