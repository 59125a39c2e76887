"""Formats the comparison of a flight with the actuator's own earlier flights as text."""

from __future__ import annotations

from mavhums.health.own.equation import OwnEquation
from mavhums.health.own.judge import Comparison
from mavhums.report.assessment import Interval

__all__ = ["remedy_of", "told", "told_of_constant"]

_KEEP = "keep its flights in one folder: mavhums analyse LOG --history DIR --keep"
_NO_LIMIT = "no absolute limit known"


def told(equation: OwnEquation, found: Comparison) -> str:
    """Return the result of a comparison as text.

    Examples
    --------
    >>> from mavhums.health.own.registry import EQUATIONS
    >>> told(EQUATIONS[0], Comparison("learning", None, 6, 10))
    'flight 6 of the 10 that its baseline takes; no absolute limit known'
    """
    if found.condition == "learning":
        return f"flight {found.flights} of the {found.needed} that its baseline takes; {_NO_LIMIT}"
    if found.condition == "undecided" or found.change is None or found.least_rise is None:
        return found.why
    if found.condition == "unchanged":
        half = max(found.change.high - found.change.estimate, 0.0)
        return (
            f"{equation.quantity} within ±{half:.0%} of its first {found.flights} flights "
            f"(a rise of {found.least_rise:.0%} would have been found); {_NO_LIMIT}"
        )
    since = f" since flight {found.since.flight} ({found.since.date[:10]})" if found.since else ""
    return f"{equation.quantity} {_change(found.change)}{since}: {equation.cause}; {_NO_LIMIT}"


def told_of_constant(equation: OwnEquation, found: Comparison, lost: float) -> str:
    """Return the text for a change that a loss of the torque constant explains."""
    rise = "" if found.change is None else f" {found.change.estimate:+.0%}"
    return f"torque constant {-lost:+.0%}; the {equation.quantity}{rise} follows from it; {_NO_LIMIT}"


def remedy_of(equation: OwnEquation, found: Comparison) -> str | None:
    """Return the remedy; None if there is none."""
    if found.condition == "changed":
        return f"inspect {equation.inspect}"
    if found.condition == "learning":
        return _KEEP
    if found.condition == "undecided":
        return "analyse a flight in which the surface works in the air of the flights before"
    return None


def _change(change: Interval) -> str:
    half = (change.high - change.low) / 2
    return f"{change.estimate:+.0%} ± {half:.0%}"
