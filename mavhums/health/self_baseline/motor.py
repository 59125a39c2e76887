"""A motor's resistance and back-EMF constant as indicators, which are followed from flight to flight.

They decide no condition: a warm winding has more resistance, and a back-EMF constant that falls explains a
rise of the friction current (:mod:`~mavhums.health.self_baseline.motor`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import islice

import numpy as np

from mavhums.core.statistics import CENTRAL_95, t_quantile
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.motor_identification import VOLTAGE, Identified, identified
from mavhums.health.estimation.thresholds import BASELINE_FLIGHTS, REFERENCE_FLIGHTS
from mavhums.health.self_baseline.comparison import Comparison
from mavhums.health.self_baseline.past import record_of
from mavhums.results.verdict import Indicator, Interval, OwnRecord

_RESISTANCE, _BACK_EMF = "winding_own", "back_emf_own"
MOTOR_FAULTS = (_RESISTANCE, _BACK_EMF)
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
