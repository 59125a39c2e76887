"""Learns an individual's nuisances from its own flights, and estimates its wear with these fixed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians

import numpy as np

from mavhums.core.arrays import Array
from mavhums.health.estimation.equations import STROKE_EQUATIONS
from mavhums.health.estimation.equations.own_scale import LAG, POWER
from mavhums.health.estimation.flight_sums import KEPT, LINEAR, POWER_COLUMNS, QUADRATIC, WEAR
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
_EARLIER = len(KEPT) - 1
_C, _D, _E = QUADRATIC.index(9), QUADRATIC.index(11), QUADRATIC.index(12)
_POWER = POWER_COLUMNS - 1
_ROUNDS = 4  # of reweighting: more cost time in each flight and each of its references


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
        Load at which the wear is told, in the unit of the left side: the median of the flights.
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
    if _has_load(record):
        return rows[:, 0], np.array([unpacked(row[1:], len(KEPT)) for row in rows])
    grams = np.zeros((len(rows), len(KEPT), len(KEPT)))
    kept = [k for k in range(len(KEPT)) if k != _LOADED]
    grams[:, np.ix_(kept, kept)[0], kept] = np.array([unpacked(row[1:], _EARLIER) for row in rows])
    return rows[:, 0], grams


def _has_load(record: OwnRecord) -> bool:
    """Return whether a record has the friction by load; those of earlier versions do not."""
    return len(record.groups[0]) > 1 + _EARLIER * (_EARLIER + 1) // 2


def mean_load(record: OwnRecord) -> float | None:
    """Return the mean size of the load in motion, in the unit of the left side; None if not recorded."""
    if of_strokes(record):
        return abs(float(np.mean([row[2] for row in record.groups])))
    if record.equation in (POWER.name, LAG.name) or not _has_load(record):
        return None
    gram = grams_of(record)[1].sum(axis=0)
    return float(gram[_SIGN, _LOADED] / gram[_SIGN, _SIGN]) if gram[_SIGN, _SIGN] > 0.0 else None


def load_direction(record: OwnRecord) -> float:
    """Return the mean sign of the load over the strokes."""
    return float(np.mean(np.sign([row[2] for row in record.groups])))


def _columns(record: OwnRecord) -> tuple[int, tuple[int, ...], tuple[int, ...]]:
    """Return the wear's column, and the fixed and the free ones."""
    no_airspeed = record.setup.endswith("no airspeed")
    held, free = ((), (_ANGLE,)) if no_airspeed else ((_LOAD,), ())
    if record.equation == LAG.name:
        return _SPEED, (_ACCELERATION, *held), (_SIGN, *free)
    return _SIGN, (_SPEED, _ACCELERATION, *held), free


def _shows_linear(record: OwnRecord) -> bool:
    """Return whether a flight has enough motion in both directions to determine the wear."""
    return information(record) >= 2.0 * LEAST_SAMPLES and len(record.groups) >= LEAST_PARTS


def information(record: OwnRecord) -> float:
    """Return the number of samples that determine a flight's wear, as many to either side, or of strokes."""
    if of_strokes(record):
        return float(len(record.groups))
    return sum(row[1 + _SIGN] for row in record.groups)


def _learned_linear(records: Sequence[OwnRecord]) -> Nuisances | None:
    """Return the joint nuisances of flights with the same set-up; None if they do not determine them.

    Each flight has a wear of its own. It counts by the inverse variance of its residuals, for gusts disturb
    the balance. The friction by load is one of them where the flights show it.
    """
    loads = [load for record in records if (load := mean_load(record)) is not None]
    if len(loads) == len(records):
        found = _fitted(records, (_LOADED,))
        if found is not None and found.load_friction > 0.0:
            return replace(found, load=float(np.median(loads)))
    return _fitted(records, ())


def _fitted(records: Sequence[OwnRecord], more: tuple[int, ...]) -> Nuisances | None:
    """Return the joint nuisances with ``more`` columns; None if they, or one of these, do not show."""
    wear, held, free = _columns(records[0])
    held = (*held, *more)
    total = np.zeros((len(KEPT), len(KEPT)))
    for record in records:
        counts, grams = grams_of(record)
        gram = eliminated(grams.sum(axis=0), [wear, *free])
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


def _linear_wear(record: OwnRecord, nuisances: Nuisances | None) -> Wear | None:
    """Return a flight's wear with fixed nuisances, or free ones if None; None if it is not determined."""
    counts, grams = grams_of(record)
    wear, held, free = _columns(record)
    grams = grams.copy()
    if nuisances is None:
        free = (*held, *free)
    else:
        for column, coefficient in nuisances.held.items():
            grams[:, _LEFT, :] -= coefficient * grams[:, column, :]
            grams[:, :, _LEFT] -= coefficient * grams[:, :, column]
    if not _shows_linear(record):
        return None
    total = grams.sum(axis=0)
    whole = eliminated(total, free)
    information = whole[wear, wear]
    value = whole[wear, _LEFT] / information
    # T_c and μ trade: what is compared is the friction at one load.
    at_load = 0.0 if nuisances is None else nuisances.load_friction * nuisances.load
    without = [eliminated(total - gram, free) for gram in grams]
    # Without one part nothing would be left: the jackknife has no value there.
    if min(rest[wear, wear] for rest in without) <= 1e-9 * total[wear, wear]:
        return None
    others = np.array([rest[wear, _LEFT] / rest[wear, wear] for rest in without])
    shares = grams[:, wear, wear]
    # Parts differ in length: so many of equal length are worth the same.
    effective = float(shares.sum() ** 2 / (shares**2).sum())
    jackknife = float(((others - others.mean()) ** 2).sum()) * (len(grams) - 1) / len(grams)
    residual = max(float(whole[_LEFT, _LEFT] - value**2 * information), 0.0)
    independent = residual / max(float(counts.sum()) - len(counts) - 1.0, 1.0) / information
    error, scale = max(jackknife, independent) ** 0.5, radians(1.0) if wear == _SPEED else 1.0
    # Degrees for each radian per second are no time.
    return Wear(scale * (float(value) + at_load), scale * error, max(effective - 1.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class Law:
    """The law of an individual's power.

    Attributes
    ----------
    quadratic
        Coefficients of the columns :data:`~mavhums.health.estimation.flight_sums.QUADRATIC`.
    friction
        Median friction of the flights.
    """

    quadratic: Array
    friction: float

    @property
    def left(self) -> Array:
        """Return the power without the quadratic terms, as weights of the columns."""
        weights = np.zeros(POWER_COLUMNS)
        weights[list(QUADRATIC)], weights[_POWER] = -self.quadratic, 1.0
        return weights

    @property
    def per_friction(self) -> Array:
        """Return the derivative of the power with respect to friction, as weights of the columns."""
        weights = np.zeros(POWER_COLUMNS)
        weights[list(WEAR)] = 1.0, self._ratio(_D), 2.0 * self._ratio(_E)
        return weights

    def per_offset(self, friction: float) -> Array:
        """Return the derivative of the power with respect to c, as weights of the columns."""
        weights = np.zeros(POWER_COLUMNS)
        slope = 2.0 * self._ratio(_E) / self.quadratic[_C]
        weights[list(LINEAR)] = slope * friction, 1.0, self._ratio(_D), 2.0 * self._ratio(_E)
        return weights

    def _ratio(self, term: int) -> float:
        return float(self.quadratic[term] / self.quadratic[_C])


def _shows_power(record: OwnRecord) -> bool:
    """Return whether a flight has enough motion to determine its friction."""
    return len(record.groups) >= LEAST_PARTS and sum(row[0] for row in record.groups) >= 4.0 * LEAST_SAMPLES


def _learned_power(records: Sequence[OwnRecord]) -> Law | None:
    """Return the law that flights with the same set-up share; None if they do not determine it.

    Each flight has a friction of its own, and counts by the inverse variance of its residuals.
    """
    flights = [_power_grams(record) for record in records if _shows_power(record)]
    if not flights:
        return None
    total = np.zeros((POWER_COLUMNS, POWER_COLUMNS))
    for counts, grams in flights:
        own = sum(eliminated(gram, LINEAR) for gram in grams)
        own = eliminated(np.asarray(own), WEAR)
        left = eliminated(own, QUADRATIC)[_POWER, _POWER]
        total += own * counts.sum() / left if left > 0.0 else 0.0
    law = _law(total, 0.0)
    for _ in range(_ROUNDS):
        if law is None:
            return None
        frictions = [_friction(counts, grams, law) for counts, grams in flights]
        total = np.zeros((POWER_COLUMNS, POWER_COLUMNS))
        for (_, grams), fit in zip(flights, frictions, strict=True):
            if fit is not None:
                rest = _without_offset(grams, law, fit.value)
                whole = np.einsum("k,kij->ij", fit.weights, rest)
                total += _along(whole[np.newaxis], law.per_friction)[0]
        known = [fit.value for fit in frictions if fit is not None]
        law = _law(total, float(np.median(known))) if known else None
    return law


def _power_wear(record: OwnRecord, law: Law | None) -> Wear | None:
    """Return a flight's friction with a fixed law, or its own if None; None if it is not determined.

    Its error is that of the delete-one jackknife over the parts of the flight.
    """
    if not _shows_power(record) or (law := _learned_power([record]) if law is None else law) is None:
        return None
    counts, grams = _power_grams(record)
    fit = _friction(counts, grams, law)
    if fit is None:
        return None
    information, pull = fit.weights * fit.information, fit.weights * fit.pull
    rest = information.sum() - information
    if rest.min() <= 1e-9 * information.sum():
        return None
    others = (pull.sum() - pull) / rest
    jackknife = float(((others - others.mean()) ** 2).sum()) * (len(counts) - 1) / len(counts)
    freedom = max(float(counts.sum()) - 2.0 * len(counts) - 1.0, 1.0)
    independent = float(counts.sum()) / freedom / float(information.sum())
    effective = float(information.sum() ** 2 / (information**2).sum())
    return Wear(fit.value, max(jackknife, independent) ** 0.5, max(effective - 1.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class _PowerFit:
    """A flight's friction, and by part: its weight, its information, and friction times information."""

    value: float
    weights: Array
    information: Array
    pull: Array


def _friction(counts: Array, grams: Array, law: Law) -> _PowerFit | None:
    """Return the friction; parts count by the inverse variance of their residuals, for gusts disturb them."""
    column, left, value, weights = law.per_friction, law.left, law.friction, np.ones(len(counts))
    for _ in range(_ROUNDS):
        rest = _without_offset(grams, law, value)
        information = np.einsum("i,kij,j->k", column, rest, column)
        pull = np.einsum("i,kij,j->k", column, rest, left)
        squares = np.einsum("i,kij,j->k", left, rest, left)
        if not float(weights @ information) > 0.0:
            return None
        value = float(weights @ pull) / float(weights @ information)
        residual = squares - 2.0 * value * pull + value**2 * information
        # Parts count by the inverse variance of their residuals; none counts without end.
        weights = counts / np.maximum(residual, 1e-9 * squares.max() + 1e-300)
    value = float(weights @ pull) / float(weights @ information)
    return _PowerFit(value, weights, information, pull) if np.isfinite(value) else None


def _law(total: Array, friction: float) -> Law | None:
    """Return the least-squares law of a sum of Gram matrices; None if the load does not show in it."""
    terms = list(QUADRATIC)
    normal = total[np.ix_(terms, terms)]
    scale = np.sqrt(np.diag(normal))
    if not (np.isfinite(scale).all() and (scale > 0.0).all()):
        return None
    alike = normal / np.outer(scale, scale)
    quadratic: Array = np.linalg.lstsq(alike, total[terms, _POWER] / scale, rcond=1e-9)[0] / scale
    load_alone = 1.0 / float(np.linalg.pinv(alike, rcond=1e-9)[_C, _C]) ** 0.5 * float(scale[_C])
    # The law's ratios divide by this coefficient.
    sure = abs(float(quadratic[_C])) * load_alone > LOAD_SHOWS_ERRORS
    return Law(quadratic, friction) if sure else None


def _power_grams(record: OwnRecord) -> tuple[Array, Array]:
    rows = np.array(record.groups, dtype=np.float64)
    return rows[:, 0], np.array([unpacked(row[1:], POWER_COLUMNS) for row in rows])


def _without_offset(grams: Array, law: Law, friction: float) -> Array:
    return _along(grams, law.per_offset(friction))


def _along(grams: Array, direction: Array) -> Array:
    """Return Gram matrices, shape (k, 14, 14), after a regression on one combination of columns."""
    product = grams @ direction
    size = product @ direction
    # Nothing of this combination is in the sums: rounding errors must not be divided by it.
    small = size <= 1e-9 * np.abs(direction**2 @ np.diagonal(grams, axis1=1, axis2=2).T)
    share = np.where(small, 0.0, 1.0 / np.where(small, 1.0, size))
    rest: Array = grams - share[:, None, None] * product[:, :, None] * product[:, None, :]
    return rest


Individual = Nuisances | Law
"""Coefficients of the individual."""


def of_strokes(record: OwnRecord) -> bool:
    """Return whether a record holds a quantity of each stroke, and no sums."""
    return record.equation in {equation.name for equation in STROKE_EQUATIONS}


def _stroke_wear(record: OwnRecord) -> Wear | None:
    """Return the mean over the strokes.

    Strokes repeat one motion, so that what they scatter by is in the scatter between flights already; a fault
    that makes the strokes uneven must not hide itself in an error of its own.
    """
    if not shows(record):
        return None
    mean = float(np.mean([row[1] for row in record.groups]))
    return Wear(mean, LEAST_ERROR_SHARE * abs(mean), len(record.groups) - 1.0)


def shows(record: OwnRecord) -> bool:
    """Return whether a flight has enough motion in both directions to determine the wear."""
    if of_strokes(record):
        return len(record.groups) >= LEAST_PARTS
    return _shows_power(record) if record.equation == POWER.name else _shows_linear(record)


def learned(records: Sequence[OwnRecord]) -> Individual | None:
    """Return the individual's coefficients from flights with the same set-up; None if undetermined."""
    if of_strokes(records[0]):
        return Nuisances({}, ())
    return _learned_power(records) if records[0].equation == POWER.name else _learned_linear(records)


def wear(record: OwnRecord, individual: Individual | None) -> Wear | None:
    """Return a flight's wear with the individual's coefficients fixed, or free if None."""
    if of_strokes(record):
        return _stroke_wear(record)
    if record.equation == POWER.name:
        return _power_wear(record, individual if isinstance(individual, Law) else None)
    return _linear_wear(record, individual if isinstance(individual, Nuisances) else None)
