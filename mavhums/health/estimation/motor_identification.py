"""The voltage equation of one flight, as sums: resistance, back-EMF constant and drop of the servo's motor.

    V4 = R·V5 + k_e·w + V_d·sgn(V5) + c

w is the rotor's speed. The drop of brushes or dead time has a column of its own: without it, it would appear
as resistance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array
from mavhums.core.quantities import column
from mavhums.core.statistics import CENTRAL_95, RAD_S_PER_REV_MIN, t_quantile, uniform_deviation
from mavhums.health.estimation.least_squares import Groups, eliminated, packed, sums_of_slots, unpacked
from mavhums.health.estimation.slots import Slots
from mavhums.health.estimation.thresholds import LEAST_PARTS
from mavhums.results.verdict import Interval, OwnRecord

VOLTAGE = "own_voltage"
_V4, _V5, _V7 = column("V4"), column("V5"), column("V7")
_TERMS = 4
_LEFT_OUT = [3]
_SIZE = 4


class VoltageSums:
    """Collects the sums of the voltage equation over one flight.

    Parameters
    ----------
    actuator
        The actuator of the flight.
    """

    def __init__(self, actuator: Actuator) -> None:
        self._motor_side = actuator.esc_side == "motor"
        self._groups = Groups(_TERMS, _without_offset)
        self._first_s = self._last_s = np.nan
        self._samples = 0

    def feed(self, slots: Slots) -> None:
        """Process the samples of several slots."""
        values, time_s = slots.values[slots.judged], slots.time_s[slots.judged]
        volts, current = np.ascontiguousarray(values[:, _V4]), values[:, _V5]
        terms = (current, values[:, _V7] * RAD_S_PER_REV_MIN, np.sign(current), np.ones(len(current)))
        X = np.stack(terms, axis=1)
        # At the bus V4 and V5 are not the motor's.
        usable = np.isfinite(X).all(axis=1) & np.isfinite(volts) & self._motor_side
        if not usable.any():
            return
        used_s = time_s[usable]
        self._samples += used_s.size
        self._first_s = float(np.nanmin([self._first_s, used_s[0]]))
        self._last_s = float(used_s[-1])
        self._groups.feed(slots.index, sums_of_slots(X, volts, usable, slots.start))

    @property
    def gap(self) -> None:
        """None: a motor that cannot be identified is no reason for a verdict."""
        return

    def record(self) -> OwnRecord | None:
        """Return the record of the flight so far; None if it has no evidence for the equation."""
        groups = self._groups.parts()
        duration_s = self._last_s - self._first_s
        if not groups or not duration_s > 0.0:
            return None
        return OwnRecord(
            equation=VOLTAGE,
            setup="V4, V5 and V7 at the motor",
            rate_hz=float(f"{self._samples / duration_s:.3g}"),
            duration_s=round(duration_s, 1),
            groups=tuple((float(count), *packed(gram)) for count, gram in groups),
        )


def _without_offset(gram: Array) -> Array:
    """Return a window's sums without its own offset, the fourth term."""
    kept = [0, 1, 2, _TERMS]
    return eliminated(gram, _LEFT_OUT)[np.ix_(kept, kept)]


@dataclass(frozen=True, slots=True)
class Identified:
    """The constants of a servo's motor, estimated from flights.

    Attributes
    ----------
    resistance
        Resistance of the winding and its wiring, Ω.
    back_emf
        V·s/rad of the rotor. It is the torque constant in N·m/A where V4·V5 is the electrical power, as of a
        direct-current motor; a drive that reports amplitudes, r.m.s. or phase values has another factor.
    drop
        Voltage drop of brushes or dead time, V.
    flights
        Flights that were used.
    """

    resistance: Interval
    back_emf: Interval
    drop: Interval
    flights: int


def identified(records: Sequence[OwnRecord]) -> Identified | None:
    """Return the joint estimate of flights; None if their currents and speeds vary too little.

    The intervals are those of the delete-one jackknife over parts of the flights, and include the bias from
    current noise: the true value lies between the least squares of the voltage and of the current.

    Parameters
    ----------
    records
        Records of the voltage equation of one actuator; others are ignored.
    """
    own = [record for record in records if record.equation == VOLTAGE]
    rows = [row for record in own for row in record.groups]
    if len(rows) < LEAST_PARTS:
        return None
    grams = np.array([unpacked(row[1:], _SIZE) for row in rows])
    total = grams.sum(axis=0)
    value = _solved(total)
    if value is None:
        return None
    others = [rest for gram in grams if (rest := _solved(total - gram)) is not None]
    count = len(others)
    spread = np.array(others) - np.mean(others, axis=0)
    error = np.sqrt((spread**2).sum(axis=0) * (count - 1) / count)
    noise = _attenuation(total, value)
    # What is true lies between the least squares of the voltage and of the current: the middle is taken.
    value = value + noise / 2.0
    half = t_quantile(count - 1, CENTRAL_95) * np.hypot(error, uniform_deviation(noise))
    resistance, back_emf, drop = (
        Interval.around(v, h).significant(6) for v, h in zip(value.tolist(), half.tolist(), strict=True)
    )
    # No motor has less than nothing: the flights do not determine it.
    if resistance.low <= 0.0 or back_emf.low <= 0.0:
        return None
    return Identified(resistance, back_emf, drop, len(own))


def _attenuation(gram: Array, value: Array) -> Array:
    """Return the largest bias of the coefficients, reached if the whole residual is current noise."""
    left_over = float(gram[-1, -1] - value @ gram[:-1, -1])
    most: Array = left_over / value[0] * np.linalg.inv(gram[:-1, :-1])[:, 0]
    return most


def _solved(gram: Array) -> Array | None:
    normal, right = gram[:-1, :-1], gram[:-1, -1]
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0.0).all():
        return None
    # Current, speed and drop that always go together cannot be separated: it is singular, or parts scatter.
    try:
        solved: Array = np.linalg.solve(normal / np.outer(scale, scale), right / scale) / scale
    except np.linalg.LinAlgError:
        return None
    return solved
