"""Compares a flight with the earlier flights: a pure function of their stored sums."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import NamedTuple

import numpy as np

from mavhums.core.arrays import Array
from mavhums.core.conditions import Condition
from mavhums.core.statistics import CENTRAL_95, NORMAL_95_ONE_SIDED, t_quantile
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.decision.limits import tail_of_flight
from mavhums.health.decision.thresholds import FALSE_ALARMS, HORIZON_FLIGHTS
from mavhums.health.estimation.equations.interface import OwnEquation
from mavhums.health.estimation.random_effects import (
    CommonError,
    Population,
    population,
    satterthwaite,
    scattering_share,
)
from mavhums.health.estimation.thresholds import LEAST_PARTS
from mavhums.health.estimation.wear import (
    Nuisances,
    Wear,
    information,
    learned,
    wear,
)
from mavhums.health.self_baseline.past import Difference, compared, differences
from mavhums.health.self_baseline.thresholds import BLURRED_TIMES
from mavhums.results.verdict import Interval, OwnRecord


class Onset(NamedTuple):
    """The first of the consecutive flights that show a change: its number, from 1, and its date."""

    flight: int
    date: str


@dataclass(frozen=True, slots=True)
class Comparison:
    """The comparison of a flight with the earlier flights.

    Attributes
    ----------
    condition
        ``unchanged``, ``changed``, ``learning``, or ``undecided``.
    value, baseline
        The quantity in this flight, and its 95 % prediction from the earlier flights; None if this flight
        does not determine it, and if there is no baseline yet.
    flights, needed
        Number of flights in the baseline, or so far, and the number that it needs.
    change
        Relative to the baseline, with its 95 % interval.
    least_rise
        Relative rise that would be detected with 95 % probability.
    since
        First flight with the change; None if it is this flight, or if there is no change.
    why
        Reason of a second baseline.
    load
        Load to which the quantity refers, in its unit; None where it does not grow with the load.
    """

    condition: Condition
    value: Interval | None
    flights: int
    needed: int
    baseline: Interval | None = None
    change: Interval | None = None
    least_rise: float | None = None
    since: Onset | None = None
    why: str = ""
    load: float | None = None


def compare(
    equation: OwnEquation, own: OwnRecord, past: Sequence[PastRecord], false_alarms: float = FALSE_ALARMS
) -> Comparison:
    """Return the comparison of a flight with the earlier flights.

    Parameters
    ----------
    equation
        Equation whose wear is compared.
    own
        Record of the flight.
    past
        All earlier flights, in time order.
    false_alarms
        Allowed false alarms per 100 hours of the actuator.
    """
    return _compare(equation, own, past, false_alarms, ())


def _compare(
    equation: OwnEquation,
    own: OwnRecord,
    past: Sequence[PastRecord],
    false_alarms: float,
    outside: tuple[Difference, ...],
) -> Comparison:
    """Compare a flight with those outside the same baselines."""
    needed = equation.min_flights
    reference, after = compared(equation, own, past, outside)
    records = tuple(record for _, _, record in reference)
    healthy = _ReferenceFlights.of(equation, records) if len(records) >= needed else None
    if healthy is None or healthy.shown < needed:
        flights = sum(wear(record, None) is not None for record in records)
        alone = wear(own, None)
        if alone is None:
            return _still(equation, flights)
        why = f"it was {outside[-1].beyond(own)} than the flights of the first baseline" if outside else ""
        return Comparison("learning", _interval(alone), min(flights + 1, needed), needed, why=why)
    own_wear = wear(own, healthy.nuisances)
    if own_wear is None:
        return _still(equation, healthy.shown)
    # Outside the baseline's range the line over activity or load is a guess: the flights there
    # make a baseline of their own.
    if beyond := healthy.beyond(own):
        return _compare(equation, own, past, false_alarms, (*outside, beyond))
    rise, bound, found = healthy.rise(own_wear, own, false_alarms)
    return Comparison(
        condition="changed" if rise > bound else "unchanged",
        value=_interval(own_wear),
        flights=healthy.shown,
        needed=equation.min_flights,
        baseline=healthy.prediction(own),
        change=healthy.relative(own_wear, own),
        least_rise=found / abs(healthy.mean(own)),
        since=healthy.since(islice(after, HORIZON_FLIGHTS), false_alarms) if rise > bound else None,
        load=healthy.load,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _ReferenceFlights:
    """The reference flights: their population, and their known differences.

    ``noise`` is the largest error of a flight with one sample of information; infinite if a flight's own
    error counts however large it is. ``common`` is what they know of a flight's error, ``shared`` the share
    of its variance that scatters from flight to flight, with its degrees of freedom.
    """

    nuisances: Nuisances
    flights: Population
    differences: tuple[Difference, ...]
    sign: float
    shown: int
    noise: float
    common: CommonError
    shared: tuple[float, float]

    @classmethod
    @lru_cache(maxsize=1024)
    def of(cls, equation: OwnEquation, records: tuple[OwnRecord, ...]) -> _ReferenceFlights | None:
        """Learn from reference flights."""
        nuisances = learned(records)
        shown = [(w, r) for r in records if (w := wear(r, nuisances))]
        if nuisances is None or len(shown) < LEAST_PARTS:
            return None
        values = np.array([w.value for w, _ in shown])
        informed = np.array([information(r) for _, r in shown])
        squares, freedom = np.array([(w.error**2, w.freedom) for w, _ in shown]).T
        common = CommonError.of(squares * informed, freedom)
        own = [common.with_own(*row)[0] for row in zip(squares, freedom, informed, strict=True)]
        loaded = bool(nuisances.load_friction)
        known = tuple(differences(equation, [r for _, r in shown], loaded=loaded))
        design = np.array([_row(known, r) for _, r in shown])
        shared = scattering_share(design, values, np.sqrt(own))
        flights = population(design, values, np.sqrt(shared[0] * np.array(own)))
        noise = BLURRED_TIMES * float((squares * informed).max()) ** 0.5 if equation.blurs else np.inf
        sign = float(np.copysign(1.0, flights.coefficients[0]))
        return cls(nuisances, flights, known, sign, len(shown), noise, common, shared)

    @property
    def load(self) -> float | None:
        """Load to which the wear refers; None where it does not grow with the load."""
        return self.nuisances.load if self.nuisances.load_friction else None

    def beyond(self, record: OwnRecord) -> Difference | None:
        """Return the difference over which the reference flights would be extrapolated to a flight."""
        return next((known for known in self.differences if known.beyond(record)), None)

    def mean(self, record: OwnRecord) -> float:
        """Return the expected value of a flight."""
        return float(_row(self.differences, record) @ self.flights.coefficients)

    def rise(self, own_wear: Wear, record: OwnRecord, false_alarms: float) -> tuple[float, float, float]:
        """Return the rise, its threshold, and the rise that would be detected with 95 % probability."""
        error, freedom = self._error(own_wear, record)
        tail = tail_of_flight(false_alarms, record.duration_s)
        bound = t_quantile(freedom, 1.0 - tail) * error
        return self.sign * (own_wear.value - self.mean(record)), bound, bound + NORMAL_95_ONE_SIDED * error

    def _error(self, own_wear: Wear, record: OwnRecord) -> tuple[float, float]:
        """Return the standard error of a flight's rise, and its degrees of freedom."""
        variance = self.flights.variance_at(_row(self.differences, record))
        # A grave fault makes the flight as uncertain as large, and would hide itself.
        most = self.noise / information(record) ** 0.5
        own, freedom = self._own(min(own_wear.error, most), own_wear, record)
        return (variance + own) ** 0.5, satterthwaite(variance, self.flights.freedom, own, freedom)

    def _own(self, error: float, own_wear: Wear, record: OwnRecord) -> tuple[float, float]:
        """Return what scatters of a flight's own variance, and its degrees of freedom."""
        variance, freedom = self.common.with_own(error**2, own_wear.freedom, information(record))
        share, known = self.shared
        # The share is an estimate, too: relative variances of a product add up.
        return share * variance, 1.0 / (1.0 / freedom + 1.0 / known)

    def relative(self, own_wear: Wear, record: OwnRecord) -> Interval:
        """Return the relative change with its 95 % interval."""
        mean = self.mean(record)
        change = own_wear.value / mean - 1.0
        own, _ = self._own(own_wear.error, own_wear, record)
        error = (own + self.flights.variance_at(_row(self.differences, record))) ** 0.5 / abs(mean)
        half = t_quantile(min(own_wear.freedom, self.flights.freedom), CENTRAL_95) * error
        return Interval.around(change, half)

    def prediction(self, record: OwnRecord) -> Interval:
        """Return the 95 % interval of a healthy flight's value."""
        mean, row = self.mean(record), _row(self.differences, record)
        half = t_quantile(self.flights.freedom, CENTRAL_95) * self.flights.variance_at(row) ** 0.5
        return Interval.around(mean, half)

    def since(self, latest: Iterable[tuple[int, str, OwnRecord]], false_alarms: float) -> Onset | None:
        """Return the first of the consecutive flights that also show the change, from the latest one back."""
        first = None
        for number, date, record in latest:
            own_wear = wear(record, self.nuisances)
            # A flight that says nothing neither begins nor ends a run.
            if own_wear is None or self.beyond(record):
                continue
            rise, bound, _ = self.rise(own_wear, record, false_alarms)
            if rise <= bound:
                break
            first = Onset(number, date)
        return first


def _row(known: Sequence[Difference], record: OwnRecord) -> Array:
    return np.array([1.0, *(one.at(record) for one in known if one.fitted)])


def _still(equation: OwnEquation, flights: int) -> Comparison:
    return Comparison("undecided", None, flights, equation.min_flights)


def _interval(of: Wear) -> Interval:
    return Interval.around(of.value, t_quantile(of.freedom, CENTRAL_95) * of.error)
