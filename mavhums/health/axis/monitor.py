"""Health monitoring of an aircraft's axes through a flight, from rows to changes and findings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from mavhums.core.arrays import Array
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import NORMAL_95
from mavhums.health.axis.detectors import Alarm, AxisInput, Skids, detectors
from mavhums.health.axis.effectiveness import EffectivenessTracker
from mavhums.health.axis.findings import AxisFindings, origins
from mavhums.health.axis.reference import Second
from mavhums.health.axis.residuals import Residual, SideForce
from mavhums.health.axis.thresholds import GROUND_SPEED_SHARE, JUDGED_ERROR, LONGEST_REFERENCE_S, MASKED_S
from mavhums.health.decision.events import ConditionChanged, Indication, Trace
from mavhums.health.decision.thresholds import FALSE_ALARMS, NORMAL_S
from mavhums.health.estimation.random_effects import RunningVariance
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import Coverage, Evidence, Interval, Suspect
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.surfaces import AXES

AxisChange = ConditionChanged | Indication | Trace
_MOST_EPISODES: Final = 100  # kept for the evidence
_LATEST_EPISODES: Final = 3  # among which an alarm finds its own


@dataclass(slots=True)
class _AxisState:
    """The condition of one axis."""

    condition: Condition = "undecided"
    worst: Condition = "undecided"
    since_s: int | None = None
    seconds: int = 0
    judged: int = 0
    counted: int = 0
    lost: bool = False
    full: int = 0
    quiet: int = 0  # seconds in which no loss is suspected: the same throughout one suspicion
    excluded_s: int = 0
    excluded_until_s: float | None = None
    doubt: Interval | None = None
    value: Interval | None = None
    mean: RunningVariance = field(default_factory=RunningVariance)
    episodes: list[Alarm] = field(default_factory=list)


class AxisMonitor:
    """Judges roll, pitch and yaw of one vehicle, or its steering.

    An axis is normal when the test excludes a loss of 40 % over thirty seconds after the reference; it is
    normal again after a fault when its effectiveness exceeds 80 % for twenty seconds in a row.

    Parameters
    ----------
    vehicle
        System id.
    limits
        Limits from which an axis is degraded, or an emergency.
    axes
        Roll, pitch and yaw, or the steering of a rover or a boat.
    mixed
        By axis that two mixed surfaces move, the other one, if its command distinguishes them.
    false_alarms
        Accepted number of false alarms of a loss in 100 hours of an axis.
    traced
        Whether to yield what lies behind the judgement as well.
    """

    def __init__(
        self,
        vehicle: int,
        limits: AxisLimits | None = None,
        axes: Sequence[str] = AXES,
        mixed: Mapping[str, str] | None = None,
        false_alarms: float = FALSE_ALARMS,
        *,
        traced: bool = False,
    ) -> None:
        self._vehicle = vehicle
        self.limits = limits or AxisLimits()
        self.axes = tuple(axes)
        coupled = mixed or {}
        self._gains = {
            axis: EffectivenessTracker(axis, self.limits, coupled.get(axis), false_alarms, traced=traced)
            for axis in axes
        }
        self._mixed, self._surfaces = {*coupled, *coupled.values()}, dict[tuple[str, int], Array]()
        self._detectors = detectors(self.limits, axes)
        self._axes = {axis: _AxisState() for axis in axes}
        self._side, self._skids = Residual(SideForce()), Skids()
        self._skidded_s = self._astray_s = -(1 << 30)
        self._flew, self._slowest_m_s = False, np.inf

    def feed(self, rows: Rows) -> Iterator[AxisChange]:
        """Process rows; yield the effectiveness of each axis, then the changes of condition in time order."""
        self._look_for_take_off(rows)
        seconds = {axis: gain.feed(rows) for axis, gain in self._gains.items()}
        # The side force of a rover or a boat says nothing about its steering.
        sides = {left.end_s: left for left in self._side.feed(rows)} if "yaw" in self.axes else {}
        seen = AxisInput(rows, seconds, self._gains, sides)
        skids = {one.end_s: one for one in self._skids.feed(seen)} if sides else {}
        yield from self._indications(seconds)
        yield from self._traces()
        shown: dict[int, list[Alarm]] = {}
        for detector in self._detectors:
            for one in detector.feed(seen):
                shown.setdefault(one.end_s, []).append(one)
        judged = {axis: {second.end_s: second for second in seconds[axis]} for axis in self.axes}
        for end_s in range(rows.second + 1, rows.second + rows.seconds + 1):
            now = shown.get(end_s, [])
            if any(one.fault in ("hard_over", "tracking") for one in now):
                self._astray_s = end_s
            # A skid alone is no fault; one while the aircraft goes astray is a rudder's.
            if end_s in skids and end_s - self._astray_s <= MASKED_S:
                now = [*now, skids[end_s]]
            # A skid rolls and pitches the aircraft: what follows about the other axes is its consequence.
            if any(one.axis == "yaw" and one.fault == "hard_over" for one in now):
                self._skidded_s = end_s
            for axis in self.axes:
                masked = axis != "yaw" and end_s - self._skidded_s <= MASKED_S
                found = [one for one in now if one.axis == axis and not masked]
                second = None if self._may_hold_fault(axis) else judged[axis].get(end_s)
                if found or second is not None:
                    yield from self._take(axis, second, found, end_s)

    def _look_for_take_off(self, rows: Rows) -> None:
        """Take the slowest second before the first one of flight."""
        if not self._flew:
            self._flew = bool(rows.flying.any())
            waits_s = int(np.argmax(rows.flying)) // RATE_HZ if self._flew else rows.seconds
            before = rows.speed.reshape(-1, RATE_HZ)[:waits_s].max(axis=1)
            self._slowest_m_s = float(np.fmin.reduce(before, initial=self._slowest_m_s))

    def _indications(self, seconds: dict[str, list[Second]]) -> Iterator[Indication]:
        for axis, found in seconds.items():
            known = [
                (s.end_s, s.value, NORMAL_95 * s.error)
                for s in found
                if s.value is not None and s.error <= JUDGED_ERROR
            ]
            if known:
                end_s, value, half = np.array(known, dtype=np.float64).T
                yield Indication(
                    self._vehicle, axis, "effectiveness", end_s, value, value - half, value + half
                )

    def _traces(self) -> Iterator[Trace]:
        for axis, gain in self._gains.items():
            span = (gain.reference.start_s, gain.reference.end_s) if gain.reference else None
            for kind, rows in gain.traces():
                yield Trace(self._vehicle, axis, kind, rows[:, 0], rows[:, 1:], span)

    def _take(
        self, axis: str, second: Second | None, found: list[Alarm], end_s: int
    ) -> Iterator[ConditionChanged]:
        state, well = self._axes[axis], self.well(axis)
        before = state.condition
        if second is not None:
            self._count(state, second)
        if found:
            worst = max(found, key=lambda one: SEVERITY[one.condition])
            state.full = 0
            fresh = SEVERITY[before] <= SEVERITY["normal"]
            others = [one for name, one in self._axes.items() if name != axis]
            # A milder finding does not lift a graver one: only full effectiveness ends a fault.
            if fresh or SEVERITY[worst.condition] > SEVERITY[before]:
                state.condition = worst.condition
                state.since_s = worst.since_s if fresh else min(worst.since_s, state.since_s or worst.since_s)
            if fresh and not any(SEVERITY[one.condition] > SEVERITY["normal"] for one in others):
                self._surfaces.clear()
            for one in found:
                self._extend(state, one)
            self._measure(state, found, fresh=fresh)
            fault, rule = worst.fault, worst.rule
            finding = f"control {100 * max(worst.value, 0.0):.0f}%" if fault == "effectiveness" else fault
        elif second is not None and self._is_healthy(state):
            if before != well:
                state.condition, state.since_s = well, end_s if before != "undecided" else None
                state.lost = False
            fault, rule = "effectiveness", f"{well}: the control effectiveness of the reference is kept"
            finding = ""
        elif before == well and state.doubt is not None and second is not None and second.loss is not None:
            # The evidence for a loss is near an alarm: it is no longer excluded.
            state.condition, state.since_s = "undecided", second.loss.since_s
            fault, rule = "effectiveness", f"undecided: {_percent(state.doubt)} is left by the last seconds"
            finding = ""
        if second is not None and second.loss is not None and second.loss.surfaces is not None:
            self._surfaces[axis, state.quiet] = second.loss.surfaces
        if SEVERITY[state.condition] > SEVERITY[state.worst]:
            state.worst = state.condition
        # A mean over a change would belong to neither condition.
        if state.condition != before:
            state.mean, state.counted = RunningVariance(), 0
            if state.condition == well and before != "undecided" and second is not None:
                self._average(state, second.value or 0.0, second.error)
            since_s = float(state.since_s if state.since_s is not None else end_s)
            yield ConditionChanged(
                self._vehicle, axis, float(end_s), since_s, before, state.condition, rule, fault, finding
            )

    def well(self, axis: str) -> Condition:
        """Return the condition of an axis that responds as in its reference.

        A reference from a flight that was already damaged would call the damage normal.
        """
        reference = self._gains[axis].reference
        took_off = reference and self._slowest_m_s < GROUND_SPEED_SHARE * reference.basis.speed
        return "normal" if took_off else "unchanged"

    def _may_hold_fault(self, axis: str) -> bool:
        """Return whether the reference ends during a fault: it shows neither its size nor its end."""
        state, reference = self._axes[axis], self._gains[axis].reference
        if SEVERITY[state.condition] <= SEVERITY["normal"] or state.since_s is None:
            return False
        return reference is not None and reference.end_s > state.since_s

    def _count(self, state: _AxisState, second: Second) -> None:
        state.seconds += 1
        state.quiet += second.loss is None
        if SEVERITY[state.condition] <= SEVERITY["normal"]:
            state.excluded_s += second.excluded
            state.excluded_until_s = float(second.end_s) if second.excluded else state.excluded_until_s
        loss = second.loss
        state.doubt = None if loss is None else Interval.around(loss.kept, NORMAL_95 * loss.error)
        if second.value is None or second.error > JUDGED_ERROR:
            return
        state.judged += 1
        state.counted += 1
        state.full = state.full + 1 if second.value >= self.limits.effectiveness_degraded else 0
        # Windows that share seconds are one piece of evidence. The first one counts at once, so that a value
        # is shown.
        whole = state.counted % WINDOW_S == 0 or state.judged == 1
        if whole and not state.lost:
            self._average(state, second.value, second.error)

    def _measure(self, state: _AxisState, found: list[Alarm], *, fresh: bool) -> None:
        """Take the effectiveness since the onset of a loss: that of the second which the reason names."""
        if fresh:
            state.value = None
        reasons = [(one.rule, one.error) for one in state.episodes[-_LATEST_EPISODES:]]
        for one in found:
            if one.fault == "effectiveness" and (one.rule, one.error) in reasons:
                state.lost, state.value = True, Interval.around(one.value, NORMAL_95 * one.error)

    def _average(self, state: _AxisState, value: float, error: float) -> None:
        """Add a window that does not overlap the previous one to the mean since the last change."""
        state.mean.add(value)
        mean, count = state.mean.mean, state.mean.count
        half = NORMAL_95 * (max(state.mean.variance, error**2) / count) ** 0.5
        state.value = Interval.around(mean, half)

    def _is_healthy(self, state: _AxisState) -> bool:
        """Return whether the axis is known to respond as in the reference."""
        if SEVERITY[state.condition] > SEVERITY["normal"]:
            # An axis is well again only when the gain itself is back, not when evidence runs out: over two
            # windows that share no second.
            return state.full >= 2 * WINDOW_S
        return state.excluded_s >= NORMAL_S and state.doubt is None

    def _extend(self, state: _AxisState, one: Alarm) -> None:
        """Add the alarm to its episode, or begin one; if there are too many, the middle ones are dropped."""
        episodes = state.episodes
        latest = range(max(len(episodes) - _LATEST_EPISODES, 0), len(episodes))
        for k in latest:
            kinds = (one.fault, episodes[k].fault, episodes[k].condition)
            # What first looked like a loss was the beginning of this lag.
            if kinds == ("slow", "effectiveness", "degraded") and episodes[k].since_s == one.since_s:
                episodes[k] = episodes[k]._replace(fault=one.fault)
        same = next((k for k in reversed(latest) if episodes[k].fault == one.fault), None)
        # Alarms that are no farther apart are of one fault, which the air hid for a while.
        if same is not None and episodes[same].end_s >= one.end_s - 2 * MASKED_S:
            earlier = episodes[same]
            # The reason of the worst moment stays, and of these the best known one: later seconds of the same
            # fault often say less.
            kept = max(one, earlier, key=lambda each: (SEVERITY[each.condition], -each.error))
            episodes[same] = kept._replace(since_s=earlier.since_s, end_s=one.end_s)
            return
        if len(episodes) == _MOST_EPISODES:
            # Memory stays bounded; the first and the last ones show most.
            del episodes[_MOST_EPISODES // 2]
        episodes.append(one)

    def findings(self, axis: str) -> AxisFindings:
        """Return the findings so far about an axis."""
        state, gain = self._axes[axis], self._gains[axis]
        suspects: dict[str, float] = {}
        for episode in state.episodes:
            suspects[episode.fault] = max(suspects.get(episode.fault, 0.0), episode.confidence)
        judged = min(max(state.judged, state.excluded_s), state.seconds)
        fraction = judged / state.seconds if state.seconds else 0.0
        return AxisFindings(
            axis=axis,
            condition=state.condition,
            worst=state.worst,
            since_s=_since_s(state),
            coverage=Coverage(
                moving_fraction=fraction,
                windows=state.seconds,
                decidable=judged,
                excluded=gain.excluded_s + state.excluded_s,
                excluded_until_s=state.excluded_until_s,
                judged_from_s=_late_s(gain),
            ),
            suspects=tuple(
                Suspect(fault=fault, confidence=confidence)
                for fault, confidence in sorted(suspects.items(), key=lambda item: -item[1])
            ),
            evidence=tuple(
                Evidence(
                    kind=e.fault, start_s=e.since_s, end_s=e.end_s, value=e.value, limit=e.limit, rule=e.rule
                )
                for e in state.episodes
            ),
            effectiveness=state.value,
            doubt=state.doubt,
            windows=0 if state.lost else state.mean.count,
            reference=gain.reference,
            best=gain.best,
            usable_s=gain.usable_s,
            spacing_s=gain.spacing_s,
            limits=self.limits,
            highest_evidence=gain.highest_evidence,
            shares=self._named() if axis in self._mixed else {},
        )

    def _named(self) -> dict[str, float]:
        """Return which of two mixed surfaces all suspicions of both axes show; empty without any."""
        if not self._surfaces:
            return {}
        likely = np.prod([*self._surfaces.values()], axis=0) + np.finfo(np.float64).tiny
        return dict(zip(("left", "right", "both"), (likely / likely.sum()).tolist(), strict=True))

    def origins(self) -> dict[str, str]:
        """Return of each axis whose finding that of another one explains, that other axis."""
        found = {axis: self.findings(axis) for axis in self.axes}
        faulty = {
            axis: one.evidence
            for axis, one in found.items()
            if one.evidence and SEVERITY[one.worst] > SEVERITY["normal"]
        }
        return origins(faulty, self._mixed)


def _late_s(gain: EffectivenessTracker) -> float | None:
    """Return the flight second at which a late reference ends, which may hold a fault; None of others."""
    late = gain.reference is not None and gain.usable_s > LONGEST_REFERENCE_S
    return float(gain.reference.end_s) if late and gain.reference is not None else None


def _percent(kept: Interval) -> str:
    return f"{100 * kept.estimate:.0f} % ({100 * kept.low:.0f}–{100 * kept.high:.0f})"


def _since_s(state: _AxisState) -> float | None:
    """Return the onset of the present condition: the earliest one that its evidence shows.

    A fault that takes longer to prove than the one that raised the alarm may have begun before it.
    """
    if state.since_s is None or SEVERITY[state.condition] <= SEVERITY["normal"]:
        return None if state.since_s is None else float(state.since_s)
    return float(min([state.since_s, *(e.since_s for e in state.episodes if e.end_s > state.since_s)]))
