"""How sure a verdict is, in words."""

from __future__ import annotations

from mavhums.report.assessment import Verdict
from mavhums.show._words import effectiveness, friction, percent

__all__ = ["certainty"]


def certainty(verdict: Verdict) -> str:
    """Return the estimates with their intervals, the network's vote, and how much could be judged.

    Examples
    --------
    >>> certainty(Verdict(vehicle=1, actuator="rudder", condition="normal", worst="normal"))
    '0 of 0 windows are decidable'
    """
    sure = []
    if verdict.effectiveness:
        left = effectiveness(verdict.effectiveness)
        sure.append(f"{left} of the reference's control effectiveness with its 95 % interval")
    if verdict.friction_nm:
        sure.append(f"friction {friction(verdict.friction_nm)} N·m with its 95 % interval")
    if verdict.p_emergency is not None:
        sure.append(f"the network says emergency with {percent(verdict.p_emergency)}")
    coverage = verdict.coverage
    moved = f", the actuator moved {percent(coverage.moving_fraction)} of the time"
    judged = f"{coverage.decidable} of {coverage.windows} windows are decidable"
    sure.append(judged + moved if "V7" in verdict.provenance else judged)
    return "; ".join(sure)
