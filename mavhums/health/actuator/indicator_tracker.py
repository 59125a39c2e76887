"""Tracking of one detector through a flight: decision, episodes, and the quantity over the flight."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import CENTRAL_95, TAIL_95, t_probability, t_quantile
from mavhums.health.actuator.detector import Detector
from mavhums.health.decision.conditions import Episode, Episodes, IndicatorChange
from mavhums.health.decision.evidence import alarms_in_words, in_unit
from mavhums.health.decision.limits import Estimates, LimitTest, PooledErrors, half_width
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.health.estimation.least_squares import Fit
from mavhums.health.estimation.random_effects import RunningVariance
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.results.verdict import Evidence, Indicator, Interval, Suspect


class Estimate(NamedTuple):
    """A quantity, its standard error, and the degrees of freedom of the error."""

    value: float
    error: float
    freedom: float


class IndicatorTracker:
    """Tracks one detector of one actuator through a flight.

    Parameters
    ----------
    detector
        The detector.
    false_alarms
        Alarms per 100 hours.

    Attributes
    ----------
    detector
        As given.
    decision
        Comparison with the limits.
    episodes
        Episodes of one condition according to the limits.
    variance, weighted
        Variance over non-overlapping windows; the same with each window's certainty as its weight.
    latest
        The latest estimate; None before the first.
    concluded
        95 % interval of the whole flight's estimate if that decided, else None.
    """

    def __init__(self, detector: Detector, *, false_alarms: float = FALSE_ALARMS) -> None:
        self.detector = detector
        self.decision = LimitTest(detector.levels, false_alarms, detector.span_s)
        self.false_alarms = false_alarms
        self._errors = PooledErrors()
        self.episodes = Episodes()
        self.variance, self.weighted = RunningVariance(), RunningVariance()
        self.next_due_s = -np.inf
        self.latest: Estimate | None = None
        self.concluded: Interval | None = None

    @property
    def judged(self) -> int:
        """Number of windows that show the quantity and do not overlap."""
        return self.variance.count

    def feed(self, own: Estimates, end_s: Array) -> dict[int, IndicatorChange]:
        """Process the windows that end at ``end_s``, shape (k,); return the changes of the decision."""
        at = np.flatnonzero(np.isfinite(own.value))
        shown = self._errors.feed(own).at(at)
        if not at.size:
            return {}
        changes = {}
        sizes = self._sizes(shown)
        evidence = self.decision.evidence(sizes, end_s[at])
        columns = (end_s[at], sizes.value, shown.value, shown.error)
        for k, row, end, here, signed, error in zip(
            at.tolist(), evidence, *(column.tolist() for column in columns), strict=True
        ):
            # Only windows that share no sample show the quantity's scatter.
            if end >= self.next_due_s:
                self.next_due_s = end + WINDOW_S
                self.variance.add(signed)
                self.weighted.add(signed, max(error, 1e-12) ** -2.0)
            if self.decision.feed(end, row):
                condition, since_s = self.decision.condition, self.decision.since_s or 0.0
                self.episodes.begin_decided(condition, since_s, end, here)
                changes[k] = IndicatorChange(condition, since_s, self.rule(condition))
            else:
                faulty = SEVERITY[self.decision.condition] > SEVERITY["normal"]
                self.episodes.extend(here, end, agrees=faulty == (row[0, 0] > 0.0))
        self.latest = Estimate(*(float(column[at[-1]]) for column in own))
        return changes

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

    def conclude(self, flight: Mapping[str, Fit], start_s: float, end_s: float) -> IndicatorChange | None:
        """Judge by the whole flight, which may have evidence that no run of windows has.

        It counts as one more test against the limits, like another window, and ends nothing.
        """
        judged = self.detector.conclusion(flight)
        if judged is None or not np.isfinite(judged.value[0]):
            return None
        size = self._sizes(judged)
        if not self.decision.settle(size, start_s):
            return None
        value, printed = float(judged.value[0]), float(half_width(judged, tail=TAIL_95)[0])
        self.concluded = Interval.around(value, printed)
        self.latest = Estimate(value, float(judged.error[0]), float(judged.freedom[0]))
        condition = self.decision.condition
        # The whole flight began before every window: what it shows lies beside their episodes and ends none.
        self.episodes.add(Episode(condition, start_s, end_s, float(size.value[0])))
        return IndicatorChange(condition, start_s, f"{self.rule(condition)}, over the whole flight")

    def _sizes(self, estimates: Estimates) -> Estimates:
        """Return the estimates without signs that the limits do not know."""
        return estimates._replace(value=np.abs(estimates.value)) if self.detector.two_sided else estimates

    def rule(self, condition: Condition) -> str:
        """Return the reason for the condition as text."""
        quantity, levels = self.detector.quantity, self.detector.levels
        sure = f"with {alarms_in_words(self.false_alarms)}"
        return {
            "normal": f"normal: {quantity} not reliably above {self._level(levels.normal)}, {sure}",
            "degraded": f"degraded: {quantity} reliably above {self._level(levels.normal)}, {sure}",
            "emergency": f"emergency: interval of {quantity} reaches {self._level(levels.emergency)}, {sure}",
            "undecided": f"undecided: no window shows {quantity}",
        }[condition]

    def _level(self, level: float | None) -> str:
        return "any limit" if level is None else in_unit(level, self.detector.unit)


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
            rule=tracker.rule(episode.condition),
        )
        for episode in tracker.episodes
        if detector.fault == "friction" or episode.condition != "normal"
    ]


def suspect_of(tracker: IndicatorTracker) -> Suspect | None:
    """Return the suspected fault, with the probability that the quantity exceeds its limit."""
    if SEVERITY[tracker.decision.condition] < SEVERITY["degraded"] or tracker.latest is None:
        return None
    (value, error, freedom), normal = tracker.latest, tracker.detector.levels.normal
    if normal is None:
        return Suspect(fault=tracker.detector.fault, confidence=0.0)
    size = abs(value) if tracker.detector.two_sided else value
    # A jam has no error: it is proven or not.
    confidence = t_probability(freedom, (size - normal) / error) if error else 1.0
    return Suspect(fault=tracker.detector.fault, confidence=confidence)


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
        mean=tracker.weighted.mean,
        mean_error=tracker.weighted.mean_error,
        limit=tracker.detector.levels.normal,
        emergency=tracker.detector.levels.emergency,
        load=float(f"{load:.4g}") if load is not None and tracker.detector.fault == "friction" else None,
    )
