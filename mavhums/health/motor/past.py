"""Compares a multirotor's motors with the same aircraft's earlier flights: a pure function of stored numbers.

A flight alone cannot show a motor or a propeller that was worn from the start: its trim is all there is. One
that changed against the earlier flights is told, with its causes: a worn propeller or motor, or a weight that
sits elsewhere, unless yaw tells them apart. An imbalance alone is no evidence: whole propellers, a battery
beside the middle and a motor's tolerance make one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.core.conditions import SEVERITY
from mavhums.core.statistics import NORMAL_95, t_probability, t_quantile
from mavhums.health.decision.baseline import Baseline
from mavhums.health.decision.thresholds import MOST_FLIGHT_TAIL
from mavhums.results.standing import Interval
from mavhums.results.verdict import Evidence, Indicator, Since, Suspect, Verdict
from mavhums.vehicle.grid import RATE_HZ

__all__ = ["BETWEEN_FLIGHTS", "NEEDED_FLIGHTS", "TRIM", "TRIM_YAW", "Trims", "compare_motors"]

_SCATTER_PER_MOTOR: Final = 0.011
"""Scatter of a motor's trim between flights, by the number of motors: of the efforts' in :mod:`.trims`, along
the columns of quads, hexas and octas."""
_SCATTER_WORTH: Final = 6.0  # flights
_LEAST_CHANGE: Final = 0.15
"""Least change of a motor's thrust that is told: a battery moved by a centimetre makes 0.1."""
_YAW_TELLS: Final = 3.0  # standard deviations between flights
_MOST_CONFIDENCE: Final = 0.99  # a Student's t of few flights claims more than they show

TRIM: Final = "trim"
"""Fault of the indicator: thrust that a motor gives more than its share, by that share."""
TRIM_YAW: Final = "trim_yaw"
"""The part of it about yaw, which a shifted weight does not change."""

BETWEEN_FLIGHTS: Final = np.array([0.03, 0.05, 0.012])
"""Standard deviation between a quad's flights of its effort about roll, pitch and yaw, by the thrust of one
motor: six flights of one aircraft with whole propellers."""
NEEDED_FLIGHTS: Final = 3
"""The scatter between flights is known from others, so the mean is all that the own ones must give."""
# Blocks as long as gusts last, s, whose mean is the trim; fewer have no scatter to speak of. By hand.
_BLOCK_S: Final = 10
_LEAST_BLOCKS: Final = 3


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

    def add(self, thrusts: Array, flown: Flags) -> None:
        """Take whole seconds: thrusts, shape (n, motors), and in which rows it flew upright."""
        seconds = thrusts.reshape(-1, RATE_HZ, thrusts.shape[1]).mean(axis=1)
        # Second by second, so that the sums do not depend on how the log was cut.
        for second in np.flatnonzero(flown.reshape(-1, RATE_HZ).all(axis=1)).tolist():
            self._block.append(seconds[second])
            if len(self._block) == _BLOCK_S:
                asked = np.mean(self._block, axis=0)
                self._block.clear()
                self._blocks += 1
                effort = asked @ self._columns / asked.mean()
                off = effort - self._mean
                self._mean = self._mean + off / self._blocks
                self._squares = self._squares + off * (effort - self._mean)

    def of_motor(self, motor: int) -> tuple[Indicator, ...]:
        """Return the indicators of a motor, from 0; none of a flight that is too short."""
        if self._blocks < _LEAST_BLOCKS:
            return ()
        column = self._columns[motor]
        weights = column / BETWEEN_FLIGHTS**2
        weights = weights / (weights @ column)
        turns = np.array([0.0, 0.0, np.sign(column[2])])
        return (
            self._indicator(TRIM, "thrust beyond its share", weights),
            self._indicator(TRIM_YAW, "effort about yaw towards it", turns),
        )

    def _indicator(self, fault: str, quantity: str, weights: Array) -> Indicator:
        value = float(weights @ self._mean)
        scatter = float(np.sqrt(weights**2 @ self._squares / (self._blocks - 1)))
        half = NORMAL_95 * scatter / self._blocks**0.5
        return Indicator(
            fault=fault,
            quantity=quantity,
            unit="1",
            value=Interval(estimate=round(value, 5), low=round(value - half, 5), high=round(value + half, 5)),
            windows=self._blocks,
            scatter=round(scatter, 5),
            needed_flights=NEEDED_FLIGHTS,
        )


class _TrimShift(NamedTuple):
    """A motor's trim beside that of earlier flights."""

    verdict: Verdict
    value: float
    ratio: float
    freedom: float
    flights: int
    yaw: float


def compare_motors(
    verdicts: Sequence[Verdict],
    baselines: Callable[[Verdict], Mapping[str, Baseline]],
    *,
    start_utc: datetime,
    end_s: float,
) -> list[Verdict]:
    """Return all verdicts of a flight, those on motors after the comparison with earlier flights.

    Parameters
    ----------
    verdicts
        Of all vehicles and kinds.
    baselines
        Returns the baselines of a motor's indicators, by fault.
    start_utc, end_s
        Start of flight time, and the end of the log in flight time.
    """
    compared = list(verdicts)
    for vehicle in {verdict.vehicle for verdict in verdicts if verdict.subject == "motor"}:
        places = [k for k, v in enumerate(compared) if v.subject == "motor" and v.vehicle == vehicle]
        changes: dict[int, _TrimShift] = {}
        for k in places:
            known = baselines(compared[k])
            compared[k] = _beside(compared[k], known)
            change = _change(compared[k], known, len(places))
            if change is not None:
                changes[k] = change
        if not changes:
            continue
        # A motor that carries more unloads the opposite one: the largest is the cause.
        most = max(changes, key=lambda k: changes[k].value)
        one = changes[most]
        if one.value >= _LEAST_CHANGE and one.ratio > float(
            t_quantile(one.freedom, 1.0 - MOST_FLIGHT_TAIL / len(places))
        ):
            compared[most] = _judged(one, start_utc, end_s)
    return compared


def _change(verdict: Verdict, baselines: Mapping[str, Baseline], motors: int) -> _TrimShift | None:
    shown = {one.fault: one.value.estimate for one in verdict.indicators}
    if TRIM not in shown or not {TRIM, TRIM_YAW} <= baselines.keys():
        return None
    trim, yaw = baselines[TRIM], baselines[TRIM_YAW]
    beside = 1.0 + 1.0 / trim.flights
    own = trim.flights - 1.0
    usual = (_SCATTER_PER_MOTOR * motors) ** 2
    variance = (_SCATTER_WORTH * usual + own * trim.spread**2) / (_SCATTER_WORTH + own) * beside
    value = shown[TRIM] - trim.mean
    turned = (shown[TRIM_YAW] - yaw.mean) / (float(BETWEEN_FLIGHTS[2]) * beside**0.5)
    return _TrimShift(verdict, value, value / variance**0.5, _SCATTER_WORTH + own, trim.flights, turned)


def _beside(verdict: Verdict, baselines: Mapping[str, Baseline]) -> Verdict:
    def shown(one: Indicator) -> Indicator:
        if one.fault not in baselines:
            return one
        known = baselines[one.fault]
        expected = known.prediction().significant(5)
        return one.model_copy(update={"baseline": expected, "baseline_flights": known.flights})

    if not baselines or not verdict.indicators:
        return verdict
    return verdict.model_copy(update={"indicators": tuple(shown(one) for one in verdict.indicators)})


def _judged(one: _TrimShift, start_utc: datetime, end_s: float) -> Verdict:
    verdict = one.verdict
    if SEVERITY[verdict.condition] > SEVERITY["normal"]:
        return verdict  # what the flight itself shows is told with its onset
    cause = "a worn propeller or motor"
    if one.yaw < _YAW_TELLS:
        cause += ", or a weight that sits elsewhere (yaw does not tell which)"
    rule = (
        f"degraded: is asked for {100 * one.value:.0f} % more thrust beside the others than in "
        f"{one.flights} earlier flights, from the start on: {cause}"
    )
    confidence = min(t_probability(one.freedom, one.ratio), _MOST_CONFIDENCE)
    return verdict.model_copy(
        update={
            "condition": "degraded",
            "worst": "degraded",
            "reason": None,
            "remedy": None,
            "since": Since(flight_time_s=0.0, utc=start_utc.astimezone(UTC).isoformat()),
            "suspects": (Suspect(fault="thrust", confidence=round(confidence, 4)),),
            "evidence": (
                Evidence(
                    kind="thrust",
                    start_s=0.0,
                    end_s=end_s,
                    value=round(one.value, 4),
                    limit=_LEAST_CHANGE,
                    rule=rule,
                ),
            ),
        }
    )
