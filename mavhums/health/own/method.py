"""The method of each own-scale equation: linear equations by their sums, the power by its own law."""

from __future__ import annotations

from collections.abc import Sequence

from mavhums.actuator.profile import Actuator
from mavhums.health.own import fit, power, power_fit
from mavhums.health.own.equation import OwnEquation
from mavhums.health.own.fit import Nuisances, Wear
from mavhums.health.own.power_fit import Law
from mavhums.health.own.record import OwnSums
from mavhums.report.assessment import OwnRecord

__all__ = ["Individual", "collector", "learned", "shows", "wear"]

Individual = Nuisances | Law
"""Coefficients of the individual."""


def collector(equation: OwnEquation, actuator: Actuator) -> OwnSums:
    """Return the collector of an equation's sums over one flight."""
    return (power.PowerSums if equation.name == power.NAME else OwnSums)(equation, actuator)


def shows(record: OwnRecord) -> bool:
    """Return whether a flight has enough motion in both directions to determine the wear."""
    return power_fit.shows(record) if record.equation == power.NAME else fit.shows(record)


def learned(records: Sequence[OwnRecord]) -> Individual | None:
    """Return the individual's coefficients from flights with the same set-up; None if undetermined."""
    return power_fit.learned(records) if records[0].equation == power.NAME else fit.learned(records)


def wear(record: OwnRecord, individual: Individual | None) -> Wear | None:
    """Return a flight's wear with the individual's coefficients fixed, or free if None."""
    if record.equation == power.NAME:
        return power_fit.wear(record, individual if isinstance(individual, Law) else None)
    return fit.wear(record, individual if isinstance(individual, Nuisances) else None)
