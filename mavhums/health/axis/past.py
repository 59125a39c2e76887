"""Compares an axis with the same aircraft's earlier flights: a pure function of stored numbers.

The reference of a flight cannot show a fault that was there from the start. Its control effectiveness, lag
and trim are therefore compared with those of the earlier healthy flights. A difference counts if it is
certain, given the errors and the scatter between flights, and beyond the limit of the profile.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Final

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import CENTRAL_95, NORMAL_95, t_probability, t_quantile
from mavhums.health.axis.thresholds import MOST_CONFIDENCE, PAST_TESTS
from mavhums.health.decision.baseline import Baseline
from mavhums.health.decision.limits import tail_of
from mavhums.health.decision.thresholds import FALSE_ALARMS, MOST_FLIGHT_TAIL
from mavhums.health.estimation.random_effects import satterthwaite
from mavhums.health.estimation.thresholds import WINDOW_S
from mavhums.results.sections import AxisLimits
from mavhums.results.standing import Interval
from mavhums.results.verdict import Evidence, Indicator, Since, Suspect, Verdict

LOSSES: Final = ("effectiveness", "manoeuvre")
"""Faults whose indicators fall as the fault grows."""


@dataclass(frozen=True, slots=True)
class ComparedIndicator:
    """An indicator beside its baseline: the difference, its standard error and its degrees of freedom."""

    indicator: Indicator
    baseline: Baseline
    difference: float
    error: float
    freedom: float

    @classmethod
    def of(cls, indicator: Indicator, baseline: Baseline) -> ComparedIndicator:
        """Return the comparison of an indicator of one flight with its baseline."""
        value = indicator.value
        # The interval of the report is the only form in which the error was stored.
        own = ((value.high - value.low) / 2 / NORMAL_95) ** 2
        between = baseline.flight_variance
        freedom = satterthwaite(own, max(indicator.windows - 1, 1), between, baseline.certainty)
        return cls(
            indicator, baseline, value.estimate - baseline.mean, max(own + between, 1e-24) ** 0.5, freedom
        )

    @property
    def ratio(self) -> float:
        """The difference over its standard error."""
        return self.difference / self.error

    @property
    def share(self) -> Interval:
        """Return the quantity as a share of its baseline, with its 95 % interval."""
        mean = self.baseline.mean
        k = self.indicator.value.estimate / mean
        half = t_quantile(self.freedom, CENTRAL_95) * self.error / abs(mean)
        return Interval(estimate=round(k, 3), low=round(k - half, 3), high=round(k + half, 3))


@dataclass(frozen=True, slots=True)
class Departure:
    """A difference from the earlier flights that counts."""

    fault: str
    condition: Condition
    value: float
    limit: float
    rule: str
    confidence: float
    effectiveness: Interval | None = None


def compare_with_earlier_flights(
    verdict: Verdict,
    baselines: Mapping[str, Baseline],
    *,
    start_utc: datetime,
    end_s: float,
    false_alarms: float = FALSE_ALARMS,
) -> Verdict:
    """Return the verdict on an axis after the comparison with the aircraft's earlier flights.

    Parameters
    ----------
    verdict
        Verdict on the flight alone.
    baselines
        Baselines of the axis's indicators, by fault.
    start_utc, end_s
        Start of flight time, and the end of the log in flight time.
    false_alarms
        Allowed false alarms per 100 hours of the axis.
    """
    compared = [
        ComparedIndicator.of(shown, baselines[shown.fault])
        for shown in verdict.indicators
        if shown.fault in baselines
    ]
    if not compared:
        return verdict
    known = {one.indicator.fault: one.baseline for one in compared}
    verdict = verdict.model_copy(
        update={"indicators": tuple(_beside(shown, known.get(shown.fault)) for shown in verdict.indicators)}
    )
    seconds = max(verdict.coverage.windows, WINDOW_S)
    # The rate is per hour: a longer flight may use more of it.
    tail = min(tail_of(false_alarms) * seconds / WINDOW_S, MOST_FLIGHT_TAIL) / PAST_TESTS
    seen = {item.kind for item in verdict.evidence}
    # What the flight itself shows is told with its onset, not from the start on.
    found = [one for one in _found(compared, verdict.limits or AxisLimits(), tail) if one.fault not in seen]
    if found:
        return _judged(verdict, found, start_utc, end_s)
    # Earlier flights tell what the log of a flight that begins in the air does not.
    return (
        verdict.model_copy(update={"reason": None, "remedy": None})
        if verdict.condition == "normal"
        else verdict
    )


def _beside(shown: Indicator, baseline: Baseline | None) -> Indicator:
    if baseline is None:
        return shown
    expected = baseline.prediction().significant(5)
    return shown.model_copy(update={"baseline": expected, "baseline_flights": baseline.flights})


def _found(compared: list[ComparedIndicator], limits: AxisLimits, tail: float) -> Iterator[Departure]:
    """Yield the differences that are certain and beyond the limits: of the gains the most certain one."""
    lost = [one for one in compared if one.indicator.fault in LOSSES and one.baseline.mean > 0]
    losses = [loss for one in lost if (loss := loss_of(one, limits, tail))]
    # Gain and load factor fall with the same surface: one loss, the graver one.
    yield from sorted(losses, key=lambda loss: loss.value)[:1]
    for one in compared:
        bound = t_quantile(one.freedom, 1.0 - tail)
        size, flights = one.difference, one.baseline.flights
        if one.indicator.fault == "slow" and size >= limits.lag_s and one.ratio > bound:
            rule = f"degraded: answers {size:.1f} s later than in {flights} earlier flights"
            yield Departure("slow", "degraded", size, limits.lag_s, rule, _confidence(one))
        if one.indicator.fault == "hard_over" and abs(size) >= limits.trim_shift and abs(one.ratio) > bound:
            way = "right" if size > 0 else "left"
            rule = (
                f"degraded: needs {100 * abs(size):.0f} % of the full demand more to the {way} than in "
                f"{flights} earlier flights to keep its wings level"
            )
            yield Departure("hard_over", "degraded", size, limits.trim_shift, rule, _confidence(one))


def loss_of(one: ComparedIndicator, limits: AxisLimits, tail: float) -> Departure | None:
    """Return a certain loss of effectiveness; None if there is none."""
    share = one.share
    k = share.estimate
    # Certain alone is not enough: a small certain loss is within what loading and air change.
    if -one.ratio <= t_quantile(one.freedom, 1.0 - tail) or k >= limits.effectiveness_degraded:
        return None
    grave = k <= limits.effectiveness_emergency
    condition: Condition = "emergency" if grave else "degraded"
    limit = limits.effectiveness_emergency if grave else limits.effectiveness_degraded
    what = "control effectiveness" if one.indicator.fault == "effectiveness" else one.indicator.quantity
    rule = (
        f"{condition}: {100 * max(k, 0.0):.0f} % of the {what} of {one.baseline.flights} earlier flights "
        "is left"
    )
    return Departure("effectiveness", condition, k, limit, rule, _confidence(one), share)


def _confidence(one: ComparedIndicator) -> float:
    return round(min(t_probability(one.freedom, abs(one.ratio)), MOST_CONFIDENCE), 4)


def _judged(verdict: Verdict, found: list[Departure], start_utc: datetime, end_s: float) -> Verdict:
    """Return a verdict with the findings; what they say holds from the reference on."""
    late_s = verdict.coverage.judged_from_s
    # The flight's own beginning is its reference; of a late one nothing is known before it.
    began, start_s = ("from the start on", 0.0) if late_s is None else (f"from {late_s:.0f} s on", late_s)
    worst = max((one.condition for one in found), key=SEVERITY.__getitem__)
    decided = SEVERITY[worst] >= SEVERITY[verdict.condition]
    suspects = {one.fault: one.confidence for one in verdict.suspects} | {
        one.fault: one.confidence for one in found
    }
    evidence = [
        Evidence(
            kind=one.fault,
            start_s=start_s,
            end_s=end_s,
            value=round(one.value, 4),
            limit=one.limit,
            rule=f"{one.rule}, {began}",
        )
        for one in found
    ]
    effectiveness = next((one.effectiveness for one in found if one.effectiveness), verdict.effectiveness)
    changes: dict[str, object] = {
        "worst": max(verdict.worst, worst, key=SEVERITY.__getitem__),
        "suspects": tuple(
            Suspect(fault=fault, confidence=sure)
            for fault, sure in sorted(suspects.items(), key=lambda each: -each[1])
        ),
        "evidence": (*evidence, *verdict.evidence),
        "effectiveness": effectiveness,
    }
    if decided:
        begun_utc = start_utc.astimezone(UTC) + timedelta(seconds=start_s)
        since = Since(flight_time_s=start_s, utc=begun_utc.isoformat())
        changes |= {"condition": worst, "since": since, "reason": None, "remedy": None}
    return verdict.model_copy(update=changes)
