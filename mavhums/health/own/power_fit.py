"""Learns an individual's law of power from its own flights, and estimates its friction with this fixed.

With T = T_c·sgn(w) + b·w + J·dw/dt + h·q·d + c in P = ρ·T² + w·T + P₀, the coefficients of the products are

    w·q·d: h·(1 + 2ρb) = C        dw/dt·q·d: 2ρJh = D        (q·d)²: ρh² = E

and those of sgn(w)·(w, dw/dt, q·d) are T_c·(1 + 2ρb)·(1, D/C, 2E/C). So T_c·(1 + 2ρb), the friction's share
of the power per speed, is one linear coefficient. c, free in each part of a flight, multiplies
w + (D/C)·dw/dt + (2E/C)·q·d + (2E/C²)·T_c·(1 + 2ρb)·sgn(w).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavhums.health.own.fit import Wear
from mavhums.health.own.grams import eliminated, unpacked
from mavhums.health.own.power import COLUMNS, LINEAR, QUADRATIC, WEAR
from mavhums.report.assessment import OwnRecord

__all__ = ["Law", "learned", "shows", "wear"]

_C, _D, _E = QUADRATIC.index(9), QUADRATIC.index(11), QUADRATIC.index(12)
_LEFT = COLUMNS - 1
_LEAST_GROUPS = 4
_LEAST_SAMPLES = 80.0
_ROUNDS = 4
_SURE = 5.0  # standard errors by which the load must show in the power

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Law:
    """The law of an individual's power.

    Attributes
    ----------
    quadratic
        Coefficients of the columns :data:`~mavhums.health.own.power.QUADRATIC`.
    friction
        Median friction of the flights.
    """

    quadratic: Array
    friction: float

    @property
    def left(self) -> Array:
        """Return the power without the quadratic terms, as weights of the columns."""
        weights = np.zeros(COLUMNS)
        weights[list(QUADRATIC)], weights[_LEFT] = -self.quadratic, 1.0
        return weights

    @property
    def per_friction(self) -> Array:
        """Return the derivative of the power with respect to friction, as weights of the columns."""
        weights = np.zeros(COLUMNS)
        weights[list(WEAR)] = 1.0, self._ratio(_D), 2.0 * self._ratio(_E)
        return weights

    def per_offset(self, friction: float) -> Array:
        """Return the derivative of the power with respect to c, as weights of the columns."""
        weights = np.zeros(COLUMNS)
        slope = 2.0 * self._ratio(_E) / self.quadratic[_C]
        weights[list(LINEAR)] = slope * friction, 1.0, self._ratio(_D), 2.0 * self._ratio(_E)
        return weights

    def _ratio(self, term: int) -> float:
        return float(self.quadratic[term] / self.quadratic[_C])


def shows(record: OwnRecord) -> bool:
    """Return whether a flight has enough motion to determine its friction."""
    return len(record.groups) >= _LEAST_GROUPS and sum(row[0] for row in record.groups) >= _LEAST_SAMPLES


def learned(records: Sequence[OwnRecord]) -> Law | None:
    """Return the law that flights with the same set-up share; None if they do not determine it.

    Each flight has a friction of its own, and counts by the inverse variance of its residuals.
    """
    flights = [_grams(record) for record in records if shows(record)]
    if not flights:
        return None
    total = np.zeros((COLUMNS, COLUMNS))
    for counts, grams in flights:
        own = sum(eliminated(gram, LINEAR) for gram in grams)
        own = eliminated(np.asarray(own), WEAR)
        left = eliminated(own, QUADRATIC)[_LEFT, _LEFT]
        total += own * counts.sum() / left if left > 0.0 else 0.0
    law = _law(total, 0.0)
    for _ in range(_ROUNDS):
        if law is None:
            return None
        frictions = [_friction(counts, grams, law) for counts, grams in flights]
        total = np.zeros((COLUMNS, COLUMNS))
        for (_, grams), fit in zip(flights, frictions, strict=True):
            if fit is not None:
                rest = _without_offset(grams, law, fit.value)
                whole = np.einsum("k,kij->ij", fit.weights, rest)
                total += _along(whole[np.newaxis], law.per_friction)[0]
        known = [fit.value for fit in frictions if fit is not None]
        law = _law(total, float(np.median(known))) if known else None
    return law


def wear(record: OwnRecord, law: Law | None) -> Wear | None:
    """Return a flight's friction with a fixed law, or its own if None; None if it is not determined.

    Its error is that of the delete-one jackknife over the parts of the flight.
    """
    if not shows(record) or (law := learned([record]) if law is None else law) is None:
        return None
    counts, grams = _grams(record)
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
class _Fit:
    """A flight's friction, and by part: its weight, its information, and friction times information."""

    value: float
    weights: Array
    information: Array
    pull: Array


def _friction(counts: Array, grams: Array, law: Law) -> _Fit | None:
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
        weights = counts / np.maximum(residual, 1e-9 * squares.max() + 1e-300)
    value = float(weights @ pull) / float(weights @ information)
    return _Fit(value, weights, information, pull) if np.isfinite(value) else None


def _law(total: Array, friction: float) -> Law | None:
    """Return the least-squares law of a sum of Gram matrices; None if the load does not show in it."""
    terms = list(QUADRATIC)
    normal = total[np.ix_(terms, terms)]
    scale = np.sqrt(np.diag(normal))
    if not (np.isfinite(scale).all() and (scale > 0.0).all()):
        return None
    alike = normal / np.outer(scale, scale)
    quadratic: Array = np.linalg.lstsq(alike, total[terms, _LEFT] / scale, rcond=1e-9)[0] / scale
    load_alone = 1.0 / float(np.linalg.pinv(alike, rcond=1e-9)[_C, _C]) ** 0.5 * float(scale[_C])
    sure = abs(float(quadratic[_C])) * load_alone > _SURE
    return Law(quadratic, friction) if sure else None


def _grams(record: OwnRecord) -> tuple[Array, Array]:
    rows = np.array(record.groups, dtype=np.float64)
    return rows[:, 0], np.array([unpacked(row[1:], COLUMNS) for row in rows])


def _without_offset(grams: Array, law: Law, friction: float) -> Array:
    return _along(grams, law.per_offset(friction))


def _along(grams: Array, direction: Array) -> Array:
    """Return Gram matrices, shape (k, 14, 14), after a regression on one combination of columns."""
    product = grams @ direction
    size = product @ direction
    small = size <= 1e-9 * np.abs(direction**2 @ np.diagonal(grams, axis1=1, axis2=2).T)
    share = np.where(small, 0.0, 1.0 / np.where(small, 1.0, size))
    rest: Array = grams - share[:, None, None] * product[:, :, None] * product[:, None, :]
    return rest
