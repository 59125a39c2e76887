"""How one verdict stands, in a cell of a table: control left, course of the condition, seconds judged."""

from __future__ import annotations

from typing import Final

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.health.axis.thresholds import NORMAL_S
from mavhums.report.assessment import Interval, Verdict
from mavhums.show._words import clock

__all__ = ["control_left", "course", "effectiveness", "judged", "word"]

_WIDEST: Final = 1.0
"""A 95 % interval wider than the whole control effectiveness tells nothing of it."""

_UPPER: Final[tuple[Condition, ...]] = ("changed", "degraded", "emergency")


def effectiveness(interval: Interval) -> str:
    """Return what is left of the control effectiveness, with its interval.

    Examples
    --------
    >>> effectiveness(Interval(estimate=0.52, low=0.31, high=0.73))
    '52 % (31–73)'
    """
    return f"{100 * interval.estimate:.0f} % ({100 * interval.low:.0f}–{100 * interval.high:.0f})"


def control_left(verdict: Verdict) -> str | None:
    """Return what an axis keeps of its control, as far as the figure can be relied on; None without one.

    A gain above the reference's is no gain to a maintainer, and that of an axis that answers late is intact.

    Examples
    --------
    >>> axis = Verdict(subject="axis", vehicle=1, actuator="roll", condition="normal", worst="normal")
    >>> control_left(axis.model_copy(update={"effectiveness": Interval(estimate=1.19, low=1.1, high=1.28)}))
    'no loss'
    """
    left, condition = verdict.effectiveness, verdict.condition
    if left is None:
        return None
    if condition == "undecided" and verdict.coverage.decidable < NORMAL_S:
        return f"not reliable: {verdict.coverage.decidable} of {NORMAL_S} s judged"
    if left.high - left.low > _WIDEST:
        return "not reliable"
    if condition == "normal" and left.high >= 1.0:
        return "no loss"
    late = [item for item in verdict.evidence if item.kind == "slow"]
    if late and all(item.kind != "effectiveness" for item in verdict.evidence):
        return f"gain intact, {late[-1].value:.2g} s late"
    return effectiveness(left)


def course(verdict: Verdict) -> tuple[Condition, str] | None:
    """Return the worst condition, where it is past, and when it was; None where it is the present one.

    Examples
    --------
    >>> course(Verdict(vehicle=1, actuator="rudder", condition="undecided", worst="normal"))
    ('normal', '')
    """
    worst = verdict.worst
    if worst == verdict.condition:
        return None
    if SEVERITY[worst] <= SEVERITY["normal"]:
        return worst, ""
    shown = [item for item in verdict.evidence if item.rule.startswith(f"{worst}:")] or verdict.evidence
    if not shown:
        return worst, "during the flight"
    return worst, f"{clock(min(e.start_s for e in shown))}–{clock(max(e.end_s for e in shown))}"


def word(condition: Condition) -> str:
    """Return a condition as a table shows it: what must be acted on in capitals."""
    return condition.upper() if condition in _UPPER else condition


def judged(verdict: Verdict) -> str | None:
    """Return how many seconds could be judged; None where none was there to be judged.

    Examples
    --------
    >>> judged(Verdict(vehicle=1, actuator="rudder", condition="normal", worst="normal"))
    """
    coverage = verdict.coverage
    return f"{coverage.decidable} of {coverage.windows} s" if coverage.windows else None
