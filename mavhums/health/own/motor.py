"""A motor's resistance and back-EMF constant as indicators, which are followed from flight to flight.

They decide no condition: a warm winding has more resistance, and a back-EMF constant that falls explains a
rise of the friction current (:mod:`~mavhums.health.own.cause`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.special import stdtrit

from mavhums.health.own.identify import Identified, identified
from mavhums.health.own.past import REFERENCE_FLIGHTS, PastRecord, record_of
from mavhums.health.own.voltage import NAME
from mavhums.report.assessment import Indicator, Interval, OwnRecord

__all__ = ["MOTOR_FAULTS", "motor_indicators", "motor_of"]

_RESISTANCE, _BACK_EMF = "winding_own", "back_emf_own"
MOTOR_FAULTS = (_RESISTANCE, _BACK_EMF)
"""Names of the indicators."""

_NEEDED = 10


def motor_indicators(records: Sequence[OwnRecord], past: Sequence[PastRecord]) -> tuple[Indicator, ...]:
    """Return the indicators of a flight; none if its voltage, current and speed do not determine them.

    Parameters
    ----------
    records
        Records of the flight.
    past
        All earlier flights, in time order; the first healthy ones are the baseline.
    """
    own, found = record_of(records, NAME), motor_of(records)
    if own is None or found is None:
        return ()
    before = [known for flight in past if flight.healthy and (known := record_of(flight.records, NAME))]
    earlier = [one for record in before[:REFERENCE_FLIGHTS] if (one := _alone(record))]
    parts = len(own.groups)
    return (
        _indicator(
            _RESISTANCE, "winding resistance", "Ω", found.resistance, [e.resistance for e in earlier], parts
        ),
        _indicator(
            _BACK_EMF, "back-EMF constant", "V·s/rad", found.back_emf, [e.back_emf for e in earlier], parts
        ),
    )


def motor_of(records: Sequence[OwnRecord]) -> Identified | None:
    """Return the motor identified from one flight; None if the flight does not determine it."""
    own = record_of(records, NAME)
    return _alone(own) if own else None


@lru_cache(maxsize=4096)
def _alone(record: OwnRecord) -> Identified | None:
    return identified([record])


def _indicator(
    fault: str, quantity: str, unit: str, value: Interval, earlier: Sequence[Interval], parts: int
) -> Indicator:
    half = (value.high - value.low) / 2.0
    error = half / float(stdtrit(max(parts - 1, 1), 0.975))
    return Indicator(
        fault=fault,
        quantity=quantity,
        unit=unit,
        value=value,
        windows=parts,
        scatter=float(f"{error * parts**0.5:.4g}"),
        baseline=_prediction(earlier),
        baseline_flights=len(earlier),
        needed_flights=_NEEDED,
    )


def _prediction(earlier: Sequence[Interval]) -> Interval | None:
    """Return the 95 % prediction interval of another flight; None from too few."""
    count = len(earlier)
    if count < _NEEDED:
        return None
    values = np.array([interval.estimate for interval in earlier])
    mean, spread = float(values.mean()), float(values.std(ddof=1)) * (1.0 + 1.0 / count) ** 0.5
    half = float(stdtrit(count - 1, 0.975)) * spread
    low, estimate, high = (float(f"{number:.5g}") for number in (mean - half, mean, mean + half))
    return Interval(estimate=estimate, low=low, high=high)
