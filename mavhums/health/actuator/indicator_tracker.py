"""Tracking of one detector through a flight: decision, drift from the baseline, episodes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import stdtrit

from mavhums.core.arrays import Array
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import CENTRAL_95, TAIL_95
from mavhums.health.actuator.detector import Detector
from mavhums.health.decision.baseline import Baseline, Drift, condition_with_drift, onset_with_drift
from mavhums.health.decision.conditions import Episode, Episodes, IndicatorChange
from mavhums.health.decision.evidence import drift_evidence, drift_rule, limit_rule, suspected
from mavhums.health.decision.limits import Decision, WindowEvaluation, bounds, half_width, shown_by, tail_of
from mavhums.health.decision.records import Decided, Estimate, FaultRecord, WindowRecord
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.estimation.fits import Estimates
from mavhums.health.estimation.least_squares import Fit
from mavhums.health.estimation.random_effects import RunningVariance
from mavhums.report.assessment import Evidence, Indicator, Interval, Suspect


class IndicatorTracker:
    """Tracks one detector of one actuator through a flight.

    Parameters
    ----------
    detector
        The detector.
    baseline
        Baseline of the same quantity from the actuator's earlier flights; None if there is none.
    window_s
        Length of a window.
    false_alarms
        Alarms per 100 hours.
    recorded
        Whether ``windows`` and ``decided`` are kept.

    Attributes
    ----------
    detector
        As given.
    decision, drift
        Comparison with the limits, and with the baseline (None without a baseline).
    episodes
        Episodes of one condition according to the limits.
    variance
        Variance over non-overlapping windows.
    latest
        The latest estimate; None before the first.
    concluded
        95 % interval of the whole flight's estimate if that decided, else None.
    windows, decided
        The windows that do not overlap, and the changes of the decision, in the order of time.
    """

    def __init__(
        self,
        detector: Detector,
        baseline: Baseline | None,
        *,
        window_s: float,
        false_alarms: float = FALSE_ALARMS,
        recorded: bool = False,
    ) -> None:
        self.detector = detector
        self.decision = Decision(detector.levels, proven=detector.span_s is not None)
        self.drift: Drift | None = (
            Drift(baseline, two_sided=detector.two_sided, false_alarms=false_alarms) if baseline else None
        )
        self.window_s = window_s
        self._span_s = detector.span_s or window_s
        self.false_alarms = false_alarms
        self.episodes = Episodes()
        self.variance = RunningVariance()
        self.next_due_s = -np.inf
        self.latest: Estimate | None = None
        self.concluded: Interval | None = None
        self.windows: list[WindowRecord] = []
        self.decided: list[Decided] = []
        self._recorded = recorded

    @property
    def judged(self) -> int:
        """Number of windows that show the quantity and do not overlap."""
        return self.variance.count

    @property
    def condition(self) -> Condition:
        """Condition according to the limits, or at least degraded after a shift from the baseline."""
        return condition_with_drift(self.decision.condition, self.drift.alarm if self.drift else None)

    @property
    def since_s(self) -> float | None:
        """Flight time of the onset of the condition."""
        decision = self.decision
        return onset_with_drift(
            decision.condition, decision.since_s, self.drift.alarm if self.drift else None
        )

    def feed(self, look: WindowEvaluation, end_s: Array) -> list[IndicatorChange]:
        """Process the windows that end at ``end_s``, shape (k,); return the changes."""
        at = np.flatnonzero(np.isfinite(look.own.value))
        if not at.size:
            return []
        changes = []
        before = self.condition
        columns = (look.severity, look.sure, end_s, *look.steadied)
        for k, said, certain, end, signed, error, freedom in zip(
            at.tolist(), *(column[at].tolist() for column in columns), strict=True
        ):
            here = abs(signed) if self.detector.two_sided else signed
            # Only windows that share no sample are independent tests against the baseline.
            separate = end >= self.next_due_s
            if separate:
                self._feed_separate(signed, error, freedom, end)
            # An inconclusive window must not end a fault.
            severity = self._shown(said, here)
            decided = self.decision.feed(severity, end - self._span_s, end, sure=certain)
            if decided and self._recorded:
                self.decided.append(Decided(end, self.decision.condition, self.decision.since_s or 0.0))
            if decided:
                self.episodes.begin_decided(self.decision.condition, self.decision.since_s or 0.0, end, here)
            else:
                agrees = severity == SEVERITY[self.decision.condition]
                self.episodes.extend(here, end, agrees=agrees)
            if (decided or separate) and self.condition != before:
                before = self.condition
                changes.append(IndicatorChange(k, before, self.since_s or 0.0, self.rule(before)))
        self.latest = Estimate(*(float(column[at[-1]]) for column in look.own))
        return changes

    @property
    def faulty_windows(self) -> int:
        """Number of windows on which a fault rests, the whole flight counting as one; 0 without a fault."""
        faulty = SEVERITY[self.condition] > SEVERITY["normal"]
        return max(self.judged, int(self.concluded is not None)) if faulty else 0

    def surely_grave(self, flight: Mapping[str, Fit]) -> bool:
        """Return whether the whole interval over the flight lies beyond the emergency limit.

        A shaft that friction hardly lets move gives no window enough samples; the flight may still be clear.
        """
        judged, (_, emergency) = self.detector.conclusion(flight), bounds(self.detector.levels)
        # The interval of a two-sided quantity has two ends, of which neither is surely grave.
        if judged is None or self.detector.two_sided:
            return False
        low = judged.value - half_width(judged, tail=tail_of(self.false_alarms))
        return bool(low[0] > emergency)

    def conclude(self, flight: Mapping[str, Fit], start_s: float, end_s: float) -> IndicatorChange | None:
        """Judge by the whole flight, which may have evidence that no run of windows has; return the change.

        It counts as one more test against the limits and one against the baseline, like another window.
        """
        before = self.condition
        self._conclude_drift(self.detector.overall(flight), start_s)
        self._conclude_limits(self.detector.conclusion(flight), start_s, end_s)
        if self.condition == before:
            return None
        return IndicatorChange(
            0, self.condition, start_s, f"{self.rule(self.condition)}, over the whole flight"
        )

    def _conclude_drift(self, overall: Estimates | None, start_s: float) -> None:
        if self.drift is None or overall is None or not np.isfinite(overall.value[0]):
            return
        value, error, freedom = (float(a[0]) for a in (overall.value, overall.error, overall.freedom))
        self.drift.conclude(value, error, freedom, start_s)
        if self.latest is None:
            self.latest = Estimate(value, error, freedom)

    def _conclude_limits(self, judged: Estimates | None, start_s: float, end_s: float) -> None:
        if judged is None or not np.isfinite(judged.value[0]):
            return
        size = np.abs(judged.value) if self.detector.two_sided else judged.value
        half = half_width(judged, tail=tail_of(self.false_alarms))
        shown = int(shown_by(size - half, size + half, *bounds(self.detector.levels))[0])
        # The whole flight adds what no run of windows showed; it ends nothing.
        if not self.decision.settle(shown, start_s):
            return
        value, printed = float(judged.value[0]), float(half_width(judged, tail=TAIL_95)[0])
        self.concluded = Interval(estimate=value, low=value - printed, high=value + printed)
        self.latest = Estimate(value, float(judged.error[0]), float(judged.freedom[0]))
        # The whole flight began before every window: what it shows lies beside their episodes and ends none.
        self.episodes.add(Episode(self.decision.condition, start_s, end_s, float(size[0])))

    def _shown(self, shown: int, value: float) -> int:
        """Prevent a merely inconclusive window from ending a fault: its estimate must be normal, too."""
        normal = self.detector.levels.normal
        faulty = SEVERITY[self.decision.condition] > SEVERITY["normal"]
        doubtful = shown == SEVERITY["normal"] and normal is not None and value > normal
        return SEVERITY["undecided"] if faulty and doubtful else shown

    def _feed_separate(self, value: float, error: float, freedom: float, end_s: float) -> None:
        """Process a window that does not overlap the previous one."""
        self.next_due_s = end_s + self.window_s
        self.variance.add(value)
        if self._recorded:
            self.windows.append(WindowRecord(end_s, value, error, freedom))
        if self.drift is not None:
            self.drift.feed(value, error, freedom, end_s - self.window_s)

    def rule(self, condition: Condition) -> str:
        """Return the reason for the condition as text."""
        if condition != self.decision.condition and self.drift is not None and self.drift.alarm:
            return drift_rule(self.detector, self.drift.baseline, self.drift.alarm, self.false_alarms)
        return limit_rule(self.detector, condition, self.false_alarms)


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


def indicator_of(
    tracker: IndicatorTracker, flight: Mapping[str, Fit], load: float | None = None
) -> Indicator | None:
    """Return the quantity over the whole flight; None if the flight has no evidence for it.

    ``load`` is the mean load in motion, where the friction depends on it.
    """
    overall = tracker.detector.overall(flight)
    if overall is None or not np.isfinite(overall.value[0]) or not tracker.judged:
        return None
    value = float(overall.value[0])
    half = float(stdtrit(overall.freedom[0], CENTRAL_95) * overall.error[0])
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
        load=float(f"{load:.4g}") if load is not None and tracker.detector.fault == "friction" else None,
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
