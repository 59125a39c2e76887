"""The parts of an actuator's findings, identical in flight and from a flight's record."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from scipy.special import stdtr

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.health.baseline import Baseline
from mavhums.health.drift import Shift, held
from mavhums.health.flight_record import Estimate
from mavhums.health.rules import Quantity, drift_rule
from mavhums.report.assessment import Evidence, Suspect

__all__ = ["Described", "concludes", "drift_evidence", "in_order", "ranked", "suspected"]


class Described(Quantity, Protocol):
    """A fault's indicator, as a detector or a record describes it."""

    @property
    def fault(self) -> str:
        """Name of the fault."""

    @property
    def two_sided(self) -> bool:
        """Whether the quantity is normal near zero, and not below a value."""


def concludes(windows: int, friction_windows: int) -> bool:
    """Return whether a finished flight as a whole may decide on a quantity, given the windows that show it.

    What no window shows the whole flight may show, as play that the load seldom crosses, if the actuator was
    judged at all: if windows show its friction. The friction itself needs such windows. Samples too few or
    too doubtful for any window do not become evidence by their number. (What is surely an emergency over the
    flight needs none: a grave fault leaves few samples in motion.)
    """
    return bool(windows or friction_windows)


def drift_evidence(
    described: Described, baseline: Baseline, alarm: Shift, end_s: float, false_alarms: float
) -> Evidence:
    """Return the shift from the baseline as evidence; ``end_s`` is the end of the last window."""
    return Evidence(
        kind=f"{described.fault}_drift",
        start_s=alarm.since_s,
        end_s=max(end_s, alarm.since_s),
        value=baseline.mean + alarm.value,
        limit=baseline.mean,
        rule=drift_rule(described, baseline, alarm, false_alarms),
    )


def suspected(
    described: Described, decided: Condition, latest: Estimate | None, alarm: Shift | None
) -> Suspect | None:
    """Return the fault, with the probability that the quantity exceeds its limit or its baseline."""
    if SEVERITY[held(decided, alarm)] < SEVERITY["degraded"] or latest is None:
        return None
    value, error, freedom = latest
    normal = described.levels.normal
    confidence = 0.0
    if SEVERITY[decided] > 0 and normal is not None:
        size = abs(value) if described.two_sided else value
        confidence = float(stdtr(freedom, (size - normal) / error)) if error else 1.0
    if alarm is not None:
        confidence = max(confidence, float(stdtr(10.0, abs(alarm.value) / alarm.error)))
    return Suspect(fault=described.fault, confidence=confidence)


def ranked(suspects: Iterable[Suspect]) -> tuple[Suspect, ...]:
    """Return the suspects in descending order of probability."""
    return tuple(sorted(suspects, key=lambda suspect: -suspect.confidence))


def in_order(evidence: Iterable[Evidence]) -> tuple[Evidence, ...]:
    """Return the evidence in time order."""
    return tuple(sorted(evidence, key=lambda each: each.start_s))
