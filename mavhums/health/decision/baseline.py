"""An actuator's own baseline: its indicators in earlier flights.

Individual actuators differ far more than one actuator differs from flight to flight. A change from
the actuator's own baseline therefore reveals wear long before a limit for the type does.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Final, NamedTuple

import numpy as np

from mavhums.core.arrays import Array
from mavhums.core.conditions import SEVERITY, Condition
from mavhums.core.statistics import CENTRAL_95, NORMAL_95, t_quantile
from mavhums.health.decision.limits import tail_of
from mavhums.health.decision.thresholds import (
    AXIS_SCATTER_SHARE,
    DRIFT_SPANS_WINDOWS,
    FALSE_ALARMS,
)
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

_FREEDOM = WINDOW_S - 1.0


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
    """

    mean: float
    error: float
    flights: int
    between: float
    spread: float
    freedom: float | None = None

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
            (i.value.estimate, i.windows, i.scatter)
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
    def times(self) -> float:
        """The quantity by its baseline."""
        return self.indicator.value.estimate / self.baseline.mean

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
        expected = known.prediction().significant(5)
        return one.model_copy(update={"baseline": expected, "baseline_flights": known.flights})

    return verdict.model_copy(update={"indicators": tuple(map(shown, verdict.indicators))})


def of_subject(baselines: Baselines, subject: tuple[int, str]) -> dict[str, Baseline]:
    """Return the baselines of one vehicle's actuator or axis, by fault."""
    return {fault: known for (*whose, fault), known in baselines.items() if tuple(whose) == subject}


class Shift(NamedTuple):
    """Deviation of the last windows from the baseline.

    Attributes
    ----------
    value, error
        The quantity minus its baseline, and the standard error of the difference.
    ratio
        Shift divided by its threshold at the false-alarm rate; an alarm from 1 on.
    since_s
        Start of the first of these windows.
    """

    value: float
    error: float
    ratio: float
    since_s: float


def condition_with_drift(decided: Condition, alarm: Shift | None) -> Condition:
    """Return what a quantity shows: what the limits decided, or at least that it left its baseline."""
    return max(decided, "degraded", key=SEVERITY.__getitem__) if alarm else decided


def onset_with_drift(decided: Condition, since_s: float | None, alarm: Shift | None) -> float | None:
    """Return the flight time since which it does, the limits having decided at ``since_s``."""
    condition = condition_with_drift(decided, alarm)
    times = [since_s] if condition == decided else []
    times += [alarm.since_s] if alarm and condition == "degraded" else []
    return min((time for time in times if time is not None), default=None)


class Drift:
    """Compares one quantity of one actuator with its baseline through the flight.

    Parameters
    ----------
    baseline
        Baseline of the same quantity and actuator.
    two_sided
        Whether a decrease alarms like an increase.
    false_alarms
        Alarms per 100 hours.

    Attributes
    ----------
    alarm
        The shift at the first alarm; None before.

    Examples
    --------
    >>> drift = Drift(Baseline(0.2, error=0.001, flights=10, between=0.002, spread=0.003))
    >>> for k in range(12):
    ...     shift = drift.feed(0.25, 0.01, 9.0, 10.0 * k)
    >>> drift.alarm.since_s
    0.0
    """

    def __init__(
        self, baseline: Baseline, *, two_sided: bool = False, false_alarms: float = FALSE_ALARMS
    ) -> None:
        self.baseline = baseline
        self.alarm: Shift | None = None
        self._two_sided = two_sided
        # Half for the tests in flight, half for the finish; a two-sided test has two tails.
        self._tail = tail_of(false_alarms) / 2 / (2 if two_sided else 1)
        self._windows: deque[_SeparateWindow] = deque(maxlen=DRIFT_SPANS_WINDOWS[-1])

    def feed(self, value: float, error: float, freedom: float, start_s: float) -> Shift:
        """Add a window that does not overlap the previous one; return the most significant shift."""
        self._windows.append(_SeparateWindow(value - self.baseline.mean, error, freedom, start_s))
        spans = [span for span in DRIFT_SPANS_WINDOWS if span <= len(self._windows)]
        shifts = [self._over(span, self._tail / len(spans)) for span in spans]  # Bonferroni
        return self._account_for(max(shifts, key=lambda shift: shift.ratio))

    def conclude(self, value: float, error: float, freedom: float, start_s: float) -> Shift:
        """Test once more, with the estimate of the whole flight or with all its windows.

        The more certain of the two counts; a window's error excludes errors that all flights share.
        """
        count = max(len(self._windows), 1)
        # The finish has half of the allowed alarms for itself, over as many windows as the flight had.
        tail = self._tail * count
        whole = self._shift(value - self.baseline.mean, error**2, freedom, start_s, tail)
        together = self._over(count, tail) if self._windows else whole
        # The more certain of the two; a window's error leaves out what all flights share.
        return self._account_for(min(whole, together, key=lambda shift: shift.error))

    def _account_for(self, shift: Shift) -> Shift:
        if self.alarm is None and shift.ratio >= 1.0:
            self.alarm = shift
        return shift

    def _over(self, span: int, tail: float) -> Shift:
        values, errors, freedoms, starts_s = np.array(self._windows)[-span:].T
        weights = 1.0 / np.maximum(errors, 1e-12) ** 2
        shift = float(weights @ values / weights.sum())
        scatter = float(weights @ (values - shift) ** 2 / max(span - 1, 1))
        # By the windows' own scatter where it is larger than their errors promise.
        own = float(max(scatter, 1.0) / weights.sum())
        freedom = max(float(freedoms.max()), _FREEDOM * span)
        return self._shift(shift, own, freedom, float(starts_s[0]), tail)

    def _shift(self, shift: float, own: float, own_freedom: float, since_s: float, tail: float) -> Shift:
        """Return a shift of known variance, relative to its threshold for this tail probability."""
        flight = self.baseline.flight_variance
        error = float(np.sqrt(own + flight))
        freedom = satterthwaite(own, own_freedom, flight, self.baseline.certainty)
        size = abs(shift) if self._two_sided else shift
        return Shift(shift, error, size / (t_quantile(freedom, 1.0 - tail) * error), since_s)


class _SeparateWindow(NamedTuple):
    """A window's estimate minus the baseline, its standard error, degrees of freedom, and start."""

    value: float
    error: float
    freedom: float
    start_s: float


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

    records: tuple[OwnRecord, ...]
    date: str
    healthy: bool


PastSource = Callable[[str | None, datetime | None], Mapping[tuple[int, str], Sequence[PastRecord]]]
"""What gives the flights before by vehicle and actuator, of an airframe and the time when a flight begins."""
