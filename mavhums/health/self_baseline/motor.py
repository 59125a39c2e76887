"""A motor's resistance and back-EMF constant as indicators, which are followed from flight to flight.

They decide no condition: a warm winding has more resistance, and a back-EMF constant that falls explains a
rise of the friction current (:mod:`~mavhums.health.self_baseline.motor`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from math import hypot

import numpy as np

from mavhums.core.statistics import CENTRAL_95, t_quantile
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.equations.own_scale import CURRENT
from mavhums.health.estimation.motor_identification import VOLTAGE, Identified, identified
from mavhums.health.estimation.thresholds import BASELINE_FLIGHTS, REFERENCE_FLIGHTS
from mavhums.health.estimation.wear import _learned_linear, _linear_wear
from mavhums.health.self_baseline.comparison import Comparison
from mavhums.health.self_baseline.past import record_of
from mavhums.health.self_baseline.thresholds import STALL_BIAS_SHARE
from mavhums.results.verdict import STALL_SHARES, Indicator, Interval, OwnRecord

_RESISTANCE, _BACK_EMF = "winding_own", "back_emf_own"
MOTOR_FAULTS = (_RESISTANCE, _BACK_EMF)
"""Names of the indicators."""
_FRICTION, _TORQUE = STALL_SHARES
"""Names of the indicators."""


def motor_indicators(records: Sequence[OwnRecord], past: Sequence[PastRecord]) -> tuple[Indicator, ...]:
    """Return the indicators of a flight; none if its voltage, current and speed do not determine them.

    Parameters
    ----------
    records
        Records of the flight.
    past
        All earlier flights, in time order; the first healthy ones are the baseline.
    """
    own, found = record_of(records, VOLTAGE), motor_of(records)
    if own is None or found is None:
        return ()
    earlier = [known for record in _reference(past) if (known := _alone(record))]
    parts = len(own.groups)
    return (
        _indicator(
            _RESISTANCE, "winding resistance", "Ω", found.resistance, [e.resistance for e in earlier], parts
        ),
        _indicator(
            _BACK_EMF, "back-EMF constant", "V·s/rad", found.back_emf, [e.back_emf for e in earlier], parts
        ),
    )


def _reference(past: Sequence[PastRecord]) -> list[OwnRecord]:
    """Return the records of the motor in the first healthy flights that have one."""
    records = (record_of(flight.records, VOLTAGE) for flight in past if flight.healthy)
    return [*islice(filter(None, records), REFERENCE_FLIGHTS)]


def motor_of(records: Sequence[OwnRecord]) -> Identified | None:
    """Return the motor identified from one flight; None if the flight does not determine it."""
    own = record_of(records, VOLTAGE)
    return _alone(own) if own else None


@lru_cache(maxsize=4096)
def _alone(record: OwnRecord) -> Identified | None:
    return identified([record])


def _indicator(
    fault: str, quantity: str, unit: str, value: Interval, earlier: Sequence[Interval], parts: int
) -> Indicator:
    half = (value.high - value.low) / 2.0
    error = half / t_quantile(max(parts - 1, 1), CENTRAL_95)
    return Indicator(
        fault=fault,
        quantity=quantity,
        unit=unit,
        value=value,
        windows=parts,
        scatter=float(f"{error * parts**0.5:.4g}"),
        baseline=_prediction(earlier),
        baseline_flights=len(earlier),
        needed_flights=BASELINE_FLIGHTS,
    )


def _prediction(earlier: Sequence[Interval]) -> Interval | None:
    """Return the 95 % prediction interval of another flight; None from too few."""
    count = len(earlier)
    if count < BASELINE_FLIGHTS:
        return None
    values = np.array([interval.estimate for interval in earlier])
    mean, spread = float(values.mean()), float(values.std(ddof=1)) * (1.0 + 1.0 / count) ** 0.5
    half = t_quantile(count - 1, CENTRAL_95) * spread
    return Interval.around(mean, half).significant(5)


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
    # A motor cannot have more than its supply: the profile is wrong by more than a share's own bias.
    if highest > (1.0 + STALL_BIAS_SHARE) * supply:
        return f"the motor had {highest:g} V, more than the supply_voltage of {supply:g} V in the profile"
    if not all(record.peak_a for record in records):
        return "the records do not contain the highest current; analyse the logs again"
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
    own = [record for record in records if record.equation == VOLTAGE]
    if not own or lacking(own) is not None:
        return None
    volts = max(record.supply_v or 0.0 for record in own) - found.drop.estimate
    if not volts > 0.0:
        return None
    per_ampere = found.resistance.estimate / volts
    error = hypot(_half(found.resistance) / found.resistance.estimate, _half(found.drop) / volts)
    peak = max((record.peak_a for record in own if record.peak_a), key=lambda one: one.estimate)
    torque = _share(peak, per_ampere, error)
    return Shares(friction and _share(friction, per_ampere, hypot(error, STALL_BIAS_SHARE)), torque)


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
    own = [record for record in records if record.equation == CURRENT.name]
    alike = [record for record in own if record.setup == own[0].setup]
    if not alike:
        return None
    individual = _learned_linear(alike)
    found = [
        (one.value, free.error, free.freedom)
        for record in alike
        if (one := _linear_wear(record, individual)) and (free := _linear_wear(record, None))
    ]
    if not found:
        return None
    values, errors, freedom = np.array(found).T
    count = len(found)
    stated = float(np.hypot.reduce(errors)) / count
    scattered = float(values.std(ddof=1)) / count**0.5 if count > 1 else 0.0
    # Two flights know their scatter badly: each error goes with its own degrees of freedom.
    error, known = (stated, freedom.min()) if stated >= scattered else (scattered, count - 1.0)
    half = t_quantile(known, CENTRAL_95) * error
    return Interval.around(float(values.mean()), half)


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
    own = record_of(records, VOLTAGE)
    of_stall = shares([own], found, friction) if own and found else None
    if own is None or of_stall is None:
        return ()
    parts = len(own.groups)
    torque = _share_indicator(_TORQUE, "highest sustained torque, share of stall", of_stall.torque, parts)
    if of_stall.friction is None:
        return (torque,)
    return (_share_indicator(_FRICTION, "friction, share of stall", of_stall.friction, parts), torque)


def _share_indicator(fault: str, quantity: str, value: Interval, parts: int) -> Indicator:
    return Indicator(fault=fault, quantity=quantity, unit="1", value=value, windows=parts)


def _share(current: Interval, per_ampere: float, error: float) -> Interval:
    common = current.estimate * error
    below, above = (hypot(end - current.estimate, common) for end in (current.low, current.high))
    low, estimate, high = (
        per_ampere * end for end in (current.estimate - below, current.estimate, current.estimate + above)
    )
    return Interval(estimate=estimate, low=low, high=high).significant(4)


def _half(interval: Interval) -> float:
    return (interval.high - interval.low) / 2.0


def constant_lost(
    found: Comparison, records: Sequence[OwnRecord], past: Sequence[PastRecord]
) -> float | None:
    """Return the lost share of the torque constant if this loss explains the change; else None.

    A weaker motor takes more current for the same friction: k_e·I_c does not change.

    Parameters
    ----------
    found
        A rise of the friction current.
    records, past
        Records of the flight, and of the earlier flights.
    """
    own = record_of(records, VOLTAGE)
    if own is None or found.change is None or found.least_rise is None:
        return None
    now, known = identified([own]), identified(_reference(past))
    # A loss of the constant counts only where the intervals lie apart.
    if now is None or known is None or now.back_emf.high >= known.back_emf.low:
        return None
    left = now.back_emf.estimate / known.back_emf.estimate
    # The friction torque is k_e·I_c: what is left of its rise.
    rest = (1.0 + found.change.estimate) * left - 1.0
    explained = rest < min(found.least_rise, found.change.estimate / 2.0)
    return 1.0 - left if explained else None
