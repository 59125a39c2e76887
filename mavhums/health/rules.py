"""Reasons for an actuator's condition, as text."""

from __future__ import annotations

from typing import Protocol

from mavhums.core.conditions import Condition
from mavhums.health.baseline import Baseline
from mavhums.health.detector import Levels
from mavhums.health.drift import Shift

__all__ = ["Quantity", "drift_rule", "limit_rule"]


class Quantity(Protocol):
    """The inputs of a rule: a quantity, its unit and its limits."""

    @property
    def quantity(self) -> str:
        """Name of the quantity."""

    @property
    def unit(self) -> str:
        """Unit of the quantity."""

    @property
    def levels(self) -> Levels:
        """Limits of the quantity."""


def limit_rule(detector: Quantity, condition: Condition, false_alarms: float) -> str:
    """Return the reason for a condition according to the limits."""
    normal, emergency = (_value(detector, level) for level in detector.levels)
    sure = f"with {_alarms(false_alarms)}"
    return {
        "normal": f"normal: {detector.quantity} not reliably above {normal}, {sure}",
        "degraded": f"degraded: {detector.quantity} reliably above {normal}, {sure}",
        "emergency": f"emergency: interval of {detector.quantity} reaches {emergency}, {sure}",
        "undecided": f"undecided: no window shows {detector.quantity}",
    }[condition]


def drift_rule(detector: Quantity, baseline: Baseline, shift: Shift, false_alarms: float) -> str:
    """Return the reason for a condition according to the baseline: the shift from it."""
    return (
        f"degraded: {detector.quantity} {_value(detector, shift.value, '+')} from its own baseline of "
        f"{_value(detector, baseline.mean)} over {baseline.flights} flights, "
        f"with {_alarms(false_alarms)}"
    )


def _value(detector: Quantity, value: float | None, sign: str = "") -> str:
    if value is None:
        return "any limit"
    return f"{value:{sign}.3g}" if detector.unit == "1" else f"{value:{sign}.3g} {detector.unit}"


def _alarms(false_alarms: float) -> str:
    return f"≤ {false_alarms:g} false alarm{'' if false_alarms == 1 else 's'} per 100 h"
