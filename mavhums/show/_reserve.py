"""What torque actuators had left in flight, in words, for terminal and report."""

from __future__ import annotations

from collections.abc import Iterator

from mavhums.health.self_baseline.motor import STALL_SHARES
from mavhums.report.assessment import Assessment, Interval
from mavhums.show._words import name, percent

__all__ = ["HEAD", "TITLE", "lines", "rows"]

TITLE = "Torque, by that at stall"
HEAD = ("actuator", "highest sustained", "reserve", "friction (95 %)")

_FRICTION, _TORQUE = STALL_SHARES


def lines(assessment: Assessment) -> Iterator[str]:
    """Yield a line for each actuator whose share of stall is known."""
    for actuator, highest, reserve, friction in rows(assessment):
        of = "" if friction == "—" else f", friction {friction}"
        yield f"{actuator}: highest sustained {highest}, reserve {reserve}{of}"


def rows(assessment: Assessment) -> Iterator[tuple[str, ...]]:
    """Yield the cells of a table under :data:`HEAD`."""
    for verdict in assessment.ranked():
        shown = {one.fault: one.value for one in verdict.indicators}
        torque = shown.get(_TORQUE)
        if torque is not None:
            left = percent(max(1.0 - torque.estimate, 0.0))
            yield name(verdict, assessment), percent(torque.estimate), left, _share(shown.get(_FRICTION))


def _share(friction: Interval | None) -> str:
    if friction is None:
        return "—"
    estimate, low, high = (f"{100 * one:.1f}" for one in (friction.estimate, friction.low, friction.high))
    return f"{estimate} % ({low} to {high})"
