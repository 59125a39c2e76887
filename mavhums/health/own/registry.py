"""The own-scale equations, the one that tells most first."""

from __future__ import annotations

from mavhums.health.equations import own_current, own_tracking
from mavhums.health.own.equation import OwnEquation

__all__ = ["EQUATIONS", "equation_named", "inspected"]

EQUATIONS: tuple[OwnEquation, ...] = (own_current.EQUATION, own_tracking.EQUATION)


def equation_named(name: str) -> OwnEquation | None:
    """Return an equation by its name; None if there is none of it, as in a file of a later version."""
    return next((equation for equation in EQUATIONS if equation.name == name), None)


def inspected(fault: str) -> str | None:
    """Return what to inspect for an indicator; None if no equation has it.

    Examples
    --------
    >>> inspected("friction_current")
    'gearbox, bearings and hinge line'
    """
    return next((equation.inspect for equation in EQUATIONS if equation.fault == fault), None)
