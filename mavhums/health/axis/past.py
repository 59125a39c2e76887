"""Compares an axis with the same aircraft's earlier flights: a pure function of stored numbers.

The reference of a flight cannot show a fault that was there from the start. Its control effectiveness, lag
and trim are therefore compared with those of the earlier healthy flights. A difference counts if it is
certain, given the errors and the scatter between flights, and beyond the limit of the profile.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import Final

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import t_quantile
from mavhums.health.decision.baseline import LOSSES, Baseline, ComparedIndicator, with_baselines
from mavhums.health.decision.conditions import since
from mavhums.health.decision.evidence import Departure, confidence_of, with_departures
from mavhums.health.decision.limits import tail_of_flight
from mavhums.health.decision.thresholds import FALSE_ALARMS
from mavhums.results.reasons import said
from mavhums.results.sections import AxisLimits
from mavhums.results.verdict import Verdict

_TESTED: Final = (*LOSSES, "slow", "hard_over")  # faults among which the false alarms are divided


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
    verdict = with_baselines(verdict, baselines)
    tail = tail_of_flight(false_alarms, verdict.coverage.windows) / len(_TESTED)
    # A fault that the flight itself shows keeps its onset; here it would hold from the start on.
    shown_alone = {item.kind for item in verdict.evidence}
    departures = _departures(compared, verdict.limits or AxisLimits(), tail)
    found = [one for one in departures if one.fault not in shown_alone]
    if found:
        return _from_the_start(verdict, found, start_utc, end_s)
    if verdict.condition not in ("normal", "unchanged"):
        return verdict
    # Earlier flights show what the log of a flight that begins in the air does not.
    worst = "normal" if verdict.worst == "unchanged" else verdict.worst
    return verdict.model_copy(update={"condition": "normal", "worst": worst, **said()})


def _departures(compared: list[ComparedIndicator], limits: AxisLimits, tail: float) -> Iterator[Departure]:
    """Yield the differences that are certain and beyond the limits: of the gains the most certain one."""
    lost = [one for one in compared if one.indicator.fault in LOSSES and one.baseline.mean > 0]
    losses = [loss for one in lost if (loss := _loss_of(one, limits, tail))]
    # Gain and load factor fall with the same surface: one loss, the graver one.
    yield from sorted(losses, key=lambda loss: loss.value)[:1]
    for one in compared:
        bound = t_quantile(one.freedom, 1.0 - tail)
        size, flights = one.difference, one.baseline.flights
        if one.indicator.fault == "slow" and size >= limits.lag_s and one.ratio > bound:
            rule = f"degraded: answers {size:.1f} s later than in {flights} earlier flights"
            yield Departure("slow", "degraded", size, limits.lag_s, rule, confidence_of(one))
        if one.indicator.fault == "hard_over" and abs(size) >= limits.trim_shift and abs(one.ratio) > bound:
            way = "right" if size > 0 else "left"
            rule = (
                f"degraded: needs {100 * abs(size):.0f} % of the full demand more to the {way} than in "
                f"{flights} earlier flights to keep its wings level"
            )
            yield Departure("hard_over", "degraded", size, limits.trim_shift, rule, confidence_of(one))


def _loss_of(one: ComparedIndicator, limits: AxisLimits, tail: float) -> Departure | None:
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
    return Departure("effectiveness", condition, k, limit, rule, confidence_of(one), share)


def _from_the_start(verdict: Verdict, found: list[Departure], start_utc: datetime, end_s: float) -> Verdict:
    """Return a verdict with departures, which hold from the reference on."""
    late_s = verdict.coverage.judged_from_s
    # The flight's own beginning is its reference; a late one shows nothing of what was before it.
    when, start_s = ("from the start on", 0.0) if late_s is None else (f"from {late_s:.0f} s on", late_s)
    worst = max((one.condition for one in found), key=SEVERITY.__getitem__)
    effectiveness = next((one.effectiveness for one in found if one.effectiveness), verdict.effectiveness)
    changes: dict[str, object] = {"effectiveness": effectiveness}
    if SEVERITY[worst] >= SEVERITY[verdict.condition]:
        changes |= {"condition": worst, "since": since(start_s, start_utc), **said()}
    return with_departures(verdict, found, (start_s, end_s), when, changes=changes)
