"""How sure a verdict is, in words."""

from __future__ import annotations

from typing import Final

from mavhums.report.assessment import Evidence, Verdict
from mavhums.show._network import told
from mavhums.show._standing import control_left, effectiveness
from mavhums.show._words import friction, percent

__all__ = ["certainty"]

_BY_ITSELF: Final = {
    "tracking": "the flown attitude left the demanded one by",
    "hard_over": "the roll that no output explains reached",
}
"""Alarms that rest on no estimate of the control effectiveness, and what raised them."""


def certainty(verdict: Verdict) -> str:
    """Return the estimates with their intervals, the network's part, and how much could be judged.

    Examples
    --------
    >>> certainty(Verdict(vehicle=1, actuator="rudder", condition="normal", worst="normal"))
    '0 of 0 windows are decidable'
    """
    sure = []
    if verdict.effectiveness and not (control_left(verdict) or "").startswith("not reliable"):
        left = effectiveness(verdict.effectiveness)
        sure.append(f"{left} of the reference's control effectiveness with its 95 % interval")
    if verdict.friction_nm:
        sure.append(f"friction {friction(verdict.friction_nm)} N·m with its 95 % interval")
    sure += filter(None, [told(verdict)])
    alarms = {item.kind: item for item in verdict.evidence if item.kind in _BY_ITSELF}
    sure += [_beyond(item) for item in alarms.values() if item.limit is not None]
    return "; ".join([*sure, _judged(verdict, apart=bool(alarms))])


def _beyond(item: Evidence) -> str:
    """Return how far an alarm that needs no other estimate was beyond its limit."""
    return f"{_BY_ITSELF[item.kind]} {item.value:.1f} times its healthy scatter, limit {item.limit:.1f}"


def _judged(verdict: Verdict, *, apart: bool) -> str:
    coverage = verdict.coverage
    if verdict.subject == "actuator":
        moved = f", the actuator moved {percent(coverage.moving_fraction)} of the time"
        judged = f"{coverage.decidable} of {coverage.windows} windows are decidable"
        return judged + moved if "V7" in verdict.provenance else judged
    if apart and not coverage.decidable:
        return "control effectiveness is judged apart from that, and could not be in this flight"
    return f"control effectiveness could be judged in {coverage.decidable} of {coverage.windows} s"
