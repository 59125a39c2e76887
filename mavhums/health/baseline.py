"""An actuator's own baseline: its indicators in earlier flights.

Individual actuators differ far more than one actuator differs from flight to flight. A change from
the actuator's own baseline therefore reveals wear long before a limit for the type does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from mavhums.health.random_effects import NATURAL_SCATTER, population
from mavhums.report.assessment import Indicator, Interval

__all__ = ["LEAST_FLIGHTS", "Baseline", "BaselineSource", "Baselines", "of_subject"]

LEAST_FLIGHTS = 10
"""Fewer flights make no baseline: their scatter is too uncertain to keep the promised false alarms."""

_LEAST_FREEDOM = 3

_SCATTER = {"effectiveness": 0.07, "manoeuvre": 0.07}
"""Scatter of an axis between healthy flights: 6.5 % of the roll gain in 19 flights of the ALFA aircraft."""

Array = NDArray[np.float64]


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
        :func:`mavhums.health.random_effects.population`.
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
        half = float(stdtrit(self.flights - 1, 0.975)) * self.spread * (1.0 + 1.0 / self.flights) ** 0.5
        return Interval(estimate=self.mean, low=self.mean - half, high=self.mean + half)

    @classmethod
    def of(cls, indicators: Sequence[Indicator]) -> Baseline | None:
        """Return the baseline of several flights; None if too few show their scatter.

        Ten are needed, or as many as the indicators say.
        """
        needed = max((i.needed_flights for i in indicators if i.needed_flights), default=LEAST_FLIGHTS)
        shown = [
            (i.value.estimate, i.windows, i.scatter)
            for i in indicators
            if i.scatter is not None and i.windows > 1
        ]
        if len(shown) < needed:
            return None
        values, windows, scatter = (np.array(column, dtype=np.float64) for column in zip(*shown, strict=True))
        errors = _errors(windows, scatter)
        errors = np.maximum(errors, max(1e-9 * np.abs(values).max(), 1e-12))
        natural = _SCATTER.get(indicators[0].fault, NATURAL_SCATTER)
        flights = population(np.ones((len(values), 1)), values, errors, natural)
        return cls(
            mean=float(flights.coefficients[0]),
            error=float(np.sqrt(flights.covariance[0, 0])),
            flights=len(shown),
            between=flights.between,
            spread=float(values.std(ddof=1)),
            freedom=flights.freedom,
        )


def _errors(windows: Array, scatter: Array) -> Array:
    """Return the standard errors of flights' values; with few windows the scatter is uncertain."""
    freedom = np.maximum(windows - 1, _LEAST_FREEDOM)
    errors: Array = scatter * np.sqrt(freedom / (freedom - 2) / windows)
    return errors


Baselines = Mapping[tuple[int, str, str], Baseline]
"""Baselines by vehicle, actuator and fault."""

BaselineSource = Baselines | Callable[[str | None, datetime | None], Baselines]
"""Baselines, or a function of airframe and start of the flight (None if unknown) that returns them."""


def of_subject(baselines: Baselines, subject: tuple[int, str]) -> dict[str, Baseline]:
    """Return the baselines of one vehicle's actuator or axis, by fault."""
    return {fault: known for (*whose, fault), known in baselines.items() if tuple(whose) == subject}
