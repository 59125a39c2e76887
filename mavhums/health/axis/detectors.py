"""Detectors of axes: a loss of control effectiveness, an attitude that is not followed, a hard-over surface.

:data:`DETECTORS` is their table; all pass the same checks, ``tests/health/axis/test_detectors.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import degrees, exp, isnan, log, nan, sqrt
from typing import ClassVar, NamedTuple, Protocol

from mavhums.core.conditions import Condition
from mavhums.health.axis.effectiveness import EffectivenessTracker
from mavhums.health.axis.reference import Loss, Second
from mavhums.health.axis.residuals import Deviation, PitchTracking, Residual, RollTracking
from mavhums.health.axis.thresholds import (
    JUDGED_ERROR,
    PERSISTENT_S,
    SHIFT_FLOOR_RAD_S,
    SHIFT_S,
    SKID_DEVIATIONS,
    SKID_SHARES,
    UNKNOWN_ROLL_DEVIATIONS,
)
from mavhums.health.decision.limits import MOST_CONFIDENCE
from mavhums.health.sequential import EXCLUDING
from mavhums.results.sections import AxisLimits
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.surfaces import AXES, STEERING


class Alarm(NamedTuple):
    """A fault that is certain according to a detector, in the second that ends at ``end_s``.

    ``error`` is the standard error of an effectiveness, 0 of other values.
    """

    axis: str
    end_s: int
    fault: str
    condition: Condition
    since_s: int
    value: float
    limit: float
    rule: str
    confidence: float = MOST_CONFIDENCE
    error: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class AxisInput:
    """Input of the detectors: new rows, the effectiveness of each axis and the side force in each second."""

    rows: Rows
    seconds: Mapping[str, Sequence[Second]]
    trackers: Mapping[str, EffectivenessTracker]
    sides: Mapping[int, Deviation]

    def shift_deviations(self, axis: str, second: Second, error: float = 0.0) -> float:
        """Return the shift of an axis's trim, in deviations of the reference; NaN if it is not known.

        What ``error`` explains, rad/s, does not count.
        """
        reference = self.trackers[axis].reference
        if reference is None or second.shift is None:
            return nan
        beyond = max(abs(second.shift) - error, 0.0)
        return beyond / max(reference.deviation, SHIFT_FLOOR_RAD_S)


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
    """Reports an axis with a certain loss of effectiveness, or a certain lag.

    The axis is degraded at once. It is an emergency if the loss is within that limit with 95 %, which a slow
    servo that explains the response as well excludes.

    Parameters
    ----------
    limits
        Limits of the profile.
    axis
        ``roll``, ``pitch``, ``yaw`` or ``steering``.
    """

    inspect: ClassVar[Mapping[str, str]] = {
        "effectiveness": "each surface of the axis, its linkage and its servo, by moving it on the ground",
        "slow": "each servo of the axis for speed under load, its supply and its linkage for binding",
    }

    def __init__(self, limits: AxisLimits, axis: str) -> None:
        self._limits, self._axis = limits, axis

    def feed(self, given: AxisInput) -> list[Alarm]:
        """Return the seconds in which a loss is certain."""
        seconds = given.seconds[self._axis]
        return [self._alarm(s, s.loss) for s in seconds if s.loss is not None and s.loss.certain]

    def _alarm(self, second: Second, loss: Loss) -> Alarm:
        limits, confidence = self._limits, 1.0 / (1.0 + exp(-loss.evidence))
        condition: Condition = "degraded"
        if loss.lag_s is not None:
            fault, value, limit = "slow", loss.lag_s, limits.lag_s
            rule = _slow(second, loss.lag_s, self._axis)
        else:
            fault, value, limit = "effectiveness", loss.kept, limits.effectiveness_degraded
            left = max(round(loss.kept, 3), 0.0)  # rounded as the verdict's own figure
            rule = f"{100 * left:.0f} % of the control effectiveness of the reference is left"
            if loss.kept <= limits.effectiveness_emergency and loss.grave >= 1.0 - exp(-EXCLUDING):
                condition, limit = "emergency", limits.effectiveness_emergency
        rule = f"{condition}: {rule}"
        found = (self._axis, second.end_s, fault, condition, loss.since_s, value, limit, rule, confidence)
        return Alarm(*found, loss.error)


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
        for left in self._residual.feed(given.rows):
            since_s = self._persistent.feed(left.end_s, left.deviations)
            if since_s is None:
                continue
            away = f"{self._axis} {degrees(left.value):.0f}° away from the demanded one for {SHIFT_S} s"
            shown = (since_s, left.deviations, self._limit, f"emergency: {away}")
            alarms.append(Alarm(self._axis, left.end_s, "tracking", "emergency", *shown))
        return alarms


class HardOverDetector:
    """Hard-over surface: the roll rate differs from the one commanded.

    The shift is what the roll regression leaves over three seconds, in standard deviations of the reference.
    The limit lies a quarter above the highest value of the healthy development flights.

    Parameters
    ----------
    limits
        Limits of the profile.
    axis
        ``roll``, or ``steering`` for the yaw rate of a rover or a boat, whose side force shows nothing else.
    """

    inspect: ClassVar[Mapping[str, str]] = {
        "hard_over": "for a surface that stays deflected: its servo, its linkage, its trim"
    }

    def __init__(self, limits: AxisLimits, axis: str = "roll") -> None:
        self._limit, self._axis = limits.trim_deviations, axis
        self._persistent = Persistent(self._limit)

    def feed(self, given: AxisInput) -> list[Alarm]:
        """Return the seconds in which the trim has shifted for certain."""
        steers = self._axis == STEERING
        alarms = []
        for second in given.seconds[self._axis]:
            # A strong manoeuvre leaves a response by the error of the gain alone.
            certain = given.shift_deviations(self._axis, second, second.shift_error)
            since_s = self._persistent.feed(second.end_s, certain)
            if since_s is None or second.shift is None:
                continue
            moves, what = ("turns", "its steering") if steers else ("rolls", "an aileron or elevon")
            way = "right" if second.shift > 0 else "left"
            rule = (
                f"emergency: {moves} {way} {degrees(abs(second.shift)):.0f}°/s more than commanded, "
                f"as if {what} stayed deflected or did not move"
            )
            end_s, limit = second.end_s, self._limit
            alarms.append(Alarm(self._axis, end_s, "hard_over", "emergency", since_s, certain, limit, rule))
        return alarms


class Skids:
    """Reports that a rudder, not an aileron, stays deflected: by the side force beside the roll.

    Under either hypothesis the side force of a second scatters normally about zero, with a part in proportion
    to the roll that goes astray, which a rudder makes larger. The evidence sums the logarithms of the
    likelihood ratios since the skid began; seconds whose means overlap count once.

    No detector of its own: aircraft skid without a fault, too. The monitor takes these alarms beside a roll
    or a pitch that goes astray.
    """

    def __init__(self) -> None:
        self._evidence, self._since_s = 0.0, 0
        self._roll = 0.0  # deviations, the latest that are known

    def feed(self, given: AxisInput) -> list[Alarm]:
        """Return the seconds in which a rudder is certain."""
        rolls = {second.end_s: given.shift_deviations("roll", second) for second in given.seconds["roll"]}
        alarms = []
        for end_s, side in given.sides.items():
            if self._evidence <= 0.0 or isnan(side.deviations):
                # The mean of the first second is over as many.
                self._evidence, self._since_s = 0.0, end_s - SHIFT_S
            roll = rolls.get(end_s, nan)
            # Without any roll both surfaces are alike, and the limit has no value. One beyond what the
            # regression covers is no less than before.
            self._roll = max(self._roll, UNKNOWN_ROLL_DEVIATIONS) if isnan(roll) else max(roll, 0.1)
            if isnan(side.deviations):
                continue
            aileron, rudder = (SKID_DEVIATIONS**2 + (share * self._roll) ** 2 for share in SKID_SHARES)
            apart = 1.0 / aileron - 1.0 / rudder
            limit = sqrt(log(rudder / aileron) / apart)  # at which both are as likely
            self._evidence += (side.deviations**2 - limit**2) * apart / 2.0 / SHIFT_S
            if self._evidence >= EXCLUDING and side.deviations > limit:
                way = "right" if side.value > 0 else "left"
                rule = (
                    f"emergency: a side force of {abs(side.value):.1f} m/s² to the {way} that no turn "
                    "explains, as if a rudder stayed deflected or did not move"
                )
                since_s, deviations = self._since_s, side.deviations
                alarms.append(Alarm("yaw", end_s, "hard_over", "emergency", since_s, deviations, limit, rule))
        return alarms


DETECTORS: tuple[Callable[[AxisLimits], AxisDetector], ...] = (
    HardOverDetector,
    lambda limits: EffectivenessDetector(limits, "pitch"),
    lambda limits: TrackingDetector("pitch", PitchTracking(), limits.pitch_tracking_deviations, PERSISTENT_S),
    lambda limits: EffectivenessDetector(limits, "roll"),
    lambda limits: TrackingDetector("roll", RollTracking(), limits.roll_tracking_deviations, SHIFT_S),
    lambda limits: EffectivenessDetector(limits, "yaw"),
)

GROUND_DETECTORS: tuple[Callable[[AxisLimits], AxisDetector], ...] = (
    lambda limits: HardOverDetector(limits, STEERING),
    lambda limits: EffectivenessDetector(limits, STEERING),
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
    'for a surface that stays deflected: its servo, its linkage, its trim'
    """
    kinds = (EffectivenessDetector, TrackingDetector, HardOverDetector)
    return next((kind.inspect[fault] for kind in kinds if fault in kind.inspect), None)
