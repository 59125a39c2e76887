"""The earlier flights that one own-scale equation is compared with, and in what the present one may differ.

Activity and load differ from flight to flight without a fault.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import log

import numpy as np

from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.equations import OWN_EQUATIONS, STROKE_EQUATIONS
from mavhums.health.estimation.equations.interface import OwnEquation
from mavhums.health.estimation.flight_sums import KEPT
from mavhums.health.estimation.thresholds import NATURAL_SCATTER_SHARE, REFERENCE_FLIGHTS
from mavhums.health.estimation.wear import grams_of, load_direction, mean_load, of_strokes, shows
from mavhums.health.self_baseline.thresholds import ALIKE_RATIO, OTHER_DIRECTION
from mavhums.results.verdict import OwnRecord

_ACCELERATION = KEPT.index("acceleration")
_Of = Callable[[OwnRecord], float | None]
_Numbered = tuple[int, str, OwnRecord]


def record_of(records: Sequence[OwnRecord], name: str) -> OwnRecord | None:
    """Return the record of one equation."""
    return next((record for record in records if record.equation == name), None)


def compared(
    equation: OwnEquation, own: OwnRecord, past: Sequence[PastRecord], beyond: Sequence[Difference] = ()
) -> tuple[list[_Numbered], Iterator[_Numbered]]:
    """Return the reference flights, and the later ones from the latest on, with the same set-up as this one.

    Each comes with its number among all flights, from 1, and its date. They lie beyond the same
    baselines as this flight, whose differences ``beyond`` are. Records that are not needed are not read.
    """

    def alike(numbers: Iterable[int]) -> Iterator[_Numbered]:
        for number in numbers:
            flight = past[number - 1]
            record = record_of(flight.records, equation.name)
            if record is None or not _alike(own, record) or not shows(record):
                continue
            if all(before.beyond(record) == before.beyond(own) for before in beyond):
                yield number, flight.date, record

    # The first healthy ones for good: a baseline that follows would learn slow wear.
    healthy = (number for number, flight in enumerate(past, 1) if flight.healthy)
    reference = [*islice(alike(healthy), REFERENCE_FLIGHTS)]
    last = reference[-1][0] if reference else 0
    return reference, alike(range(len(past), last, -1))


def _alike(one: OwnRecord, other: OwnRecord) -> bool:
    faster, slower = max(one.rate_hz, other.rate_hz), min(one.rate_hz, other.rate_hz)
    # Estimates depend on the rate and on what measured the angle.
    return one.setup == other.setup and faster <= ALIKE_RATIO * slower


def comparable(records: Sequence[OwnRecord]) -> bool:
    """Return whether records contain the wear of an equation, and not only motor identification data."""
    names = {equation.name for equation in (*OWN_EQUATIONS, *STROKE_EQUATIONS)}
    return any(record.equation in names for record in records)


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
    fitted
        Whether the quantity depends on it; else only its range counts.
    """

    of: _Of
    mean: float
    low: float
    high: float
    margin: float
    below: str
    above: str
    fitted: bool = True

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


def differences(
    equation: OwnEquation, records: Sequence[OwnRecord], *, loaded: bool = False
) -> list[Difference]:
    """Return the differences that the reference flights determine.

    Parameters
    ----------
    equation
        The equation of the records.
    records
        Records of the reference flights.
    loaded
        Whether the quantity grows with the load.
    """
    found = []
    if equation.by_activity:
        activity = _difference(_activity, records, log(ALIKE_RATIO), "calmer", "rougher")
        if activity is not None and activity.high > activity.low:
            found.append(activity)
    if of_strokes(records[0]) or loaded:
        found += _loads(records)
    if of_strokes(records[0]):
        found += _directions(records)
        fewest = min(_strokes(r) for r in records)
        found.append(
            Difference(_strokes, fewest, fewest, np.inf, 0.0, "shorter in strokes", "", fitted=False)
        )
    return found


def _difference(
    of: _Of, records: Sequence[OwnRecord], margin: float, below: str, above: str
) -> Difference | None:
    values = [value for record in records if (value := of(record)) is not None]
    # A difference that some flights do not show would be fitted on the others alone.
    if len(values) < len(records):
        return None
    return Difference(of, float(np.mean(values)), min(values), max(values), margin, below, above)


def _loads(records: Sequence[OwnRecord]) -> list[Difference]:
    """Return the loads of the flights, and their range: beyond it friction over load is a guess.

    What a flight's own samples show of μ is attenuated, for its light samples are those near stiction; a
    line over the flights takes the rest, where their loads differ.
    """
    found = _difference(mean_load, records, 0.0, "more lightly loaded", "more heavily loaded")
    if found is None:
        return []
    differ = found.high > ALIKE_RATIO * found.low
    # Friction grows at most as the load does: so little more of it is lost in the natural scatter.
    return [replace(found, margin=NATURAL_SCATTER_SHARE * found.high, fitted=differ)]


def _directions(records: Sequence[OwnRecord]) -> list[Difference]:
    """Return the direction of the load, which presses other flanks: friction and roughness differ there."""
    other = "loaded the other way"
    found = _difference(load_direction, records, OTHER_DIRECTION, other, other)
    return [] if found is None else [replace(found, fitted=found.high - found.low > OTHER_DIRECTION)]


def _strokes(record: OwnRecord) -> float:
    """Return the number of strokes: fewer than the baseline's flights have scatter more than these."""
    return float(len(record.groups))


def _activity(record: OwnRecord) -> float:
    """Return the logarithm of the root mean square acceleration in motion."""
    counts, grams = grams_of(record)
    mean = float(grams[:, _ACCELERATION, _ACCELERATION].sum() / counts.sum())
    return 0.5 * float(np.log(max(mean, 1e-12)))
