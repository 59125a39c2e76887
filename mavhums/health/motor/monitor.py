"""Follows the motors of one multirotor: takes seconds of its signals, yields changes of condition."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.health.decision.events import ConditionChanged, Trace
from mavhums.health.decision.thresholds import AGREEING, FALSE_ALARMS
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.health.motor import evidence
from mavhums.health.motor.hypotheses import hypotheses_of
from mavhums.health.motor.speeds import EscSpeeds, SpeedCause, SpeedsBesideThrust
from mavhums.health.motor.thresholds import (
    BETWEEN_FLIGHTS,
    BOUND_SHARE,
    EMERGENCY_LOSS,
)
from mavhums.results.verdict import Indicator, Interval
from mavhums.vehicle.grid import RATE_HZ, SHOWN_EVERY, Seconds
from mavhums.vehicle.phases import PhaseRows
from mavhums.vehicle.rotors import Rotors
from mavhums.vehicle.signals import DERIVED
from mavhums.vehicle.vtol import hovers

TRIM: Final = "trim"
"""Fault of the indicator: thrust that a motor gives more than its share, by that share."""
TRIM_YAW: Final = "trim_yaw"
"""The part of it about yaw, which a shifted weight does not change."""

_ANOTHER_S: Final = 10.0
"""A second motor named within this time of the first: more than one lost thrust, or neither is certain."""
_TURNS, _LEANS = 0.1, 0.5
"""Mean thrust by full thrust, and cosine of the bank, above which speeds are compared: it flies upright."""
_REFINED_S: Final = 3.0
"""After an alarm the share lost is refined for as long: the trim learns what lasts longer."""


@dataclass(frozen=True, slots=True)
class ThrustLoss:
    """A motor's loss of thrust: when it was decided, since when, and the share lost.

    Attributes
    ----------
    motor
        From 1, in the autopilot's order.
    odds
        Evidence, the logarithm of the sequential test's statistic.
    """

    motor: int
    time_s: float
    since_s: float
    share: Interval
    odds: float


@dataclass(frozen=True, slots=True)
class MotorFindings:
    """What a flight shows of its motors.

    Attributes
    ----------
    rotors
        The motors.
    loss
        The motor that lost thrust; None if none did.
    several
        Motors between which the evidence does not decide; empty without doubt. ``loss`` is that of the first.
    flown_s, judged_s
        Seconds in the air, and those that were judged.
    tipped
        Whether it leaned beyond what is judged, so that what happened then is not known.
    bound
        By motor, the share of thrust that it has lost at most, with 97.5 % confidence, in 80 % of the judged
        seconds.
    indicators
        By motor, what later flights are compared with.
    cause
        What the speed of the motor that lost thrust says about the cause; None if nothing.
    withdrawn
        The gravest loss that later seconds refuted, and until when it was held; None without any.
    """

    rotors: Rotors
    loss: ThrustLoss | None
    several: tuple[int, ...]
    flown_s: float
    judged_s: float
    tipped: bool
    bound: tuple[float, ...]
    indicators: tuple[tuple[Indicator, ...], ...]
    cause: SpeedCause | None = None
    withdrawn: tuple[ThrustLoss, float] | None = None


class Trims:
    """Sums up the trim of one flight in constant memory.

    Parameters
    ----------
    columns
        Effort about roll, pitch and yaw by each motor's thrust, shape (motors, 3).
    """

    def __init__(self, columns: Array) -> None:
        self._columns = columns
        self._block: list[Array] = []
        self._blocks = 0
        self._mean, self._squares = np.zeros(3), np.zeros(3)
        self._before = np.full(3, np.nan)
        self._latest: deque[Array] = deque(maxlen=AGREEING)

    def suspect(self) -> None:
        """Hold the blocks to come against those before now."""
        self._before = self._mean if self._blocks else self._before
        self._block.clear()
        self._latest.clear()

    def refutes(self, loss: ThrustLoss) -> bool:
        """Return whether the blocks since the alarm show less than half of a loss, each by itself."""
        weights = self._weights(loss.motor - 1)
        shown = [float(weights @ (effort - self._before)) for effort in self._latest]
        return len(shown) == AGREEING and max(shown) < loss.share.low / 2

    def _weights(self, motor: int) -> Array:
        """Return the weights by which an effort shows the thrust of a motor, from 0, shape (3,)."""
        weights = self._columns[motor] / BETWEEN_FLIGHTS**2
        return np.asarray(weights / (weights @ self._columns[motor]))

    def add(self, thrusts: Array, flown: Flags) -> None:
        """Take whole seconds: thrusts, shape (n, motors), and in which rows it flew upright."""
        seconds = thrusts.reshape(-1, RATE_HZ, thrusts.shape[1]).mean(axis=1)
        # Second by second, so that the sums do not depend on how the log was cut.
        for second in np.flatnonzero(flown.reshape(-1, RATE_HZ).all(axis=1)).tolist():
            self._block.append(seconds[second])
            if len(self._block) == WINDOW_S:
                asked = np.mean(self._block, axis=0)
                self._block.clear()
                self._blocks += 1
                effort = asked @ self._columns / asked.mean()
                self._latest.append(effort)
                off = effort - self._mean
                self._mean = self._mean + off / self._blocks
                self._squares = self._squares + off * (effort - self._mean)

    def of_motor(self, motor: int) -> tuple[Indicator, ...]:
        """Return the indicators of a motor, from 0; none of a flight that is too short."""
        if self._blocks < AGREEING:
            return ()
        column = self._columns[motor]
        turns = np.array([0.0, 0.0, np.sign(column[2])])
        return (
            self._indicator(TRIM, "thrust beyond its share", self._weights(motor)),
            self._indicator(TRIM_YAW, "effort about yaw towards it", turns),
        )

    def _indicator(self, fault: str, quantity: str, weights: Array) -> Indicator:
        value = float(weights @ self._mean)
        scatter = float(np.sqrt(weights**2 @ self._squares / (self._blocks - 1)))
        mean = (value, scatter / self._blocks**0.5)
        return Indicator.of_mean(fault, quantity, "1", mean, windows=self._blocks, needed=AGREEING)


class MotorMonitor:
    """Judges the motors of one vehicle in constant memory.

    Parameters
    ----------
    vehicle
        System id.
    rotors
        Its motors.
    speeds
        The speeds that its ESCs report; none if omitted.
    false_alarms
        Accepted number of false alarms in 100 hours.
    traced
        Whether to yield what lies behind the judgement as well.
    """

    def __init__(
        self,
        vehicle: int,
        rotors: Rotors,
        speeds: EscSpeeds | None = None,
        false_alarms: float = FALSE_ALARMS,
        *,
        traced: bool = False,
    ) -> None:
        self._traced = traced
        self._vehicle, self.rotors = vehicle, rotors
        self._rules, self._hypotheses = evidence.rules_for(false_alarms), hypotheses_of(len(rotors.servos))
        self._state = evidence.new_state(len(rotors.servos))
        self._trims = Trims(rotors.columns)
        self._speeds = SpeedsBesideThrust(speeds or EscSpeeds(), rotors.servos)
        self._loss: ThrustLoss | None = None
        self._withdrawn: tuple[ThrustLoss, float] | None = None
        self._several: tuple[int, ...] = ()
        self._reported: Condition = "undecided"

    def feed(self, seconds: Seconds, phases: PhaseRows) -> Iterator[ConditionChanged | Trace]:
        """Take settled seconds that follow each other and the phases in them; yield changes of condition."""
        first, flat, thrusts = int(seconds.index[0]), seconds.rows, phases.thrusts
        # The change of the attitude comes too late and too smooth for what a motor does within 0.5 s.
        derived = np.repeat(seconds.ranks["rates"] == DERIVED, RATE_HZ)
        flat["rates"] = np.where(derived[:, None], np.nan, flat["rates"])
        spacing = flat["outputs_spacing"][:, 0]
        upright = np.cos(flat["attitude"][:, 0]) * np.cos(flat["attitude"][:, 1])
        upright = np.where(phases.held, np.nan, upright)
        # Beside a hover a quadplane's surfaces and its forward motor answer for what its lift motors do.
        judged = phases.airborne & ~phases.knocked
        judged &= hovers(flat) if self.rotors.lift else True
        found = np.zeros((len(thrusts), evidence.COLUMNS + thrusts.shape[1] * self._traced))
        found[:, evidence.COLUMNS :] = np.nan
        evidence.follow(
            thrusts,
            flat["rates"],
            upright,
            phases.hover,
            ~judged,
            spacing * RATE_HZ,
            self.rotors.columns,
            self._rules,
            self._hypotheses,
            self._state,
            found,
        )
        if self._traced:
            yield from self._traces(first, flat, phases, found[:, evidence.COLUMNS :])
        flown = (thrusts.mean(axis=1) > _TURNS) & (upright > _LEANS)
        # Second by second, so that what follows an alarm does not depend on how the log was cut.
        for row in range(0, len(thrusts), RATE_HZ):
            rows = slice(row, row + RATE_HZ)
            second = first + row // RATE_HZ
            settled = np.asarray(found[rows, 6] > 0.0)
            self._trims.add(thrusts[rows], settled)
            yield from self._withdraw(second + 1.0)
            for at in (row + np.flatnonzero(found[rows, 0])).tolist():
                yield from self._alarm(first + at / RATE_HZ, float(spacing[at]), found[at])
            since_s = self._loss.time_s if self._loss else None
            self._speeds.add(second, thrusts[rows], flown[rows], since_s)

    def _traces(
        self, first: int, flat: Mapping[str, Array], phases: PhaseRows, shown: Array
    ) -> Iterator[Trace]:
        """Yield each motor's evidence and thrust, and the angles of the frame."""
        thrusts = phases.thrusts[::SHOWN_EVERY]
        time_s = first + np.arange(0, len(shown), SHOWN_EVERY) / RATE_HZ
        highest = np.fmax.reduce(shown.reshape(-1, SHOWN_EVERY, shown.shape[1]), axis=1)
        traces = {
            (f"motor {i + 1}", kind): (against, values[:, i])
            for kind, against, values in (
                ("evidence", np.full(len(time_s), self._rules.threshold), highest),
                ("thrust", thrusts.mean(axis=1), thrusts),
            )
            for i in range(shown.shape[1])
        }
        for i, axis in enumerate(("roll", "pitch")):
            traces["frame", f"{axis}_angle"] = (
                flat["demand"][::SHOWN_EVERY, i],
                flat["attitude"][::SHOWN_EVERY, i],
            )
        for (name, kind), pair in traces.items():
            rows = np.column_stack(pair)
            known = np.isfinite(rows[:, 1]) & phases.airborne[::SHOWN_EVERY]
            if known.any():
                yield Trace(self._vehicle, name, kind, time_s[known], rows[known])

    def _withdraw(self, time_s: float) -> Iterator[ConditionChanged]:
        """Withdraw a loss that the flight after it refutes: a climb at full thrust, a strong gust."""
        loss = self._loss
        if loss is None or self._several or not self._trims.refutes(loss):
            return
        self._loss, before, self._reported = None, self._reported, "undecided"
        if self._withdrawn is None or loss.share.estimate > self._withdrawn[0].share.estimate:
            self._withdrawn = (loss, time_s)
        name = f"motor {loss.motor}"
        rule = f"withdrawn: {name} gives its thrust again"
        yield ConditionChanged(
            self._vehicle, name, time_s, time_s, before, "undecided", rule, "thrust", "gives its thrust again"
        )

    def _alarm(self, row_s: float, spacing_s: float, found: Array) -> Iterator[ConditionChanged]:
        """Take a row at which a motor shows a loss."""
        motor, onset_s = int(found[0]), max(row_s - found[1] / RATE_HZ, 0.0)
        # A row lies between two samples: it is known when the later one has come.
        time_s = row_s + min(spacing_s, 1.0)
        share = Interval(estimate=float(found[3]), low=float(found[4]), high=float(found[5]))
        new = ThrustLoss(motor, time_s, float(onset_s), share, float(found[2]))
        loss = self._loss
        if self._several:
            return
        if loss is None:
            self._loss = new
            self._trims.suspect()
            yield self._changed(new)
        elif motor != loss.motor:
            if time_s - loss.time_s <= _ANOTHER_S:
                self._several = tuple(sorted((loss.motor, motor)))
                yield self._doubted(loss, time_s)
        elif time_s - loss.time_s < _REFINED_S and share.estimate > loss.share.estimate:
            since_s = min(loss.since_s, new.since_s)
            self._loss = ThrustLoss(motor, loss.time_s, since_s, share, new.odds)
            if SEVERITY[condition_of(share)] > SEVERITY[self._reported]:
                yield self._changed(self._loss, time_s)

    def _changed(self, loss: ThrustLoss, time_s: float | None = None) -> ConditionChanged:
        before, self._reported = self._reported, condition_of(loss.share)
        low, high = 100 * loss.share.low, 100 * loss.share.high
        return ConditionChanged(
            self._vehicle,
            f"motor {loss.motor}",
            loss.time_s if time_s is None else time_s,
            loss.since_s,
            before,
            self._reported,
            f"{self._reported}: motor {loss.motor} of {self.rotors.frame} lost "
            f"{100 * loss.share.estimate:.0f} % of its thrust ({low:.0f} to {high:.0f} %)",
            "thrust",
            f"lost {100 * loss.share.estimate:.0f} % of thrust",
        )

    def _doubted(self, loss: ThrustLoss, time_s: float) -> ConditionChanged:
        """Return the change where another motor shows a loss, too: the finding stays, the motor is open."""
        before, self._reported = self._reported, "emergency"
        return ConditionChanged(
            self._vehicle,
            f"motor {loss.motor}",
            time_s,
            loss.since_s,
            before,
            "emergency",
            f"emergency: more than one motor (of {' and '.join(map(str, self._several))})",
            "thrust",
        )

    def findings(self) -> MotorFindings:
        """Return what the flight so far shows."""
        # A log that ends in the air has no touch-down that would have to be left out.
        aloft = self._state.counts[evidence.ALOFT] > 0
        blocks = self._state.bound.copy()
        for recent in self._state.recent if aloft else ():
            known = np.flatnonzero(recent > 0.0)
            blocks[known, np.minimum(np.ceil(100 * recent[known]), 100).astype(np.int64)] += 1
        passed = blocks.cumsum(axis=1)
        bound = (passed >= BOUND_SHARE * passed[:, -1:]).argmax(axis=1) / 100
        return MotorFindings(
            rotors=self.rotors,
            loss=self._loss,
            several=self._several,
            flown_s=float(self._state.counts[evidence.FLOWN]) / RATE_HZ,
            judged_s=float(self._state.counts[evidence.JUDGED]) / RATE_HZ,
            tipped=bool(self._state.counts[evidence.TIPPED]),
            bound=tuple(bound.tolist()),
            cause=self._speeds.cause(self._loss.motor - 1, self._loss.since_s) if self._loss else None,
            withdrawn=self._withdrawn,
            indicators=tuple(map(self._trims.of_motor, range(len(self.rotors.servos)))),
        )


def condition_of(share: Interval) -> Condition:
    """Return the condition of a motor that lost a share of its thrust."""
    return "emergency" if share.estimate >= EMERGENCY_LOSS else "degraded"
