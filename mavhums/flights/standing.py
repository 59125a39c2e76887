"""An actuator's state over its flights: its condition, the dates when it reaches its limits, its steps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import timedelta
from typing import Any, Final, NamedTuple

import numpy as np

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.flights.history import PastFlight, PastIndicator, PastVerdict
from mavhums.health.decision.baseline import LOSSES
from mavhums.health.decision.growth import Course
from mavhums.health.decision.thresholds import LASTING_FLIGHTS, TREND_REACH_SPANS
from mavhums.health.estimation.thresholds import REFERENCE_FLIGHTS
from mavhums.results.standing import (
    ActuatorTrend,
    FlightsLeft,
    Growth,
    Standing,
    Step,
)
from mavhums.results.verdict import Interval, Verdict

_FARTHEST: Final = timedelta(days=36_525)


class Flown(NamedTuple):
    """One flight of one actuator; ``number`` counts all from 1, ``counts`` is false before a repair."""

    number: int
    flight: PastFlight
    start_utc: str
    verdict: PastVerdict
    gravest: Condition
    counts: bool = True


Pairs = Sequence[tuple[Flown, PastIndicator]]


def growth_of(course: Course, pairs: Pairs, limits: tuple[float | None, float | None]) -> Growth:
    """Return the growth of an indicator.

    Parameters
    ----------
    course
        Of the pairs; a fault raises it.
    pairs
        Flights and their indicators.
    limits
        From which the actuator is degraded, and from which it is an emergency, in the sense of the course.
    """
    since, newest = pairs[course.since][0], pairs[-1][1]
    reach = TREND_REACH_SPANS * (pairs[-1][0].number - since.number)
    flown = [each for each, _ in pairs]
    degraded, emergency = (
        None if limit is None else flights_left(course.flights_left(limit), flown, reach) for limit in limits
    )
    return Growth(
        fault=newest.fault,
        quantity=newest.quantity,
        unit=newest.unit,
        since_flight=since.number,
        since_utc=since.start_utc,
        per_flight=in_sense(course.per_flight, newest.fault),
        to_degraded=degraded,
        to_emergency=emergency,
    )


def flights_left(
    left: tuple[float, float, float], flown: Sequence[Flown], reach: float
) -> FlightsLeft | None:
    """Return flights left with their dates; None if not even the estimate is finite.

    Parameters
    ----------
    left
        Low end, estimate and high end; infinite where there is none.
    flown
        The flights; the last ones show how often the aircraft flies.
    reach
        Flights beyond which a straight line is a guess.
    """
    low, estimate, high = left
    if not np.isfinite(estimate):
        return None
    recent = flown[-REFERENCE_FLIGHTS:]
    flights = recent[-1].number - recent[0].number
    each = (recent[-1].flight.start - recent[0].flight.start) / flights if flights else timedelta(0)

    def date(ahead: float) -> str | None:
        if not each or not ahead * each.total_seconds() < _FARTHEST.total_seconds():
            return None
        return (recent[-1].flight.start + ahead * each).date().isoformat()

    return FlightsLeft(
        estimate=estimate,
        low=low,
        high=high if np.isfinite(high) else None,
        expected_utc=date(estimate),
        earliest_utc=date(low),
        latest_utc=date(high),
        is_far=bool(estimate > reach),
    )


def step_of(pairs: Pairs, place: int) -> Step:
    """Return the change of an indicator before the flight at an index."""
    values = np.array([one.estimate for _, one in pairs])
    before, after = values[:place][-LASTING_FLIGHTS:], values[place:][:LASTING_FLIGHTS]
    size = float(after.mean() - before.mean())
    flown, newest = pairs[place][0], pairs[-1][1]
    return Step(
        fault=newest.fault,
        quantity=newest.quantity,
        unit=newest.unit,
        flight=flown.number,
        at_utc=flown.start_utc,
        size=size,
        better=(size < 0) != (newest.fault in LOSSES),
    )


def standing_of(flown: Sequence[Flown], trends: Iterable[ActuatorTrend]) -> Standing:
    """Return an actuator's state after its last flight.

    Parameters
    ----------
    flown
        Its flights, at least one.
    trends
        Those of all its indicators.
    """
    several = [*trends]
    last = flown[-1]
    since = [each for each in flown if each.counts]
    condition, first, latest = _state(since)
    if latest is not None:
        # A repair that nobody recorded ends the fault that it mended, and no other.
        fault = _finding(latest.verdict.whole(), condition)["fault"]
        mended = max(
            (one.step.flight for one in several if one.fault == fault and one.step and one.step.better),
            default=0,
        )
        if mended > latest.number:
            condition, first, latest = _state([each for each in since if each.number >= mended])
    growing = [one.growth for one in several if one.growth]
    # A step of long ago is known, or nobody will look into it any more.
    steps = [one.step for one in several if one.step and last.number - one.step.flight < REFERENCE_FLIGHTS]
    faulty = latest is not None
    finding = _finding((latest or last).verdict.whole(), condition) if faulty else {}
    return Standing(
        subject=last.verdict.subject,
        vehicle=last.verdict.vehicle or 0,
        actuator=last.verdict.actuator,
        airframe=last.flight.airframe,
        condition=condition if faulty else last.gravest,
        last=last.gravest,
        since_flight=first.number if first else None,
        since_utc=first.start_utc if first else None,
        clear_flights=sum(
            _found(each) is not None for each in since if latest and each.number > latest.number
        ),
        growth=min(growing, key=lambda one: one.soonest, default=None),
        step=max(steps, key=lambda one: one.flight, default=None),
        reason=reason_of(last.verdict.whole(), last.gravest),
        flights=len(flown),
        last_utc=last.start_utc,
        log=last.flight.path,
        **finding,
    )


def _state(flown: Sequence[Flown]) -> tuple[Condition, Flown | None, Flown | None]:
    """Return the worst of the last five judged flights, and first and latest flight of the fault."""
    judged: list[tuple[Flown, Condition]] = []  # the newest first, back to those that were clear
    clear = 0
    for each in reversed(flown):
        found = _found(each)
        if found is None:
            continue
        judged.append((each, found))
        clear = 0 if SEVERITY[found] > 0 else clear + 1
        if clear == LASTING_FLIGHTS:
            break
    faulty = [each for each, found in judged if SEVERITY[found] > 0]
    if not faulty:
        return "normal", None, None
    recent = judged[:LASTING_FLIGHTS]
    worst = max((found for _, found in reversed(recent)), key=SEVERITY.__getitem__)
    return worst, faulty[-1], next(each for each, found in recent if found == worst)


def _found(each: Flown) -> Condition | None:
    """Return what a flight shows; None where nothing was decided.

    A flight alone needs more than its interval to be degraded; over flights the interval is enough.
    """
    if SEVERITY[each.gravest] > 0:
        return each.gravest
    for one in each.verdict.indicators:
        if one.is_beyond:
            return "degraded"
    return each.gravest if SEVERITY[each.gravest] == 0 else None


def _finding(verdict: Verdict, condition: Condition) -> dict[str, Any]:
    """Return fault, quantity, value and limit of what a verdict rests on."""
    rules = [each for each in verdict.evidence if each.condition == condition]
    named = [one.fault for one in verdict.suspects] + [one.fault for one in rules]
    indicators = [PastIndicator.of(one, verdict.evidence) for one in verdict.indicators]
    shown = [one for fault in named for one in indicators if one.fault == fault]
    for one in (*shown, *(one for one in indicators if one.is_beyond)):
        limit = one.emergency if condition == "emergency" and one.emergency is not None else one.limit
        return {
            "fault": one.fault,
            "quantity": one.quantity,
            "unit": one.unit,
            "value": one.value,
            "highest": one.highest,
            "limit": limit,
        }
    for rule in rules:
        return {"fault": rule.kind, "limit": rule.limit, "quantity": rule.rule}
    return {"fault": named[0] if named else None}


def reason_of(verdict: Verdict, gravest: Condition) -> str | None:
    """Return the rule of the gravest finding, else why nothing was decided."""
    rules = (each.rule for each in verdict.evidence if each.condition == gravest)
    return next(rules, verdict.reason)


def in_sense(interval: Interval, fault: str) -> Interval:
    """Return an interval of a course, which a fault raises, as that of the indicator, which losses lower."""
    if fault not in LOSSES:
        return interval
    return Interval(estimate=-interval.estimate, low=-interval.high, high=-interval.low)
