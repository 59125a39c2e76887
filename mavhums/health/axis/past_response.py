"""Judges an axis by the response that the same aircraft showed in its earlier flights.

The weights of all that moves the axis beside its surfaces come from the earlier healthy flights, and so does
the gain. What is left of it is measured over a minute of driven flight at a time, from the first second on:
no reference of the flight itself is needed, and no manoeuvre that tells the surfaces from the rest.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import NORMAL_95
from mavhums.health.axis.past import ComparedIndicator, Departure, loss_of
from mavhums.health.axis.regressions import FORMS
from mavhums.health.axis.response_sums import RESPONSE
from mavhums.health.axis.thresholds import (
    DRIVEN_SHARE,
    JUDGED_ERROR,
    LEAST_SPEED_SHARE,
    NORMAL_EFFECTIVENESS,
    PAST_FLIGHTS,
    PAST_RATE_RATIO,
    PAST_REFERENCES,
    PAST_TESTS,
    POOLED_LEAST_S,
    POOLED_S,
    WINDOW_DEVIATION,
    WINDOW_SECONDS,
)
from mavhums.health.decision.baseline import Baseline
from mavhums.health.decision.limits import tail_of
from mavhums.health.estimation.least_squares import unpacked
from mavhums.results.sections import AxisLimits
from mavhums.results.standing import Interval
from mavhums.results.verdict import Coverage, Evidence, Indicator, OwnRecord, Since, Suspect, Verdict

__all__ = ["Stretch", "compare_response", "stretches"]


def compare_response(
    verdict: Verdict,
    past: Sequence[Sequence[OwnRecord]],
    *,
    others: Collection[Verdict],
    start_utc: datetime,
    false_alarms: float,
) -> Verdict:
    """Return the verdict on an axis after the comparison of its response with that of earlier flights.

    Only an axis that the flight itself cannot judge is judged so.

    Parameters
    ----------
    verdict
        Verdict on the axis so far.
    past
        Records of the axis in earlier healthy flights, in the order of time.
    others
        Verdicts on the vehicle's other axes. Where one has a fault, what moves this axis beside its surfaces
        is not that of healthy flights, and nothing is compared.
    start_utc
        Start of flight time.
    false_alarms
        Allowed false alarms per 100 hours of the axis.
    """
    if verdict.condition != "undecided" or verdict.worst != "undecided":
        return verdict
    if any(SEVERITY[one.worst] > SEVERITY["normal"] for one in others):
        return verdict
    limits = verdict.limits or AxisLimits()
    tail = tail_of(false_alarms) * POOLED_S / WINDOW_SECONDS / PAST_TESTS
    told = [*stretches(verdict.own, past, limits, tail)]
    lost = [one for one in told if one.loss]
    if lost:
        return _with_loss(verdict, told, lost, start_utc)
    if told and told[-1].excludes_loss:
        return _as_before(verdict, told)
    return verdict


def _with_loss(verdict: Verdict, told: list[Stretch], lost: list[Stretch], start_utc: datetime) -> Verdict:
    """Return a verdict with one finding: from the first stretch with a loss to the last one."""
    losses = [one.loss for one in lost if one.loss]
    gravest = min(losses, key=lambda loss: loss.value)
    last = told[-1]
    back = last.loss is None and last.excludes_loss and last.share.estimate >= losses[-1].limit
    condition: Condition = "normal" if back else losses[-1].condition
    since_s = last.start_s if back else lost[0].start_s
    span = f"from {lost[0].start_s:.0f} s to {lost[-1].end_s:.0f} s"
    return verdict.model_copy(
        update={
            "condition": condition,
            "worst": gravest.condition,
            "effectiveness": last.share if back else lost[-1].share,
            "since": Since(
                flight_time_s=since_s,
                utc=(start_utc.astimezone(UTC) + timedelta(seconds=since_s)).isoformat(),
            ),
            "suspects": (Suspect(fault="effectiveness", confidence=gravest.confidence), *verdict.suspects),
            "evidence": (
                Evidence(
                    kind="effectiveness",
                    start_s=lost[0].start_s,
                    end_s=lost[-1].end_s,
                    value=round(gravest.value, 4),
                    limit=gravest.limit,
                    rule=f"{gravest.rule}, {span}",
                ),
                *verdict.evidence,
            ),
            "coverage": _coverage(verdict, told),
            "reason": None,
            "remedy": None,
        }
    )


def _as_before(verdict: Verdict, told: list[Stretch]) -> Verdict:
    """Return the verdict on an axis that responds as in the earlier flights."""
    return verdict.model_copy(
        update={
            "condition": "normal",
            "worst": "normal",
            "effectiveness": told[-1].share,
            "coverage": _coverage(verdict, told),
            "reason": f"judged by {told[-1].flights} earlier flights: this one gives no reference of its own",
            "remedy": None,
        }
    )


def _coverage(verdict: Verdict, told: list[Stretch]) -> Coverage:
    """Return what could be judged: the seconds of the stretches, where the flight's own are fewer."""
    kept = [one for one in told if one.excludes_loss]
    judged, excluded = sum(one.seconds for one in told), sum(one.seconds for one in kept)
    before = verdict.coverage
    windows, decidable = max(before.windows, judged), max(before.decidable, judged)
    return before.model_copy(
        update={
            "windows": windows,
            "decidable": decidable,
            "moving_fraction": round(decidable / windows, 4),
            "excluded": max(before.excluded, excluded),
            "excluded_until_s": kept[-1].end_s if excluded > before.excluded else before.excluded_until_s,
        }
    )


class Stretch(NamedTuple):
    """About a minute of driven flight, compared with the earlier flights.

    Attributes
    ----------
    start_s, end_s
        In flight time.
    seconds
        Judged seconds in it.
    share
        Effectiveness relative to that of the earlier flights, with its 95 % interval.
    loss
        A certain loss; None if there is none.
    flights
        Number of earlier flights.
    """

    start_s: float
    end_s: float
    seconds: int
    share: Interval
    loss: Departure | None
    flights: int

    @property
    def excludes_loss(self) -> bool:
        """Whether a loss of 40 % or more is excluded with 95 %."""
        return self.share.low > NORMAL_EFFECTIVENESS


_HEAD: Final = 3  # seconds, end and speed of a part, before its sums of products
_LARGEST: Final = 1e12
_SIZES: Final = sorted({form.nuisances + 2 for form in FORMS.values()})


class _Parts(NamedTuple):
    """The parts of a flight: judged seconds, end and mean speed of each, and its sums of products."""

    seconds: Array
    end_s: Array
    speed: Array
    grams: Array

    @classmethod
    def of(cls, record: OwnRecord) -> _Parts | None:
        """Return the parts of a record; None if no flight of this axis can have left them."""
        lengths = {len(row) for row in record.groups}
        size = next((n for n in _SIZES if lengths == {_HEAD + n * (n + 1) // 2}), None)
        if size is None:
            return None
        rows = np.array(record.groups, dtype=np.float64)
        # A file can hold any number: sums of larger ones overflow.
        if rows[:, 0].min() <= 0.0 or np.abs(rows).max() > _LARGEST:
            return None
        grams = np.array([unpacked(row[_HEAD:], size) for row in record.groups])
        return cls(rows[:, 0], rows[:, 1], rows[:, 2], grams)

    def take(self, at: NDArray[np.intp]) -> _Parts:
        return _Parts(*(column[at] for column in self))


class _Scores(NamedTuple):
    """Sums of squares of the drive, and of its products with what the others leave of the response."""

    drive2: Array
    cross: Array

    @classmethod
    def of(cls, parts: _Parts, others: Array) -> _Scores:
        grams = parts.grams[parts.grams[:, 0, 0] > 0.0]  # a part that nothing drove tells no gain
        return cls(grams[:, 0, 0], grams[:, 0, -1] - grams[:, 0, 1:-1] @ others)

    def gain(self) -> float:
        return float(self.cross.sum() / self.drive2.sum())

    def squares(self) -> float:
        """Return the sum of squares about the flight's own gain, each part weighted by its certainty."""
        return float(((self.cross - self.gain() * self.drive2) ** 2 / self.drive2).sum())


def stretches(
    own: Sequence[OwnRecord], past: Sequence[Sequence[OwnRecord]], limits: AxisLimits, tail: float
) -> Iterator[Stretch]:
    """Yield the stretches of a flight that tell the effectiveness, in the order of time.

    Parameters
    ----------
    own
        Records of the axis in this flight.
    past
        The same of earlier healthy flights, in the order of time.
    limits
        Limits of the axis.
    tail
        Probability that a healthy stretch shows a loss.
    """
    record = _record_of(own)
    parts = _Parts.of(record) if record else None
    if record is None or parts is None:
        return
    alike = [each for records in past if (each := _record_of(records)) and _alike(record, each)]
    flown = [one for each in alike[:PAST_REFERENCES] if (one := _Parts.of(each)) and _usable(one, parts)]
    if len(flown) < PAST_FLIGHTS:
        return
    gram = sum(one.grams.sum(axis=0) for one in flown)
    weights = np.linalg.lstsq(gram[:-1, :-1], gram[:-1, -1], rcond=None)[0]
    usual, others = float(weights[0]), weights[1:]
    scores = [_Scores.of(one, others) for one in flown]
    count = sum(len(one.drive2) for one in scores) - len(scores)
    if usual == 0.0 or count < 1:
        return
    variance = sum(one.squares() for one in scores) / count
    indicators = [_indicator(one, usual, variance) for one in scores]
    baseline = Baseline.of(indicators)
    if baseline is None or baseline.mean <= 0.0:
        return
    total_s = sum(float(one.seconds.sum()) for one in flown)
    speed = sum(float(one.speed @ one.seconds) for one in flown) / total_s
    power = float(gram[0, 0]) / total_s
    # Near the stall ailerons lose most of their effect without a fault.
    driven = parts.take(
        np.flatnonzero((parts.speed >= LEAST_SPEED_SHARE * speed) & (parts.grams[:, 0, 0] > 0))
    )
    for first, last in _minutes(driven.seconds):
        minute = driven.take(np.arange(first, last))
        shown = _indicator(_Scores.of(minute, others), usual, variance)
        if shown.value.high - shown.value.low > 2 * NORMAL_95 * JUDGED_ERROR:
            continue
        compared = ComparedIndicator.of(shown, baseline)
        seconds = int(minute.seconds.sum())
        # Gusts move the aircraft and, through the autopilot, the surfaces against it: where little else
        # drives these, the gain is underestimated.
        shows = seconds >= POOLED_LEAST_S and minute.grams[:, 0, 0].sum() >= DRIVEN_SHARE * power * seconds
        start_s = float(driven.end_s[first - 1]) if first else float(minute.end_s[0] - minute.seconds[0])
        yield Stretch(
            start_s,
            float(minute.end_s[-1]),
            seconds,
            compared.share,
            loss_of(compared, limits, tail) if shows else None,
            baseline.flights,
        )


def _record_of(records: Sequence[OwnRecord]) -> OwnRecord | None:
    return next((record for record in records if record.equation == RESPONSE), None)


def _alike(one: OwnRecord, other: OwnRecord) -> bool:
    """Return whether two flights measured the speed alike, at rates that show about the same gain."""
    faster, slower = max(one.rate_hz, other.rate_hz), min(one.rate_hz, other.rate_hz)
    return one.setup == other.setup and faster <= PAST_RATE_RATIO * slower


def _usable(flown: _Parts, parts: _Parts) -> bool:
    """Return whether an earlier flight has the same columns, and was driven in more than one part."""
    return flown.grams.shape[1:] == parts.grams.shape[1:] and bool((flown.grams[:, 0, 0] > 0).sum() > 1)


def _indicator(scores: _Scores, usual: float, variance: float) -> Indicator:
    """Return the gain relative to the usual one, with its error."""
    count = len(scores.drive2)
    # A few parts that agree by chance are no better than those of the earlier flights.
    own = max(variance, scores.squares() / max(count - 1, 1)) / float(scores.drive2.sum()) / usual**2
    error = float(np.sqrt(own + WINDOW_DEVIATION**2 / count))
    k, half = scores.gain() / usual, NORMAL_95 * error
    return Indicator(
        fault="effectiveness",
        quantity="control gain",
        unit="1",
        value=Interval.around(k, half),
        windows=max(count, 2) * WINDOW_SECONDS,
        scatter=error * (max(count, 2) * WINDOW_SECONDS) ** 0.5,
        needed_flights=PAST_FLIGHTS,
    )


def _minutes(seconds: Array) -> Iterator[tuple[int, int]]:
    """Yield the places of the first and after the last part of each minute; the last one may be shorter."""
    first, total = 0, 0.0
    for k, each in enumerate(seconds.tolist(), start=1):
        total += each
        if total >= POOLED_S or k == len(seconds):
            yield first, k
            first, total = k, 0.0
