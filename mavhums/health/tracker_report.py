"""Conversion of a tracker's results to the report's contracts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import stdtr, stdtrit

from mavhums.core.conditions import SEVERITY
from mavhums.health.drift import Shift
from mavhums.health.indicator_tracker import IndicatorTracker
from mavhums.health.least_squares import Fit
from mavhums.health.rules import drift_rule, limit_rule
from mavhums.report.assessment import Evidence, Indicator, Interval, Suspect

__all__ = ["evidence_of", "indicator_of", "suspect_of"]


def evidence_of(tracker: IndicatorTracker) -> list[Evidence]:
    """Return the episodes according to the limits, and the shift from the baseline if it alarmed."""
    detector, levels = tracker.detector, tracker.detector.levels
    found = [
        Evidence(
            kind=detector.fault,
            start_s=episode.start_s,
            end_s=episode.end_s,
            value=episode.peak,
            limit=levels.emergency if episode.condition == "emergency" else levels.normal,
            rule=limit_rule(detector, episode.condition, tracker.false_alarms),
        )
        for episode in tracker.episodes
        if detector.fault == "friction" or episode.condition != "normal"
    ]
    if tracker.drift is not None and tracker.drift.alarm is not None:
        alarm, baseline = tracker.drift.alarm, tracker.drift.baseline
        found.append(
            Evidence(
                kind=f"{detector.fault}_drift",
                start_s=alarm.since_s,
                end_s=max(tracker.next_due_s - tracker.window_s, alarm.since_s),
                value=baseline.mean + alarm.value,
                limit=baseline.mean,
                rule=drift_rule(detector, baseline, alarm, tracker.false_alarms),
            )
        )
    return found


def suspect_of(tracker: IndicatorTracker) -> Suspect | None:
    """Return the suspected fault, with the probability that its quantity exceeds limit or baseline."""
    if SEVERITY[tracker.condition] < SEVERITY["degraded"] or tracker.latest is None:
        return None
    value, error, freedom = tracker.latest
    levels = tracker.detector.levels
    confidence = 0.0
    if SEVERITY[tracker.decision.condition] > 0 and levels.normal is not None:
        size = abs(value) if tracker.detector.two_sided else value
        confidence = float(stdtr(freedom, (size - levels.normal) / error)) if error else 1.0
    if tracker.drift is not None and tracker.drift.alarm is not None:
        confidence = max(confidence, _certainty(tracker.drift.alarm))
    return Suspect(fault=tracker.detector.fault, confidence=confidence)


def indicator_of(tracker: IndicatorTracker, flight: Mapping[str, Fit]) -> Indicator | None:
    """Return the quantity over the whole flight; None if the flight has no evidence for it."""
    overall = tracker.detector.overall(flight)
    if overall is None or not np.isfinite(overall.value[0]) or not tracker.variance.count:
        return None
    value = float(overall.value[0])
    half = float(stdtrit(overall.freedom[0], 0.975) * overall.error[0])
    return Indicator(
        fault=tracker.detector.fault,
        quantity=tracker.detector.quantity,
        unit=tracker.detector.unit,
        value=Interval(estimate=value, low=value - half, high=value + half),
        windows=tracker.variance.count,
        scatter=tracker.variance.deviation,
        limit=tracker.detector.levels.normal,
        emergency=tracker.detector.levels.emergency,
        baseline=tracker.drift.baseline.prediction() if tracker.drift else None,
    )


def _certainty(shift: Shift) -> float:
    return float(stdtr(10.0, abs(shift.value) / shift.error))
