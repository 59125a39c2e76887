"""Detectors of axes: a loss of control effectiveness, an attitude that is not followed, a hard-over surface.

:data:`DETECTORS` is their table; all pass the same checks, ``tests/health/axis/test_detectors.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import degrees, exp, nan
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from mavhums.core.conditions import Condition
from mavhums.core.statistics import NORMAL_95, NORMAL_99
from mavhums.health.axis.effectiveness import EffectivenessTracker
from mavhums.health.axis.reference import Second
from mavhums.health.axis.residuals import Deviation, PitchTracking, Residual, RollTracking
from mavhums.health.axis.thresholds import (
    CERTAIN_PITCH,
    CERTAIN_ROLL,
    CERTAIN_STEERING,
    CERTAIN_YAW,
    COARSE_TIMES,
    COMMON_PITCH,
    DOUBTFUL_S,
    DOUBTFUL_TIMES,
    EMERGENCY_S,
    JUDGED_ERROR,
    PERSISTENT_S,
    ROLL_PERSISTENT_S,
    SHIFT_FLOOR_RAD_S,
    SHIFT_S,
    SKID_DEVIATIONS,
    SKID_M_S2,
    SLOW_STREAM_S,
    SURE_CONFIDENCE,
    TRIM_SHIFT_DEVIATIONS,
)
from mavhums.results.sections import AxisLimits
from mavhums.results.standing import Interval
from mavhums.vehicle.flight import Rows
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.surfaces import AXES, STEERING


class Alarm(NamedTuple):
    """A fault that is certain according to a detector, in the second that ends at ``end_s``."""

    axis: str
    end_s: int
    fault: str
    condition: Condition
    since_s: int
    value: float
    limit: float
    rule: str
    confidence: float


@dataclass(frozen=True, slots=True, eq=False)
class AxisInput:
    """Input of the detectors: new rows, the effectiveness of each axis and the side force in each second."""

    rows: Rows
    seconds: Mapping[str, Sequence[Second]]
    trackers: Mapping[str, EffectivenessTracker]
    sides: Mapping[int, Deviation]

    def shift_deviations(self, axis: str, second: Second) -> float:
        """Return the shift of an axis's trim, in deviations of the reference; NaN if it is not known."""
        reference = self.trackers[axis].reference
        if reference is None or second.shift is None:
            return nan
        return abs(second.shift) / max(reference.deviation, SHIFT_FLOOR_RAD_S)


class AxisDetector(Protocol):
    """Detects one kind of fault."""

    inspect: ClassVar[Mapping[str, str]]
    """The parts that the maintainer should inspect, by fault."""

    def feed(self, given: AxisInput) -> list[Alarm]:
        """Return the certain faults in each new second."""
        ...


class Persistent:
    """Tracks since when deviations exceed a limit, if they do so for ``seconds`` in a row."""

    def __init__(self, limit: float, seconds: int = PERSISTENT_S) -> None:
        self._limit = limit
        self._seconds = seconds
        self._run = 0
        self._since_s = 0

    def feed(self, end_s: int, deviations: float) -> int | None:
        """Return the flight second of the onset if enough in a row exceed the limit; else None."""
        if not deviations > self._limit:  # NaN as well: what is not known ends a run
            self._run = 0
            return None
        if self._run == 0:
            self._since_s = end_s - 1
        self._run += 1
        return self._since_s if self._run >= self._seconds else None


class EffectivenessDetector:
    """Reports an axis whose CUSUM exceeds its limit.

    The axis is degraded at once. It is an emergency if the effectiveness over at least ten judged seconds
    is within the limit and no additional lag, as of a slow servo, explains them better.

    Parameters
    ----------
    limits
        Limits of the profile.
    axis
        ``roll``, ``pitch`` or ``yaw``.
    certain
        CUSUM that makes a loss certain.
    common
        Effectiveness down to which healthy flights go for tens of seconds; above it the limit is doubled.
    """

    inspect: ClassVar[Mapping[str, str]] = {
        "effectiveness": "each surface of the axis, its linkage and its servo, by moving it on the ground",
        "slow": "each servo of the axis for speed under load, its supply and its linkage for binding",
    }

    def __init__(self, limits: AxisLimits, axis: str, certain: float, common: float = 1.0) -> None:
        self._limits, self._axis, self._certain, self._common = limits, axis, certain, common

    def feed(self, given: AxisInput) -> list[Alarm]:
        """Return the seconds in which a loss is certain."""
        return [self._alarm(s) for s in given.seconds[self._axis] if self._is_certain(s, given)]

    def _is_certain(self, second: Second, given: AxisInput) -> bool:
        """Return whether a loss is certain, and not an artefact of a sudden shift of the trim."""
        reference = given.trackers[self._axis].reference
        left = second.left_over if second.left_over is not None else 1.0
        doubtful = second.lost_s < DOUBTFUL_S or (left > self._common and not second.later)
        # A single manoeuvre may differ, and gusts lower the gain of calm references for a while.
        limit = self._certain * (DOUBTFUL_TIMES if doubtful else 1.0)
        if second.level <= limit or reference is None:
            return False
        # A lag that the profile allows is no fault, however certain it is.
        if second.slow_s is not None and second.slow_s < self._limits.lag_s:
            return False
        # A sudden shift of the trim also reads as a loss for some seconds; it is for the detector of hard-
        # overs.
        if self._axis not in ("roll", STEERING) or second.shift is None or second.lost_s >= DOUBTFUL_S:
            return True
        return abs(second.shift) <= TRIM_SHIFT_DEVIATIONS * max(reference.deviation, SHIFT_FLOOR_RAD_S)

    def _alarm(self, second: Second) -> Alarm:
        left = second.left_over if second.left_over is not None else 1.0
        limits, confidence = self._limits, 1.0 / (1.0 + exp(-second.level))
        condition: Condition = "degraded"
        if second.slow_s is not None:
            fault, value, limit = "slow", second.slow_s, limits.lag_s
            rule = _slow(second, second.slow_s, self._axis)
        else:
            grave = left <= limits.effectiveness_emergency
            doubt = self._doubt(second) if grave else ""
            condition = "emergency" if grave and not doubt else "degraded"
            fault, value = "effectiveness", left
            limit = (
                limits.effectiveness_emergency if condition == "emergency" else limits.effectiveness_degraded
            )
            rule = (
                f"{100 * max(left, 0.0):.0f} % of the control effectiveness of the reference is left{doubt}"
            )
        rule = f"{condition}: {rule}"
        return Alarm(
            self._axis, second.end_s, fault, condition, second.since_s, value, limit, rule, confidence
        )

    def _doubt(self, second: Second) -> str:
        """Return why a loss within the emergency's limit is none yet."""
        if second.later:
            return "; a slow servo explains it nearly as well"
        if second.lost_s < EMERGENCY_S:
            return f"; an emergency if {EMERGENCY_S} judged seconds show it, {second.lost_s} do"
        return ""


class PooledDetector:
    """Reports a loss that a minute of driven flight shows, where the CUSUM forgets it.

    The axis is degraded where the effectiveness over those seconds is below the limit with 99 %.

    Parameters
    ----------
    limits
        Limits of the profile.
    axis
        ``pitch``: in roll healthy flights come too close (docs/evidence/axes.md).
    """

    inspect: ClassVar[Mapping[str, str]] = EffectivenessDetector.inspect

    def __init__(self, limits: AxisLimits, axis: str) -> None:
        self._limit, self._axis = limits.effectiveness_degraded, axis

    def feed(self, given: AxisInput) -> list[Alarm]:
        """Return the seconds in which a loss is certain."""
        return [
            self._alarm(second, second.driven)
            for second in given.seconds[self._axis]
            if second.driven is not None and second.steady and self._is_certain(second.driven)
        ]

    def _is_certain(self, kept: Interval) -> bool:
        return kept.estimate + NORMAL_99 / NORMAL_95 * (kept.high - kept.estimate) < self._limit

    def _alarm(self, second: Second, kept: Interval) -> Alarm:
        left = f"{100 * max(kept.estimate, 0.0):.0f} % of the control effectiveness of the reference is left"
        rule = f"degraded: {left} over the last minute"
        return Alarm(
            self._axis,
            second.end_s,
            "effectiveness",
            "degraded",
            second.since_s,
            kept.estimate,
            self._limit,
            rule,
            SURE_CONFIDENCE,
        )


def _slow(second: Second, late_s: float, axis: str) -> str:
    """Return what a lag does: the share that is answered in time is no loss of gain."""
    intact = f"gain intact, {late_s:g} s late"
    if second.value is None or second.error > JUDGED_ERROR or not 0 <= second.value < 1:
        return intact
    return f"{100 * second.value:.0f} % of the commanded {axis} is answered in time ({intact})"


class TrackingDetector:
    """Reports an attitude that leaves the commanded one, as when no surface answers any more.

    Parameters
    ----------
    axis
        ``roll`` or ``pitch``.
    tracking
        The model of the axis.
    limit
        Deviations from the healthy flight from which it is an emergency.
    seconds
        Seconds in a row for which the limit must be exceeded.
    """

    inspect: ClassVar[Mapping[str, str]] = {
        "tracking": "every surface of the axis, and whether the autopilot was overridden"
    }

    def __init__(self, axis: str, tracking: RollTracking | PitchTracking, limit: float, seconds: int) -> None:
        self._axis = axis
        self._limit = limit
        self._residual = Residual(tracking)
        self._persistent = Persistent(self._limit, seconds)

    def feed(self, given: AxisInput) -> list[Alarm]:
        """Return the seconds in which the attitude is away for certain."""
        alarms = []
        coarse = _coarse(given.rows)
        for left in self._residual.feed(given.rows):
            # At 2 Hz a turn begins and ends between two samples, and the model answers at neither.
            limit = self._limit * (COARSE_TIMES if coarse[left.end_s - given.rows.second - 1] else 1.0)
            since_s = self._persistent.feed(left.end_s, left.deviations * self._limit / limit)
            if since_s is None:
                continue
            away = f"{self._axis} {degrees(left.value):.0f}° away from the demanded one"
            rule = f"emergency: {away} for {SHIFT_S} s"
            alarms.append(
                Alarm(
                    self._axis,
                    left.end_s,
                    "tracking",
                    "emergency",
                    since_s,
                    left.deviations,
                    limit,
                    rule,
                    SURE_CONFIDENCE,
                )
            )
        return alarms


def _coarse(rows: Rows) -> list[bool]:
    """Return of each second whether its samples lie too far apart to follow a turn."""
    spacing = np.nan_to_num(rows.spacing).reshape(-1, RATE_HZ).mean(axis=1)
    return [bool(coarse) for coarse in spacing > SLOW_STREAM_S]


class HardOverDetector:
    """Hard-over surface: the roll rate differs from the one commanded, and perhaps the aircraft skids.

    The shift is what the roll regression leaves over three seconds, in standard deviations of the reference.
    Where the side force leaves its own reference even further, a rudder stands deflected, not an aileron. The
    limit lies a quarter above the highest value of the healthy development flights.

    Parameters
    ----------
    limits
        Limits of the profile.
    axis
        ``roll``, or ``steering`` for the yaw rate of a rover or a boat, whose side force tells nothing else.
    """

    inspect: ClassVar[Mapping[str, str]] = {
        "hard_over": "for a surface that stands deflected: its servo, its linkage, its trim"
    }

    def __init__(self, limits: AxisLimits, axis: str = "roll") -> None:
        self._limit, self._axis = limits.trim_deviations, axis
        self._persistent = Persistent(self._limit)

    def feed(self, given: AxisInput) -> list[Alarm]:
        """Return the seconds in which the trim has shifted for certain."""
        steers = self._axis == STEERING
        alarms = []
        for second in given.seconds[self._axis]:
            deviations = given.shift_deviations(self._axis, second)
            since_s = self._persistent.feed(second.end_s, deviations)
            if since_s is None or second.shift is None:
                continue
            side = given.sides.get(second.end_s)
            skids = (
                side is not None
                and side.deviations > max(SKID_DEVIATIONS, deviations)
                and abs(side.value) > SKID_M_S2
            )
            # Rudder before aileron: a deflected rudder rolls the aircraft, too, a deflected aileron hardly
            # skids.
            axis, what = ("yaw", "a rudder") if skids else (self._axis, "an aileron or elevon")
            what = "its steering" if steers else what
            way = "right" if second.shift > 0 else "left"
            moves = "turns" if steers else "rolls"
            rule = (
                f"emergency: {moves} {way} {degrees(abs(second.shift)):.0f}°/s more than commanded, "
                f"as if {what} stood deflected or did not move"
            )
            alarms.append(
                Alarm(
                    axis,
                    second.end_s,
                    "hard_over",
                    "emergency",
                    since_s,
                    deviations,
                    self._limit,
                    rule,
                    SURE_CONFIDENCE,
                )
            )
        return alarms


DETECTORS: tuple[Callable[[AxisLimits], AxisDetector], ...] = (
    HardOverDetector,
    lambda limits: EffectivenessDetector(limits, "pitch", CERTAIN_PITCH, COMMON_PITCH),
    lambda limits: TrackingDetector("pitch", PitchTracking(), limits.pitch_tracking_deviations, PERSISTENT_S),
    lambda limits: PooledDetector(limits, "pitch"),
    lambda limits: EffectivenessDetector(limits, "roll", CERTAIN_ROLL),
    lambda limits: TrackingDetector(
        "roll", RollTracking(), limits.roll_tracking_deviations, ROLL_PERSISTENT_S
    ),
    lambda limits: EffectivenessDetector(limits, "yaw", CERTAIN_YAW),
)

GROUND_DETECTORS: tuple[Callable[[AxisLimits], AxisDetector], ...] = (
    lambda limits: HardOverDetector(limits, STEERING),
    lambda limits: EffectivenessDetector(limits, STEERING, CERTAIN_STEERING),
)
"""Those of the steering of rovers and boats."""


def detectors(limits: AxisLimits, axes: Sequence[str] = AXES) -> list[AxisDetector]:
    """Return the detectors of an aircraft's axes, or of the steering."""
    return [detector(limits) for detector in (GROUND_DETECTORS if STEERING in axes else DETECTORS)]


def to_inspect(fault: str) -> str | None:
    """Return the parts to inspect for a fault of an axis; None if no detector covers it.

    Examples
    --------
    >>> to_inspect("hard_over")
    'for a surface that stands deflected: its servo, its linkage, its trim'
    """
    kinds = (EffectivenessDetector, TrackingDetector, HardOverDetector)
    return next((kind.inspect[fault] for kind in kinds if fault in kind.inspect), None)
