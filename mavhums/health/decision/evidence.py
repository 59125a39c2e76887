"""Reasons, evidence and suspects of a quantity, the same in flight and from a flight's record."""

from __future__ import annotations

from collections.abc import Iterable

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import t_probability
from mavhums.health.decision.baseline import Baseline, Shift, condition_with_drift
from mavhums.health.decision.events import Estimate, FaultRecord
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.results.verdict import Evidence, Suspect


def limit_rule(indicator: FaultRecord, condition: Condition, false_alarms: float) -> str:
    """Return the reason for a condition according to the limits."""
    normal, emergency = (_value(indicator, level) for level in indicator.levels)
    sure = f"with {_alarms(false_alarms)}"
    return {
        "normal": f"normal: {indicator.quantity} not reliably above {normal}, {sure}",
        "degraded": f"degraded: {indicator.quantity} reliably above {normal}, {sure}",
        "emergency": f"emergency: interval of {indicator.quantity} reaches {emergency}, {sure}",
        "undecided": f"undecided: no window shows {indicator.quantity}",
    }[condition]


def drift_rule(indicator: FaultRecord, baseline: Baseline, shift: Shift, false_alarms: float) -> str:
    """Return the reason for a condition according to the baseline: the shift from it."""
    return (
        f"degraded: {indicator.quantity} {_value(indicator, shift.value, '+')} from its own baseline of "
        f"{_value(indicator, baseline.mean)} over {baseline.flights} flights, "
        f"with {_alarms(false_alarms)}"
    )


def _value(indicator: FaultRecord, value: float | None, sign: str = "") -> str:
    if value is None:
        return "any limit"
    return f"{value:{sign}.3g}" if indicator.unit == "1" else f"{value:{sign}.3g} {indicator.unit}"


def _alarms(false_alarms: float) -> str:
    return f"≤ {false_alarms:g} false alarm{'' if false_alarms == 1 else 's'} per 100 h"


def concludes(windows: int, friction_windows: int) -> bool:
    """Return whether a finished flight as a whole may decide on a quantity, given the windows that show it.

    What no window shows the whole flight may show, as play that the load seldom crosses, if the actuator was
    judged at all: if windows show its friction. The friction itself needs such windows. Samples too few or
    too doubtful for any window do not become evidence by their number. (What is surely an emergency over the
    flight needs none: a grave fault leaves few samples in motion.)
    """
    return bool(windows or friction_windows)


def drift_evidence(
    described: FaultRecord, baseline: Baseline, alarm: Shift, end_s: float, false_alarms: float
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
    described: FaultRecord, decided: Condition, latest: Estimate | None, alarm: Shift | None
) -> Suspect | None:
    """Return the fault, with the probability that the quantity exceeds its limit or its baseline."""
    if SEVERITY[condition_with_drift(decided, alarm)] < SEVERITY["degraded"] or latest is None:
        return None
    value, error, freedom = latest
    normal = described.levels.normal
    confidence = 0.0
    if SEVERITY[decided] > 0 and normal is not None:
        size = abs(value) if described.two_sided else value
        # A jam has no error: it is proven or not.
        confidence = t_probability(freedom, (size - normal) / error) if error else 1.0
    if alarm is not None:
        # As of one window; it decides nothing.
        confidence = max(confidence, t_probability(WINDOW_S - 1.0, abs(alarm.value) / alarm.error))
    return Suspect(fault=described.fault, confidence=confidence)


def ranked(suspects: Iterable[Suspect]) -> tuple[Suspect, ...]:
    """Return the suspects in descending order of probability."""
    return tuple(sorted(suspects, key=lambda suspect: -suspect.confidence))


def in_order(evidence: Iterable[Evidence]) -> tuple[Evidence, ...]:
    """Return the evidence in time order."""
    return tuple(sorted(evidence, key=lambda each: each.start_s))
