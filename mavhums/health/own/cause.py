"""Distinguishes a change of friction from a change of the torque constant, by the back-EMF."""

from __future__ import annotations

from collections.abc import Sequence

from mavhums.health.own.identify import identified
from mavhums.health.own.judge import Comparison
from mavhums.health.own.past import REFERENCE_FLIGHTS, PastRecord, record_of
from mavhums.health.own.voltage import NAME
from mavhums.report.assessment import OwnRecord

__all__ = ["constant_lost"]

_LEAST_LOSS = 0.03


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
    own = record_of(records, NAME)
    before = [record for flight in past if flight.healthy and (record := record_of(flight.records, NAME))]
    if own is None or found.change is None or found.least_rise is None:
        return None
    now, known = identified([own]), identified(before[:REFERENCE_FLIGHTS])
    if now is None or known is None or now.back_emf.high >= known.back_emf.low:
        return None
    left = now.back_emf.estimate / known.back_emf.estimate
    rest = (1.0 + found.change.estimate) * left - 1.0
    explained = rest < min(found.least_rise, found.change.estimate / 2.0)
    return 1.0 - left if explained and 1.0 - left >= _LEAST_LOSS else None
