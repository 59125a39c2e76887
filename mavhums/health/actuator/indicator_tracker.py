"""Tracking of one detector through a flight: decision, episodes, windows for the comparison."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import CENTRAL_95, TAIL_95, t_quantile
from mavhums.health.actuator.detector import Detector
from mavhums.health.decision.conditions import Episode, Episodes, IndicatorChange
from mavhums.health.decision.events import DecisionChange, Estimate, FaultRecord, IndicatorStep, WindowRecord
from mavhums.health.decision.evidence import limit_rule, suspected
from mavhums.health.decision.limits import Estimates, LimitTest, PooledErrors, half_width
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.estimation.least_squares import Fit
from mavhums.health.estimation.random_effects import RunningVariance
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.results.verdict import Evidence, Indicator, Interval, Suspect


class IndicatorTracker:
    """Tracks one detector of one actuator through a flight.

    Parameters
    ----------
    detector
        The detector.
    false_alarms
        Alarms per 100 hours.
    recorded
        Whether ``windows`` and ``decided`` are kept.

    Attributes
    ----------
    detector
        As given.
    described
        Its description.
    decision
        Comparison with the limits.
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
        *,
        false_alarms: float = FALSE_ALARMS,
        recorded: bool = False,
    ) -> None:
        self.detector = detector
        self.decision = LimitTest(detector.levels, false_alarms, detector.span_s)
        self.described = FaultRecord(
            detector.fault, detector.quantity, detector.unit, detector.levels, detector.two_sided
        )
        self.false_alarms = false_alarms
        self._errors = PooledErrors()
        self.episodes = Episodes()
        self.variance = RunningVariance()
        self.next_due_s = -np.inf
        self.latest: Estimate | None = None
        self.concluded: Interval | None = None
        self.windows: list[WindowRecord] = []
        self.decided: list[DecisionChange] = []
        self._recorded = recorded

    @property
    def judged(self) -> int:
        """Number of windows that show the quantity and do not overlap."""
        return self.variance.count

    def feed(self, own: Estimates, end_s: Array) -> dict[int, IndicatorStep]:
        """Process the windows that end at ``end_s``, shape (k,); return what they say, by window."""
        at = np.flatnonzero(np.isfinite(own.value))
        shown = self._errors.feed(own).at(at)
        if not at.size:
            return {}
        steps = {}
        sizes = self._sizes(shown)
        evidence = self.decision.evidence(sizes, end_s[at])
        columns = (end_s[at], sizes.value, *shown)
        for k, row, end, here, signed, error, freedom in zip(
            at.tolist(), evidence, *(column.tolist() for column in columns), strict=True
        ):
            # Only windows that share no sample are independent tests against the baseline.
            separate = Estimate(signed, error, freedom) if end >= self.next_due_s else None
            if separate is not None:
                self._feed_separate(separate, end)
            change = None
            if self.decision.feed(end, row):
                condition, since_s = self.decision.condition, self.decision.since_s or 0.0
                if self._recorded:
                    self.decided.append(DecisionChange(end, condition, since_s))
                self.episodes.begin_decided(condition, since_s, end, here)
                change = IndicatorChange(condition, since_s, self.rule(condition))
            else:
                faulty = SEVERITY[self.decision.condition] > SEVERITY["normal"]
                self.episodes.extend(here, end, agrees=faulty == (row[0, 0] > 0.0))
            if separate is not None or change is not None:
                steps[k] = IndicatorStep(self.described, separate, change)
        self.latest = Estimate(*(float(column[at[-1]]) for column in own))
        return steps

    def exceeds(self, own: Estimates, half: Array) -> Flags:
        """Return in which windows the whole interval of this half width lies above the normal limit."""
        normal = self.detector.levels.normal
        lowest = self._sizes(own).value - half
        return np.asarray(lowest > (np.inf if normal is None else normal))

    @property
    def faulty_windows(self) -> int:
        """Number of windows on which a fault rests, the whole flight counting as one; 0 without a fault."""
        faulty = SEVERITY[self.decision.condition] > SEVERITY["normal"]
        return max(self.judged, int(self.concluded is not None)) if faulty else 0

    def surely_grave(self, flight: Mapping[str, Fit]) -> bool:
        """Return whether the whole interval over the flight lies beyond the emergency limit.

        A shaft that friction hardly lets move gives no window enough samples; the flight may still be clear.
        """
        judged = self.detector.conclusion(flight)
        if judged is None or not np.isfinite(judged.value[0]):
            return False
        return self.decision.surely_grave(self._sizes(judged))

    def conclude(self, flight: Mapping[str, Fit], start_s: float, end_s: float) -> IndicatorStep:
        """Judge by the whole flight, which may have evidence that no run of windows has.

        It counts as one more test against the limits and one against the baseline, like another window.
        """
        change = None
        if self._conclude_limits(self.detector.conclusion(flight), start_s, end_s):
            condition = self.decision.condition
            change = IndicatorChange(condition, start_s, f"{self.rule(condition)}, over the whole flight")
        return IndicatorStep(self.described, self.overall(flight), change)

    def overall(self, flight: Mapping[str, Fit]) -> Estimate | None:
        """Return the estimate over the whole flight; None if the flight has no evidence for it."""
        overall = self.detector.overall(flight) if flight else None
        if overall is None or not np.isfinite(overall.value[0]):
            return None
        return Estimate(*(float(column[0]) for column in overall))

    def _conclude_limits(self, judged: Estimates | None, start_s: float, end_s: float) -> bool:
        if judged is None or not np.isfinite(judged.value[0]):
            return False
        size = self._sizes(judged)
        # The whole flight adds what no run of windows showed; it ends nothing.
        if not self.decision.settle(size, start_s):
            return False
        value, printed = float(judged.value[0]), float(half_width(judged, tail=TAIL_95)[0])
        self.concluded = Interval.around(value, printed)
        self.latest = Estimate(value, float(judged.error[0]), float(judged.freedom[0]))
        # The whole flight began before every window: what it shows lies beside their episodes and ends none.
        self.episodes.add(Episode(self.decision.condition, start_s, end_s, float(size.value[0])))
        return True

    def _sizes(self, estimates: Estimates) -> Estimates:
        """Return the estimates without signs that the limits do not know."""
        return estimates._replace(value=np.abs(estimates.value)) if self.detector.two_sided else estimates

    def _feed_separate(self, window: Estimate, end_s: float) -> None:
        """Process a window that does not overlap the previous one."""
        self.next_due_s = end_s + WINDOW_S
        self.variance.add(window.value)
        if self._recorded:
            self.windows.append(WindowRecord(end_s, *window))

    def rule(self, condition: Condition) -> str:
        """Return the reason for the condition as text."""
        return limit_rule(self.described, condition, self.false_alarms)


def evidence_of(tracker: IndicatorTracker) -> list[Evidence]:
    """Return the episodes according to the limits."""
    detector, levels = tracker.detector, tracker.detector.levels
    return [
        Evidence(
            kind=detector.fault,
            start_s=episode.start_s,
            end_s=episode.end_s,
            value=episode.peak,
            limit=levels.emergency if episode.condition == "emergency" else levels.normal,
            rule=limit_rule(tracker.described, episode.condition, tracker.false_alarms),
        )
        for episode in tracker.episodes
        if detector.fault == "friction" or episode.condition != "normal"
    ]


def suspect_of(tracker: IndicatorTracker) -> Suspect | None:
    """Return the suspected fault, if there is one."""
    return suspected(tracker.described, tracker.decision.condition, tracker.latest, None)


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
    half = t_quantile(float(overall.freedom[0]), CENTRAL_95) * float(overall.error[0])
    return Indicator(
        fault=tracker.detector.fault,
        quantity=tracker.detector.quantity,
        unit=tracker.detector.unit,
        value=Interval.around(value, half),
        windows=tracker.judged,
        scatter=tracker.variance.deviation,
        limit=tracker.detector.levels.normal,
        emergency=tracker.detector.levels.emergency,
        load=float(f"{load:.4g}") if load is not None and tracker.detector.fault == "friction" else None,
    )


def record_of(tracker: IndicatorTracker, flight: Mapping[str, Fit]) -> FaultRecord:
    """Return the record by which the flight is compared with a baseline."""
    return tracker.described._replace(
        windows=tuple(tracker.windows),
        decided=tuple(tracker.decided),
        settled=tracker.decision.condition if tracker.concluded else None,
        whole=tracker.overall(flight),
        latest=tracker.latest,
        evidence=tuple(evidence_of(tracker)),
    )
