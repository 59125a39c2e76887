"""Learns an individual's nuisances from its own flights, and estimates its wear with these fixed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mavhums.core.arrays import Array
from mavhums.health.estimation.equations import STROKE_EQUATIONS
from mavhums.health.estimation.flight_sums import KEPT
from mavhums.health.estimation.least_squares import eliminated, unpacked
from mavhums.health.estimation.thresholds import (
    LEAST_ERROR_SHARE,
    LEAST_PARTS,
    LEAST_SAMPLES,
    LOAD_SHOWS_ERRORS,
)
from mavhums.results.verdict import OwnRecord

_SIGN, _LEFT = KEPT.index("sign"), KEPT.index("left")
_SPEED, _ACCELERATION = KEPT.index("speed"), KEPT.index("acceleration")
_LOAD, _ANGLE, _LOADED = KEPT.index("load"), KEPT.index("angle"), KEPT.index("loaded")


@dataclass(frozen=True, slots=True)
class Nuisances:
    """Fixed coefficients of the individual, and the columns that are free in each flight.

    Attributes
    ----------
    held
        Coefficients by column of :data:`~mavhums.health.estimation.flight_sums.KEPT`.
    free
        Free columns: the load's, if the airspeed is not known.
    load
        Load to which the wear refers, in the unit of the left side: the median of the flights.
    """

    held: dict[int, float]
    free: tuple[int, ...]
    load: float = 0.0

    @property
    def load_friction(self) -> float:
        """μ of the individual: friction per load; zero if its flights show none."""
        return self.held.get(_LOADED, 0.0)


@dataclass(frozen=True, slots=True)
class Wear:
    """A flight's wear coefficient, its standard error, and the degrees of freedom of the error."""

    value: float
    error: float
    freedom: float


def grams_of(record: OwnRecord) -> tuple[Array, Array]:
    """Return a record's numbers of samples, shape (g,), and Gram matrices, shape (g, 7, 7)."""
    rows = np.array(record.groups, dtype=np.float64)
    return rows[:, 0], np.array([unpacked(row[1:], len(KEPT)) for row in rows])


def mean_load(record: OwnRecord) -> float | None:
    """Return the mean size of the load in motion, in the unit of the left side; None if not recorded."""
    if of_strokes(record):
        return abs(float(np.mean([row[2] for row in record.groups])))
    gram = grams_of(record)[1].sum(axis=0)
    return float(gram[_SIGN, _LOADED] / gram[_SIGN, _SIGN]) if gram[_SIGN, _SIGN] > 0.0 else None


def load_direction(record: OwnRecord) -> float:
    """Return the mean sign of the load over the strokes."""
    return float(np.mean(np.sign([row[2] for row in record.groups])))


def _columns(record: OwnRecord) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the fixed columns, and the free ones."""
    no_airspeed = record.setup.endswith("no airspeed")
    held, free = ((), (_ANGLE,)) if no_airspeed else ((_LOAD,), ())
    return (_SPEED, _ACCELERATION, *held), free


def information(record: OwnRecord) -> float:
    """Return the number of samples that determine a flight's wear, as many to either side, or of strokes."""
    if of_strokes(record):
        return float(len(record.groups))
    return sum(row[1 + _SIGN] for row in record.groups)


def learned(records: Sequence[OwnRecord]) -> Nuisances | None:
    """Return the joint nuisances of flights with the same set-up; None if they do not determine them.

    Each flight has a wear of its own. It counts by the inverse variance of its residuals, for gusts disturb
    the balance. The friction by load is one of them where the flights show it.
    """
    if of_strokes(records[0]):
        return Nuisances({}, ())
    loads = [load for record in records if (load := mean_load(record)) is not None]
    if len(loads) == len(records):
        found = _fitted(records, (_LOADED,))
        if found is not None and found.load_friction > 0.0:
            return replace(found, load=float(np.median(loads)))
    return _fitted(records, ())


def _fitted(records: Sequence[OwnRecord], more: tuple[int, ...]) -> Nuisances | None:
    """Return the joint nuisances with ``more`` columns; None if they, or one of these, do not show."""
    held, free = _columns(records[0])
    held = (*held, *more)
    total = np.zeros((len(KEPT), len(KEPT)))
    for record in records:
        counts, grams = grams_of(record)
        gram = eliminated(grams.sum(axis=0), [_SIGN, *free])
        left = eliminated(gram, held)[_LEFT, _LEFT]
        freedom = counts.sum() - len(counts) - len(held) - 1
        # Each flight by the inverse variance of its residuals: gusts disturb the balance.
        if freedom > 0 and left > 0.0:
            total += gram * freedom / left
    normal = total[np.ix_(held, held)]
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0.0).all():
        return None
    scaled = normal / np.outer(scale, scale)
    coefficients = np.linalg.lstsq(scaled, total[list(held), _LEFT] / scale)[0] / scale
    errors = np.sqrt(np.maximum(np.diag(np.linalg.pinv(scaled)), 0.0)) / scale
    for column in more:
        k = held.index(column)
        # Noise that passes for friction by load would be taken off the flights' friction.
        if abs(coefficients[k]) < LOAD_SHOWS_ERRORS * errors[k]:
            return None
    return Nuisances(dict(zip(held, coefficients.tolist(), strict=True)), free)


def wear(record: OwnRecord, nuisances: Nuisances | None) -> Wear | None:
    """Return a flight's wear with fixed nuisances, or free ones if None; None if it is not determined."""
    if not shows(record):
        return None
    if of_strokes(record):
        return _stroke_wear(record)
    counts, grams = grams_of(record)
    held, free = _columns(record)
    if nuisances is None:
        free = (*held, *free)
    else:
        for column, coefficient in nuisances.held.items():
            grams[:, _LEFT, :] -= coefficient * grams[:, column, :]
            grams[:, :, _LEFT] -= coefficient * grams[:, :, column]
    total = grams.sum(axis=0)
    whole = eliminated(total, free)
    information = whole[_SIGN, _SIGN]
    value = whole[_SIGN, _LEFT] / information
    # T_c and μ trade: what is compared is the friction at one load.
    at_load = 0.0 if nuisances is None else nuisances.load_friction * nuisances.load
    without = [eliminated(total - gram, free) for gram in grams]
    # Without one part nothing would be left: the jackknife has no value there.
    if min(rest[_SIGN, _SIGN] for rest in without) <= 1e-9 * total[_SIGN, _SIGN]:
        return None
    others = np.array([rest[_SIGN, _LEFT] / rest[_SIGN, _SIGN] for rest in without])
    shares = grams[:, _SIGN, _SIGN]
    # Parts differ in length: so many of equal length are worth the same.
    effective = float(shares.sum() ** 2 / (shares**2).sum())
    jackknife = float(((others - others.mean()) ** 2).sum()) * (len(grams) - 1) / len(grams)
    residual = max(float(whole[_LEFT, _LEFT] - value**2 * information), 0.0)
    independent = residual / max(float(counts.sum()) - len(counts) - 1.0, 1.0) / information
    error = max(jackknife, independent) ** 0.5
    return Wear(float(value) + at_load, error, max(effective - 1.0, 1.0))


def of_strokes(record: OwnRecord) -> bool:
    """Return whether a record holds a quantity of each stroke, and no sums."""
    return record.equation in {equation.name for equation in STROKE_EQUATIONS}


def _stroke_wear(record: OwnRecord) -> Wear:
    """Return the mean over the strokes.

    Strokes repeat one motion, so that what they scatter by is in the scatter between flights already; a fault
    that makes the strokes uneven must not hide itself in an error of its own.
    """
    mean = float(np.mean([row[1] for row in record.groups]))
    return Wear(mean, LEAST_ERROR_SHARE * abs(mean), len(record.groups) - 1.0)


def shows(record: OwnRecord) -> bool:
    """Return whether a flight has enough motion in both directions to determine the wear."""
    if of_strokes(record):
        return len(record.groups) >= LEAST_PARTS
    return information(record) >= 2.0 * LEAST_SAMPLES and len(record.groups) >= LEAST_PARTS
