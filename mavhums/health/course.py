"""One detector's course through a flight: its decision, its drift from the baseline, its episodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr, stdtrit

from mavhums.health.baseline import Baseline
from mavhums.health.decision import FALSE_ALARMS, SEVERITY, Decision, bounds, half_width, shown_by, tail_of
from mavhums.health.detector import Detector, Estimates
from mavhums.health.drift import Drift, Shift
from mavhums.health.least_squares import Fit
from mavhums.health.panel import Look
from mavhums.health.rules import drift_rule, limit_rule
from mavhums.health.scatter import Scatter
from mavhums.report.assessment import Condition, Evidence, Indicator, Interval, Suspect

__all__ = ["Change", "Course"]

_MOST_EPISODES = 100

Array = NDArray[np.float64]


@dataclass(slots=True)
class _Episode:
    """An unbroken stay in one condition; ``peak`` is the highest value estimated in it."""

    condition: Condition
    start_s: float
    end_s: float
    peak: float


class _Latest(NamedTuple):
    """The estimate of the last window that showed the quantity."""

    value: float
    error: float
    freedom: float


class Change(NamedTuple):
    """What an indicator is held to show from the k-th of some windows on, and since when."""

    window: int
    condition: Condition
    since_s: float
    rule: str


class Course:
    """Follows one detector of one actuator.

    Parameters
    ----------
    detector
        Whose estimates are followed.
    baseline
        Of the same quantity in the actuator's flights before; None if there is none.
    window_s
        Length of a window.
    false_alarms
        Alarms per 100 hours.

    Attributes
    ----------
    detector
        As given.
    concluded
        95 % interval of the whole flight's estimate, if that decided; else None.
    """

    def __init__(
        self,
        detector: Detector,
        baseline: Baseline | None,
        *,
        window_s: float,
        false_alarms: float = FALSE_ALARMS,
    ) -> None:
        self.detector = detector
        self._decision = Decision(detector.levels)
        self._drift = (
            Drift(baseline, two_sided=detector.two_sided, false_alarms=false_alarms) if baseline else None
        )
        self._window_s = window_s
        self._false_alarms = false_alarms
        self._episodes: list[_Episode] = []
        self._scatter = Scatter()
        self._doubtful = -np.inf
        self._due_s = -np.inf
        self._latest: _Latest | None = None
        self.concluded: Interval | None = None

    @property
    def condition(self) -> Condition:
        """What the quantity shows: against its limits, or at least that it left its baseline."""
        drifted = self._drift is not None and self._drift.alarm is not None
        if drifted and SEVERITY[self._decision.condition] < SEVERITY["degraded"]:
            return "degraded"
        return self._decision.condition

    @property
    def since_s(self) -> float | None:
        """Flight time since which it does."""
        alarm = self._drift.alarm if self._drift else None
        times = [self._decision.since_s] if self.condition == self._decision.condition else []
        times += [alarm.since_s] if alarm and self.condition == "degraded" else []
        return min((time for time in times if time is not None), default=None)

    def feed(self, look: Look, end_s: Array) -> list[Change]:
        """Take what the windows that end at ``end_s`` show, shape (k,); return the changes."""
        at = np.flatnonzero(np.isfinite(look.own.value))
        if not at.size:
            return []
        changes = []
        columns = (look.severity, look.sure, end_s, *look.steadied)
        for k, said, certain, end, signed, error, freedom in zip(
            at.tolist(), *(column[at].tolist() for column in columns), strict=True
        ):
            before = self.condition
            here = abs(signed) if self.detector.two_sided else signed
            if end >= self._due_s:
                self._alone(signed, error, freedom, end)
            severity = self._said(said, here)
            decided = self._decision.feed(severity, end - self._window_s, end, sure=certain)
            self._extend(decided, severity == SEVERITY[self._decision.condition], end, here)
            if self.condition != before:
                changes.append(Change(k, self.condition, self.since_s or 0.0, self.rule(self.condition)))
        self._latest = _Latest(*(float(column[at[-1]]) for column in look.own))
        return changes

    def conclude(self, flight: Mapping[str, Fit], start_s: float, end_s: float) -> Change | None:
        """Judge by the whole flight, which may show what no run of windows could; return the change.

        It is one look more against the limits and one against the baseline, as another window would be.
        """
        before = self.condition
        self._conclude_drift(self.detector.overall(flight), start_s)
        self._conclude_limits(self.detector.conclusion(flight), start_s, end_s)
        if self.condition == before:
            return None
        return Change(0, self.condition, start_s, f"{self.rule(self.condition)}, over the whole flight")

    def _conclude_drift(self, overall: Estimates | None, start_s: float) -> None:
        if self._drift is None or overall is None or not np.isfinite(overall.value[0]):
            return
        value, error, freedom = (float(a[0]) for a in (overall.value, overall.error, overall.freedom))
        self._drift.conclude(value, error, freedom, start_s)
        if self._latest is None:
            self._latest = _Latest(value, error, freedom)

    def _conclude_limits(self, judged: Estimates | None, start_s: float, end_s: float) -> None:
        if judged is None or not np.isfinite(judged.value[0]):
            return
        size = np.abs(judged.value) if self.detector.two_sided else judged.value
        half = half_width(judged, tail=tail_of(self._false_alarms))
        shown = int(shown_by(size - half, size + half, *bounds(self.detector.levels))[0])
        if not self._decision.settle(shown, start_s):
            return
        value, printed = float(judged.value[0]), float(half_width(judged, tail=0.025)[0])
        self.concluded = Interval(estimate=value, low=value - printed, high=value + printed)
        self._latest = _Latest(value, float(judged.error[0]), float(judged.freedom[0]))
        self._begin(_Episode(self._decision.condition, start_s, end_s, float(size[0])))

    def _said(self, shown: int, value: float) -> int:
        """Let a window that only fails to show a fault not end one: its estimate must be normal, too."""
        normal = self.detector.levels.normal
        faulty = SEVERITY[self._decision.condition] > SEVERITY["normal"]
        doubtful = shown == SEVERITY["normal"] and normal is not None and value > normal
        return SEVERITY["undecided"] if faulty and doubtful else shown

    def _alone(self, value: float, error: float, freedom: float, end_s: float) -> None:
        """Take a window that does not overlap the one before."""
        self._due_s = end_s + self._window_s
        self._scatter.add(value)
        if self._drift is not None:
            self._drift.feed(value, error, freedom, end_s - self._window_s)

    def _extend(self, decided: bool, agrees: bool, end_s: float, value: float) -> None:
        """Take a window that is over; unless it agrees with the episode, it may belong to the next one."""
        self._doubtful = max(self._doubtful, value)
        if decided:
            since_s = self._decision.since_s or 0.0
            self._begin(_Episode(self._decision.condition, since_s, end_s, self._doubtful))
        elif self._episodes:
            self._episodes[-1].end_s = end_s
        if self._episodes and agrees:
            self._episodes[-1].peak = max(self._episodes[-1].peak, self._doubtful)
        if decided or agrees:
            self._doubtful = -np.inf

    def _begin(self, episode: _Episode) -> None:
        """End the episode before where this one begins; of very many the middle ones are forgotten."""
        if self._episodes:
            self._episodes[-1].end_s = episode.start_s
        if len(self._episodes) == _MOST_EPISODES:
            del self._episodes[_MOST_EPISODES // 2]
        self._episodes.append(episode)

    def rule(self, condition: Condition) -> str:
        """Return in words why the quantity makes the condition what it is."""
        if condition != self._decision.condition and self._drift is not None and self._drift.alarm:
            return drift_rule(self.detector, self._drift.baseline, self._drift.alarm, self._false_alarms)
        return limit_rule(self.detector, condition, self._false_alarms)

    def evidence(self) -> list[Evidence]:
        """Return the episodes that the limits tell, and the shift from the baseline if it alarmed."""
        detector, levels = self.detector, self.detector.levels
        found = [
            Evidence(
                kind=detector.fault,
                start_s=episode.start_s,
                end_s=episode.end_s,
                value=episode.peak,
                limit=levels.emergency if episode.condition == "emergency" else levels.normal,
                rule=limit_rule(detector, episode.condition, self._false_alarms),
            )
            for episode in self._episodes
            if detector.fault == "friction" or episode.condition != "normal"
        ]
        if self._drift is not None and self._drift.alarm is not None:
            alarm, baseline = self._drift.alarm, self._drift.baseline
            found.append(
                Evidence(
                    kind=f"{detector.fault}_drift",
                    start_s=alarm.since_s,
                    end_s=max(self._due_s - self._window_s, alarm.since_s),
                    value=baseline.mean + alarm.value,
                    limit=baseline.mean,
                    rule=drift_rule(detector, baseline, alarm, self._false_alarms),
                )
            )
        return found

    def suspect(self) -> Suspect | None:
        """Name the fault, with the probability that the quantity lies beyond its limit or its baseline."""
        if SEVERITY[self.condition] < SEVERITY["degraded"] or self._latest is None:
            return None
        value, error, freedom = self._latest
        levels = self.detector.levels
        confidence = 0.0
        if SEVERITY[self._decision.condition] > 0 and levels.normal is not None:
            size = abs(value) if self.detector.two_sided else value
            confidence = float(stdtr(freedom, (size - levels.normal) / error)) if error else 1.0
        if self._drift is not None and self._drift.alarm is not None:
            confidence = max(confidence, _certainty(self._drift.alarm))
        return Suspect(fault=self.detector.fault, confidence=confidence)

    def indicator(self, flight: Mapping[str, Fit]) -> Indicator | None:
        """Return the quantity over the whole flight; None if the flight does not show it."""
        overall = self.detector.overall(flight)
        if overall is None or not np.isfinite(overall.value[0]) or not self._scatter.count:
            return None
        value = float(overall.value[0])
        half = float(stdtrit(overall.freedom[0], 0.975) * overall.error[0])
        return Indicator(
            fault=self.detector.fault,
            quantity=self.detector.quantity,
            unit=self.detector.unit,
            value=Interval(estimate=value, low=value - half, high=value + half),
            windows=self._scatter.count,
            scatter=self._scatter.deviation,
            limit=self.detector.levels.normal,
            emergency=self.detector.levels.emergency,
            baseline=self._drift.baseline.prediction() if self._drift else None,
        )


def _certainty(shift: Shift) -> float:
    return float(stdtr(10.0, abs(shift.value) / shift.error))
