"""Known differences between flights that shift an actuator's quantity, such as its temperature."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavhums.health.own.equation import OwnEquation
from mavhums.health.own.fit import grams_of
from mavhums.health.own.record import KEPT
from mavhums.report.assessment import OwnRecord

__all__ = ["Difference", "differences"]

_WARMTH_K = 5.0  # temperature difference among the flights from which the slope can be determined
_BEYOND_K = 3.0
_ACTIVITY = 0.2  # of the logarithm: a fifth
_ACCELERATION = KEPT.index("acceleration")

Array = NDArray[np.float64]
_Of = Callable[[OwnRecord], float | None]


@dataclass(frozen=True, slots=True)
class Difference:
    """A number by flight on which the quantity depends linearly, within the range of the reference flights.

    Attributes
    ----------
    of
        Returns the number of a flight.
    mean, low, high
        Mean and range over the reference flights.
    margin
        Extrapolation that is allowed.
    below, above
        Comparative of a flight below and above that range.
    """

    of: _Of
    mean: float
    low: float
    high: float
    margin: float
    below: str
    above: str

    def at(self, record: OwnRecord) -> float:
        """Return a flight's difference from the mean; zero if it is not known."""
        value = self.of(record)
        return 0.0 if value is None else value - self.mean

    def beyond(self, record: OwnRecord) -> str:
        """Return the comparative of a flight that would be extrapolated; empty if none."""
        value = self.of(record)
        if value is None or self.low - self.margin <= value <= self.high + self.margin:
            return ""
        return self.below if value < self.low else self.above


def differences(equation: OwnEquation, records: Sequence[OwnRecord], *, warm: bool) -> list[Difference]:
    """Return the differences that the reference flights determine.

    Parameters
    ----------
    equation
        The equation of the records.
    records
        Records of the reference flights.
    warm
        Whether the temperature of the judged flight is known.
    """
    found = []
    warmth = _difference(_temperature, records, _BEYOND_K, "colder", "warmer")
    if warm and warmth is not None and warmth.high - warmth.low >= _WARMTH_K:
        found.append(warmth)
    if equation.by_activity:
        activity = _difference(_activity, records, _ACTIVITY, "calmer", "rougher")
        if activity is not None and activity.high > activity.low:
            found.append(activity)
    return found


def _difference(
    of: _Of, records: Sequence[OwnRecord], margin: float, below: str, above: str
) -> Difference | None:
    told = [value for record in records if (value := of(record)) is not None]
    if len(told) < len(records):
        return None
    return Difference(of, float(np.mean(told)), min(told), max(told), margin, below, above)


def _temperature(record: OwnRecord) -> float | None:
    return record.temperature_c


def _activity(record: OwnRecord) -> float:
    """Return the logarithm of the root mean square acceleration in motion."""
    counts, grams = grams_of(record)
    mean = float(grams[:, _ACCELERATION, _ACCELERATION].sum() / counts.sum())
    return 0.5 * float(np.log(max(mean, 1e-12)))
