"""Friction and largest torque as shares of the torque at stall: dimensionless, without a data sheet.

    I_s = (V_s − V_d) / R        friction I_c/I_s        torque I_p/I_s, the rest of which is the reserve

R and V_d are identified by the voltage equation, I_c is the friction current and I_p the highest sustained
current. Torque constant, gear ratio and the drive's convention cancel. V_s is the supply's voltage, which has
to be known: the voltage at the motor in flight is far below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot

import numpy as np
from scipy.special import stdtrit

from mavhums.health.equations import own_current
from mavhums.health.own.fit import learned, wear
from mavhums.health.own.identify import Identified
from mavhums.health.own.past import record_of
from mavhums.health.own.voltage import NAME
from mavhums.report.assessment import Indicator, Interval, OwnRecord

__all__ = ["STALL_SHARES", "Shares", "friction_current", "lacking", "shares", "stall_indicators"]

_FRICTION, _TORQUE = "friction_of_stall", "torque_of_stall"
STALL_SHARES = (_FRICTION, _TORQUE)
"""Names of the indicators."""

_BIAS = 0.1  # of the friction current's level, by flight mode; it cancels only in a comparison with the past
_ABOVE = 1.1  # of the stated supply: a voltage at the motor beyond it shows that the statement is wrong


@dataclass(frozen=True, slots=True)
class Shares:
    """Shares of the torque at stall, 0 to 1.

    Attributes
    ----------
    friction
        Of friction; None if the friction current is not known.
    torque
        Of the highest sustained torque.
    """

    friction: Interval | None
    torque: Interval


def lacking(records: Sequence[OwnRecord]) -> str | None:
    """Return the reason why records of the voltage equation give no share of stall; None if they do."""
    supplies = {record.supply_v for record in records}
    if len(supplies) != 1 or None in supplies:
        return "the supply's voltage is not known; set supply_voltage in the profile"
    supply = max(record.supply_v or 0.0 for record in records)
    highest = max(record.peak_v or 0.0 for record in records)
    if highest > _ABOVE * supply:
        return f"the motor had {highest:g} V, more than the supply_voltage of {supply:g} V in the profile"
    if not all(record.peak_a for record in records):
        return "the records do not tell the highest current; analyse the logs again"
    return None


def shares(records: Sequence[OwnRecord], found: Identified, friction: Interval | None) -> Shares | None:
    """Return the shares of stall over flights; None if :func:`lacking`, or the drop leaves no voltage.

    Parameters
    ----------
    records
        Records of the voltage equation.
    found
        The motor identified from them.
    friction
        Friction current, A; None if it is not known.
    """
    own = [record for record in records if record.equation == NAME]
    if not own or lacking(own) is not None:
        return None
    volts = max(record.supply_v or 0.0 for record in own) - found.drop.estimate
    if not volts > 0.0:
        return None
    per_ampere = found.resistance.estimate / volts
    error = hypot(_relative(found.resistance), _half(found.drop) / volts)
    peak = max((record.peak_a for record in own if record.peak_a), key=lambda one: one.estimate)
    torque = _share(peak, per_ampere, error)
    return Shares(friction and _share(friction, per_ampere, hypot(error, _BIAS)), torque)


def friction_current(records: Sequence[OwnRecord]) -> Interval | None:
    """Return the mean friction current of flights, A; None if they do not determine it.

    Flights that were measured unlike the first are left out. The nuisances are learned over all flights;
    their error, common to all, is covered by the errors that the flights have with nuisances of their own.
    The interval is that of the mean, by these errors or by the scatter between flights, if that is larger.

    Parameters
    ----------
    records
        Records of one actuator; those of other equations than the current's are ignored.
    """
    own = [record for record in records if record.equation == own_current.EQUATION.name]
    alike = [record for record in own if record.setup == own[0].setup]
    if not alike:
        return None
    individual = learned(alike)
    found = [
        (one.value, free.error, free.freedom)
        for record in alike
        if (one := wear(record, individual)) and (free := wear(record, None))
    ]
    if not found:
        return None
    values, errors, freedom = np.array(found).T
    count = len(found)
    between = float(values.std(ddof=1)) if count > 1 else 0.0
    error = max(float(np.hypot.reduce(errors)) / count, between / count**0.5)
    half = float(stdtrit(max(count - 1.0, freedom.min()), 0.975)) * error
    mean = float(values.mean())
    return Interval(estimate=mean, low=mean - half, high=mean + half)


def stall_indicators(
    records: Sequence[OwnRecord], found: Identified | None, friction: Interval | None
) -> tuple[Indicator, ...]:
    """Return the indicators of a flight; none if it does not determine them.

    They decide no condition.

    Parameters
    ----------
    records
        Records of the flight.
    found
        The motor identified from this flight.
    friction
        Its friction current, A; None if it is not known.
    """
    own = record_of(records, NAME)
    told = shares([own], found, friction) if own and found else None
    if own is None or told is None:
        return ()
    parts = len(own.groups)
    torque = _indicator(_TORQUE, "highest sustained torque, share of stall", told.torque, parts)
    if told.friction is None:
        return (torque,)
    return (_indicator(_FRICTION, "friction, share of stall", told.friction, parts), torque)


def _indicator(fault: str, quantity: str, value: Interval, parts: int) -> Indicator:
    return Indicator(fault=fault, quantity=quantity, unit="1", value=value, windows=parts)


def _share(current: Interval, per_ampere: float, error: float) -> Interval:
    common = current.estimate * error
    below, above = (hypot(end - current.estimate, common) for end in (current.low, current.high))
    ends = (current.estimate - below, current.estimate, current.estimate + above)
    low, estimate, high = (float(f"{per_ampere * end:.4g}") for end in ends)
    return Interval(estimate=estimate, low=low, high=high)


def _half(interval: Interval) -> float:
    return (interval.high - interval.low) / 2.0


def _relative(interval: Interval) -> float:
    return _half(interval) / interval.estimate
