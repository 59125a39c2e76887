"""Conversion of a tracker's results to the report's contracts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import stdtrit

from mavhums.health.findings_parts import drift_evidence, suspected
from mavhums.health.flight_record import Estimate, FaultRecord
from mavhums.health.indicator_tracker import IndicatorTracker
from mavhums.health.least_squares import Fit
from mavhums.health.rules import limit_rule
from mavhums.report.assessment import Evidence, Indicator, Interval, Suspect

__all__ = ["evidence_of", "indicator_of", "record_of", "suspect_of"]


def evidence_of(tracker: IndicatorTracker) -> list[Evidence]:
    """Return the episodes according to the limits, and the shift from the baseline if it alarmed."""
    return [*_limit_evidence_of(tracker), *_drift_evidence_of(tracker)]


def _limit_evidence_of(tracker: IndicatorTracker) -> list[Evidence]:
    detector, levels = tracker.detector, tracker.detector.levels
    return [
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


def _drift_evidence_of(tracker: IndicatorTracker) -> list[Evidence]:
    drift = tracker.drift
    if drift is None or drift.alarm is None:
        return []
    end_s = tracker.next_due_s - tracker.window_s
    return [drift_evidence(tracker.detector, drift.baseline, drift.alarm, end_s, tracker.false_alarms)]


def suspect_of(tracker: IndicatorTracker) -> Suspect | None:
    """Return the suspected fault, if there is one."""
    alarm = tracker.drift.alarm if tracker.drift else None
    return suspected(tracker.detector, tracker.decision.condition, tracker.latest, alarm)


def indicator_of(tracker: IndicatorTracker, flight: Mapping[str, Fit]) -> Indicator | None:
    """Return the quantity over the whole flight; None if the flight has no evidence for it."""
    overall = tracker.detector.overall(flight)
    if overall is None or not np.isfinite(overall.value[0]) or not tracker.judged:
        return None
    value = float(overall.value[0])
    half = float(stdtrit(overall.freedom[0], 0.975) * overall.error[0])
    return Indicator(
        fault=tracker.detector.fault,
        quantity=tracker.detector.quantity,
        unit=tracker.detector.unit,
        value=Interval(estimate=value, low=value - half, high=value + half),
        windows=tracker.judged,
        scatter=tracker.variance.deviation,
        limit=tracker.detector.levels.normal,
        emergency=tracker.detector.levels.emergency,
        baseline=tracker.drift.baseline.prediction() if tracker.drift else None,
    )


def record_of(tracker: IndicatorTracker, flight: Mapping[str, Fit]) -> FaultRecord:
    """Return the record by which the flight is compared with a baseline."""
    detector, overall = tracker.detector, tracker.detector.overall(flight) if flight else None
    shown = overall is not None and np.isfinite(overall.value[0])
    return FaultRecord(
        fault=detector.fault,
        quantity=detector.quantity,
        unit=detector.unit,
        levels=detector.levels,
        two_sided=detector.two_sided,
        windows=tuple(tracker.windows),
        decided=tuple(tracker.decided),
        settled=tracker.decision.condition if tracker.concluded else None,
        whole=Estimate(*(float(column[0]) for column in overall)) if overall and shown else None,
        latest=tracker.latest,
        evidence=tuple(_limit_evidence_of(tracker)),
    )
