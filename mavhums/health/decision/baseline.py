"""An actuator's own baseline: its indicators in earlier flights.

Individual actuators differ far more than one actuator differs from flight to flight. A change from
the actuator's own baseline therefore reveals wear long before a limit for the type does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array
from mavhums.core.statistics import CENTRAL_95, t_quantile
from mavhums.health.decision.thresholds import AXIS_SCATTER_SHARE
from mavhums.health.estimation.random_effects import population, satterthwaite
from mavhums.health.estimation.thresholds import (
    BASELINE_FLIGHTS,
    LEAST_PARTS,
    NATURAL_SCATTER_SHARE,
    WINDOW_S,
)
from mavhums.health.sequential import EXCLUDING
from mavhums.results.verdict import Indicator, Interval, OwnRecord, Verdict

LOSSES: Final = ("effectiveness", "manoeuvre")
"""Faults of an axis, whose indicators fall as the fault grows."""


@dataclass(frozen=True, slots=True)
class Baseline:
    """One indicator of one actuator over its reference flights.

    The measurement error differs between flights: an hour in gusts gives a better estimate of friction than
    an hour of cruise, and a take-off a better one than both. Flights are weighted by their certainty, as in a
    random-effects meta-analysis.

    Attributes
    ----------
    mean, error
        Mean of the flights' values, weighted by certainty, and its standard error.
    flights, between
        Number of flights, and the standard deviation of their true values; see
        :func:`mavhums.health.estimation.random_effects.population`.
    spread
        Standard deviation of their measured values.
    freedom
        Degrees of freedom of another flight's deviation from the mean; flights less one if None.
    scatter
        Largest standard deviation of a flight's windows; None if it is not known.
    """

    mean: float
    error: float
    flights: int
    between: float
    spread: float
    freedom: float | None = None
    scatter: float | None = None

    @property
    def certainty(self) -> float:
        """Degrees of freedom of another flight's deviation."""
        return self.flights - 1.0 if self.freedom is None else self.freedom

    @property
    def flight_variance(self) -> float:
        """Variance of another flight's true value about the mean: between flights, plus the mean's own."""
        return self.between**2 + self.error**2

    def prediction(self) -> Interval:
        """Return the 95 % prediction interval of the value measured in another flight."""
        half = t_quantile(self.flights - 1, CENTRAL_95) * self.spread * (1.0 + 1.0 / self.flights) ** 0.5
        return Interval.around(self.mean, half)

    def pooled(self, scatter: float) -> Baseline:
        """Return the baseline with what others scatter between flights, which weighs as much as its own."""
        own, usual = self.flights - 1.0, BASELINE_FLIGHTS - 1.0
        between = ((own * self.between**2 + usual * scatter**2) / (own + usual)) ** 0.5
        return replace(self, between=between, error=between / self.flights**0.5, freedom=own + usual)

    @classmethod
    def of(cls, indicators: Sequence[Indicator]) -> Baseline | None:
        """Return the baseline of several flights; None if too few show their scatter.

        Ten are needed, or as many as the indicators say.
        """
        # Axes ask for fewer flights than actuators, and say so themselves.
        needed = max((i.needed_flights for i in indicators if i.needed_flights), default=BASELINE_FLIGHTS)
        shown = [
            (i.compared[0], i.windows, i.scatter)
            for i in indicators
            if i.scatter is not None and i.windows > 1
        ]
        if len(shown) < needed:
            return None
        values, windows, scatter = (np.array(column, dtype=np.float64) for column in zip(*shown, strict=True))
        errors = _errors(windows, scatter)
        # A flight with an error of zero would outweigh all others.
        errors = np.maximum(errors, max(1e-9 * np.abs(values).max(), 1e-12))
        natural = AXIS_SCATTER_SHARE if indicators[0].fault in LOSSES else NATURAL_SCATTER_SHARE
        design = _design(values, errors, indicators[0].fault)
        flights = population(design, values, errors, natural)
        apart = values - design @ flights.coefficients
        return cls(
            mean=float(flights.coefficients[0]),
            error=float(np.sqrt(flights.covariance[0, 0])),
            flights=len(shown),
            between=flights.between,
            spread=float(np.sqrt(apart @ apart / (len(values) - design.shape[1]))),
            freedom=flights.freedom,
            scatter=float(scatter.max()),
        )


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
        (value, error), between = indicator.compared, baseline.flight_variance
        own = max(indicator.windows - 1, 1)
        if indicator.mean is not None:
            # A fault that grows in flight makes its windows unlike, and must not hide itself.
            if baseline.scatter and indicator.scatter and indicator.scatter > baseline.scatter:
                error *= baseline.scatter / indicator.scatter
            own *= WINDOW_S - 1  # of ten slots
        freedom = satterthwaite(error**2, own, between, baseline.certainty)
        return cls(indicator, baseline, value - baseline.mean, max(error**2 + between, 1e-24) ** 0.5, freedom)

    @property
    def ratio(self) -> float:
        """The difference over its standard error."""
        return self.difference / self.error

    @property
    def times(self) -> float:
        """The quantity by its baseline."""
        return self.indicator.compared[0] / self.baseline.mean

    @property
    def share(self) -> Interval:
        """Return the quantity as a share of its baseline, with its 95 % interval."""
        mean = self.baseline.mean
        k = self.times
        half = t_quantile(self.freedom, CENTRAL_95) * self.error / abs(mean)
        return Interval(estimate=round(k, 3), low=round(k - half, 3), high=round(k + half, 3))


def _design(values: Array, errors: Array, fault: str) -> Array:
    """Return a column of ones, and the growth where the flights grow: the baseline is the level before it.

    A mean over flights that wear already would hide as much wear.
    """
    from mavhums.health.decision.growth import course_of  # SciPy's tests, needed only with earlier flights

    ones, numbers = np.ones_like(values), np.arange(len(values), dtype=np.float64)
    course = course_of(numbers, -values if fault in LOSSES else values, errors)
    if course is None or course.evidence < EXCLUDING:
        return ones[:, None]
    return np.column_stack([ones, np.maximum(numbers - course.since, 0.0)])


def _errors(windows: Array, scatter: Array) -> Array:
    """Return the standard errors of flights' values; with few windows the scatter is uncertain."""
    freedom = np.maximum(windows, LEAST_PARTS) - 1
    errors: Array = scatter * np.sqrt(freedom / (freedom - 2) / windows)
    return errors


Baselines = Mapping[tuple[int, str, str], Baseline]
"""Baselines by vehicle, actuator and fault."""


BaselineSource = Callable[[str | None, datetime | None], Baselines]
"""Baselines, or a function of airframe and start of the flight (None if unknown) that returns them."""


def with_baselines(verdict: Verdict, baselines: Mapping[str, Baseline]) -> Verdict:
    """Return a verdict whose indicators show their baselines, which are by fault."""

    def shown(one: Indicator) -> Indicator:
        if one.fault not in baselines:
            return one
        known = baselines[one.fault]
        return one.model_copy(update={"baseline": _expected(known), "baseline_flights": known.flights})

    return verdict.model_copy(update={"indicators": tuple(map(shown, verdict.indicators))})


@lru_cache(maxsize=1024)  # the baselines of an aircraft are the same in thousands of flights
def _expected(known: Baseline) -> Interval:
    return known.prediction().significant(5)


def of_subject(baselines: Baselines, subject: tuple[int, str]) -> dict[str, Baseline]:
    """Return the baselines of one vehicle's actuator or axis, by fault."""
    return {fault: known for (*whose, fault), known in baselines.items() if tuple(whose) == subject}


class PastRecord(NamedTuple):
    """The records of the own-scale equations of an earlier flight.

    Attributes
    ----------
    records
        One record for each equation.
    date
        Date of its start, as in the report.
    healthy
        Whether it has no findings and can be part of a baseline.
    """

    records: Sequence[OwnRecord]
    date: str
    healthy: bool


PastSource = Callable[[str | None, datetime | None], Mapping[tuple[int, str], Sequence[PastRecord]]]
"""What gives the flights before by vehicle and actuator, of an airframe and the time when a flight begins."""
