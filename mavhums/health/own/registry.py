"""The own-scale equations, the most informative first."""

from __future__ import annotations

from collections.abc import Sequence

from mavhums.health.equations import own_current, own_power, own_tracking
from mavhums.health.own.equation import OwnEquation
from mavhums.report.assessment import OwnRecord

__all__ = ["EQUATIONS", "comparable", "inspected"]

EQUATIONS: tuple[OwnEquation, ...] = (
    own_current.EQUATION,
    own_power.EQUATION,
    own_tracking.EQUATION,
)


def comparable(records: Sequence[OwnRecord]) -> bool:
    """Return whether records contain the wear of an equation, and not only motor identification data."""
    names = {equation.name for equation in EQUATIONS}
    return any(record.equation in names for record in records)


def inspected(fault: str) -> str | None:
    """Return the parts to inspect for an indicator; None if no equation has it.

    Examples
    --------
    >>> inspected("friction_current")
    'gearbox, bearings and hinge line'
    """
    return next((equation.inspect for equation in EQUATIONS if equation.fault == fault), None)
