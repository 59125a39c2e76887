"""The trend of each actuator's indicators over its flights, and its remaining useful life (RUL)."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from functools import cache

import numpy as np

from mavhums.core.arrays import Array
from mavhums.core.conditions import URGENCY
from mavhums.flights.aircraft import Since, latest
from mavhums.flights.history import (
    PastFlight,
    PastIndicator,
    baselines_of,
    counting,
)
from mavhums.flights.standing import Flown, growth_of, in_sense, standing_of, step_of
from mavhums.health.decision.baseline import LOSSES, Baseline, BaselineSource
from mavhums.health.decision.growth import Course, course_of, last_step
from mavhums.health.decision.thresholds import LASTING_FLIGHTS, TREND_FLIGHTS
from mavhums.results.standing import (
    ActuatorTrend,
    FlightPoints,
    FlightsLeft,
    Growth,
    Standing,
    Step,
    TrendReport,
)
from mavhums.results.verdict import ALL, Interval

_Shown = list[tuple[Flown, PastIndicator]]


def trend_report(
    flights: Iterable[PastFlight],
    *,
    actuators: Collection[str] = (),
    faults: Collection[str] = (),
    since: Since | None = None,
    repaired: Since | None = None,
    baselines: BaselineSource | None = None,
) -> TrendReport:
    """Fit a trend to every indicator of every actuator.

    Parameters
    ----------
    flights
        Flights of one aircraft.
    actuators, faults
        Names to include; all if empty.
    since
        Dates from which flights count, by actuator; the key None applies to all others.
    repaired
        Likewise; flights before are shown, but neither trend nor baseline rests on them.
    baselines
        Function that returns the baselines for an airframe and a time; those of the flights if None.
    """
    trends: list[ActuatorTrend] = []
    standings: list[Standing] = []
    unshown: list[str] = []
    ordered, counted = counting(flights), latest(since, repaired)
    known = baselines or _baselines_in(ordered, counted)
    for (vehicle, actuator, _), flown in _by_actuator(ordered, since, counted).items():
        if actuators and actuator not in actuators:
            continue
        shown = _by_fault(flown)
        if not shown and flown[-1].verdict.condition != "unmonitored":
            unshown.append(f"{vehicle}: {actuator}")
        own = _trends(flown, shown, known)
        standings.append(standing_of(flown, own))
        trends += [one for one in own if not faults or one.fault in faults]
    return TrendReport(
        flights=len(ordered),
        trends=tuple(sorted(trends, key=_rank)),
        unshown=tuple(unshown),
        standings=_ranked(standings),
    )


def standings_over(
    flights: Iterable[PastFlight],
    *,
    since: Since | None = None,
    repaired: Since | None = None,
    baselines: BaselineSource | None = None,
) -> tuple[Standing, ...]:
    """Return each actuator's state over its flights, worst first; arguments as of :func:`trend_report`."""
    ordered, counted = counting(flights), latest(since, repaired)
    known = baselines or _baselines_in(ordered, counted)
    several = _by_actuator(ordered, since, counted).values()
    return _ranked(standing_of(flown, _trends(flown, _by_fault(flown), known)) for flown in several)


def _baselines_in(flights: list[PastFlight], counted: Since) -> BaselineSource:
    return cache(lambda airframe, before: baselines_of(flights, airframe, before, counted))


def standings_after(
    flown: PastFlight,
    recent: Iterable[PastFlight],
    since: Since | None,
    baselines: BaselineSource | None = None,
) -> tuple[Standing, ...]:
    """Return each actuator's state over its flights, up to this one.

    Parameters
    ----------
    flown
        The flight, compared with the earlier ones.
    recent
        The aircraft's flights; those after this one do not count.
    since
        Dates from which an actuator's flights count.
    baselines
        As of :func:`trend_report`.
    """
    before = [one for one in recent if one.end <= flown.start and one.log != flown.log]
    if not before:
        return ()
    states = standings_over([*before, flown], repaired=since, baselines=baselines)
    return tuple(one for one in states if one.last_utc == flown.start.isoformat())


def _ranked(standings: Iterable[Standing]) -> tuple[Standing, ...]:
    return tuple(sorted(standings, key=lambda one: one.rank))


def _trends(flown: list[Flown], shown: dict[str, _Shown], baselines: BaselineSource) -> list[ActuatorTrend]:
    """Return an actuator's trends by fault."""
    found = []
    for fault in sorted(shown):
        newest = shown[fault][-1][0].flight
        known = baselines(newest.airframe, newest.start)
        baseline = known.get((flown[-1].verdict.vehicle or 0, flown[-1].verdict.actuator, fault))
        found.append(_trend(flown, shown[fault], baseline))
    return found


def _by_actuator(
    flights: Iterable[PastFlight], since: Since | None, counted: Since
) -> dict[tuple[int, str, str | None], list[Flown]]:
    """Return the flights of each actuator in time order."""
    found: dict[tuple[int, str, str | None], list[Flown]] = {}
    for flight in flights:
        start_utc = flight.start.isoformat()
        for verdict in flight.verdicts:
            if verdict.vehicle is None or verdict.actuator == ALL:
                continue
            if not flight.counts(verdict.actuator, since):
                continue
            key = (verdict.vehicle, verdict.actuator, flight.airframe)
            flown = found.setdefault(key, [])
            counts = flight.counts(verdict.actuator, counted)
            flown.append(Flown(len(flown) + 1, flight, start_utc, verdict, verdict.gravest, counts))
    return found


def _by_fault(flown: list[Flown]) -> dict[str, _Shown]:
    """Return the flights that show each fault's indicator, in the quantity and unit of the newest of them."""
    found: dict[tuple[str, str, str], _Shown] = {}
    for each in flown:
        for one in each.verdict.indicators:
            found.setdefault((one.fault, one.quantity, one.unit), []).append((each, one))
    by_age = sorted(found.items(), key=lambda item: item[1][-1][0].number)
    return {fault: pairs for (fault, *_), pairs in by_age}


def _trend(flown: list[Flown], pairs: _Shown, baseline: Baseline | None) -> ActuatorTrend:
    newest = pairs[-1][1]
    latest = flown[-1].verdict
    limit, emergency = newest.limit, newest.emergency
    limits_of_axis = latest.whole().limits if newest.fault in LOSSES else None
    if limits_of_axis is not None and baseline is not None:
        limit = limits_of_axis.effectiveness_degraded * baseline.mean
        emergency = limits_of_axis.effectiveness_emergency * baseline.mean
    used = [pair for pair in pairs if pair[0].counts]
    sign = -1.0 if newest.fault in LOSSES else 1.0
    numbers = np.array([each.number for each, _ in used], dtype=np.float64)
    values = sign * np.array([one.estimate for _, one in used], dtype=np.float64)
    errors = np.array([one.error for _, one in used], dtype=np.float64)
    place = last_step(values, errors)
    step = None if place is None else step_of(used, place)
    course = course_of(numbers, values, errors, begin=place or 0)
    limits = (None if limit is None else sign * limit, None if emergency is None else sign * emergency)
    grows = course is not None and (course.grows or _grew(course, numbers, values, errors, place or 0))
    grown = growth_of(course, used, limits) if course and grows else None
    line = course.line if course else None
    left = grown.to_emergency if grown else None
    expected = baseline.prediction() if baseline else None
    return ActuatorTrend(
        subject=latest.subject,
        vehicle=latest.vehicle or 0,
        actuator=latest.actuator,
        airframe=flown[-1].flight.airframe,
        fault=newest.fault,
        quantity=newest.quantity,
        unit=newest.unit,
        condition=flown[-1].gravest,
        flights=len(flown),
        limit=limit,
        emergency=emergency,
        baseline=expected,
        change=_change(newest, expected),
        level=in_sense(line.level, newest.fault) if line else None,
        per_flight=grown.per_flight if grown else in_sense(line.per_flight, newest.fault) if line else None,
        between=line.between if line else None,
        left_out=tuple(used[index][0].start_utc for index in course.left_out) if course else (),
        growth=grown,
        step=step,
        flights_left=_life(left),
        reason=_why_unknown(grown, emergency, len(used) - (place or 0), step),
        points=_points(pairs),
    )


def _points(pairs: _Shown) -> FlightPoints:
    flown, shown = [each for each, _ in pairs], [one for _, one in pairs]
    at_end = shown[-1].fault == "friction"
    columns = {
        "flight": [each.number for each in flown],
        "start_utc": [each.start_utc for each in flown],
        "log": [each.flight.path for each in flown],
        "estimate": [one.estimate for one in shown],
        "low": [one.low for one in shown],
        "high": [one.high for one in shown],
        "highest": [one.highest for one in shown],
        "end": [each.verdict.friction_nm if at_end else None for each in flown],
        "condition": [each.gravest for each in flown],
    }
    return FlightPoints.model_validate(columns)


def _grew(course: Course, numbers: Array, values: Array, errors: Array, begin: int) -> bool:
    """Return whether growth was certain after one of the last flights, and is still likelier than none.

    The test holds however often it is asked, so what it once found stays found; without this a list would say
    "grows", "normal" and "grows" in turn while the evidence is near its threshold.
    """
    if course.evidence <= 0:
        return False
    earlier = (
        course_of(numbers[:-back], values[:-back], errors[:-back], begin=begin)
        for back in range(1, LASTING_FLIGHTS)
    )
    return any(one is not None and one.grows for one in earlier)


def _life(left: FlightsLeft | None) -> Interval | None:
    if left is None or left.high is None:
        return None
    return Interval(estimate=left.estimate, low=left.low, high=left.high)


def _why_unknown(
    growth: Growth | None, emergency: float | None, flights: int, step: Step | None
) -> str | None:
    """Return why the flights left to the emergency limit are not known; None if they are."""
    if growth is None:
        if flights < TREND_FLIGHTS:
            since = f" since the step at flight {step.flight}" if step else ""
            return f"{flights} flights show it{since}; a trend needs {TREND_FLIGHTS}"
        return "no growth beyond the scatter between flights"
    if emergency is None:
        return "it grows, but has no emergency limit"
    return None if _life(growth.to_emergency) else "it grows, but may never reach its limit"


def _change(newest: PastIndicator, expected: Interval | None) -> Interval | None:
    if expected is None:
        return None
    value = newest.estimate
    return Interval(estimate=value - expected.estimate, low=value - expected.high, high=value - expected.low)


def _rank(one: ActuatorTrend) -> tuple[float, float, float, int, str]:
    """Sort by worst condition, then fewest remaining flights, then smallest distance to the limit."""
    ahead = one.growth.ahead if one.growth else []
    left = min((each.low for each in ahead), default=float("inf"))
    value = one.points.estimate[-1]
    share = 0.0
    if one.emergency and value:
        share = one.emergency / value if one.fault in LOSSES else value / one.emergency
    return -URGENCY[one.condition], left, -share, one.vehicle, one.actuator
