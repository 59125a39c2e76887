"""Learns an individual's nuisances from its own flights, and estimates its wear with these fixed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mavhums.health.own.grams import eliminated, unpacked
from mavhums.health.own.record import KEPT
from mavhums.report.assessment import OwnRecord

__all__ = ["Nuisances", "Wear", "grams_of", "information", "learned", "shows", "wear"]

_SIGN, _LEFT = KEPT.index("sign"), KEPT.index("left")
_SPEED, _ACCELERATION = KEPT.index("speed"), KEPT.index("acceleration")
_LOAD, _ANGLE = KEPT.index("load"), KEPT.index("angle")
_LEAST_GROUPS = 4
_LEAST_INFORMATION = 40.0  # samples, as many to either side

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Nuisances:
    """Fixed coefficients of the individual, and the columns that are free in each flight.

    Attributes
    ----------
    held
        Coefficients by column of :data:`~mavhums.health.own.record.KEPT`.
    free
        Free columns: the load's, if the airspeed is not known.
    """

    held: dict[int, float]
    free: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Wear:
    """A flight's wear coefficient, its standard error, and the degrees of freedom of the error."""

    value: float
    error: float
    freedom: float


def grams_of(record: OwnRecord) -> tuple[Array, Array]:
    """Return a record's numbers of samples, shape (g,), and Gram matrices, shape (g, 6, 6)."""
    rows = np.array(record.groups, dtype=np.float64)
    return rows[:, 0], np.array([unpacked(row[1:], len(KEPT)) for row in rows])


def _columns(record: OwnRecord) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the fixed and the free columns."""
    if record.setup.endswith("no airspeed"):
        return (_SPEED, _ACCELERATION), (_ANGLE,)
    return (_SPEED, _ACCELERATION, _LOAD), ()


def shows(record: OwnRecord) -> bool:
    """Return whether a flight has enough motion in both directions to determine the wear."""
    return information(record) >= _LEAST_INFORMATION and len(record.groups) >= _LEAST_GROUPS


def information(record: OwnRecord) -> float:
    """Return the number of samples in a flight that determine its wear, as many to either side."""
    return sum(row[1 + _SIGN] for row in record.groups)


def learned(records: Sequence[OwnRecord]) -> Nuisances | None:
    """Return the joint nuisances of flights with the same set-up; None if they do not determine them.

    Each flight has a wear of its own. It counts by the inverse variance of its residuals, for gusts disturb
    the balance.
    """
    held, free = _columns(records[0])
    total = np.zeros((len(KEPT), len(KEPT)))
    for record in records:
        counts, grams = grams_of(record)
        gram = eliminated(grams.sum(axis=0), [_SIGN, *free])
        left = eliminated(gram, held)[_LEFT, _LEFT]
        freedom = counts.sum() - len(counts) - len(held) - 1
        if freedom > 0 and left > 0.0:
            total += gram * freedom / left
    normal = total[np.ix_(held, held)]
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0.0).all():
        return None
    scaled = normal / np.outer(scale, scale)
    coefficients = np.linalg.lstsq(scaled, total[list(held), _LEFT] / scale)[0] / scale
    return Nuisances(dict(zip(held, coefficients.tolist(), strict=True)), free)


def wear(record: OwnRecord, nuisances: Nuisances | None) -> Wear | None:
    """Return a flight's wear with fixed nuisances, or free ones if None; None if it is not determined."""
    counts, grams = grams_of(record)
    held, free = _columns(record)
    grams = grams.copy()
    if nuisances is None:
        free = (*held, *free)
    else:
        for column, coefficient in nuisances.held.items():
            grams[:, _LEFT, :] -= coefficient * grams[:, column, :]
            grams[:, :, _LEFT] -= coefficient * grams[:, :, column]
    if not shows(record):
        return None
    total = grams.sum(axis=0)
    whole = eliminated(total, free)
    information = whole[_SIGN, _SIGN]
    value = whole[_SIGN, _LEFT] / information
    without = [eliminated(total - gram, free) for gram in grams]
    if min(rest[_SIGN, _SIGN] for rest in without) <= 1e-9 * total[_SIGN, _SIGN]:
        return None
    others = np.array([rest[_SIGN, _LEFT] / rest[_SIGN, _SIGN] for rest in without])
    shares = grams[:, _SIGN, _SIGN]
    effective = float(shares.sum() ** 2 / (shares**2).sum())
    jackknife = float(((others - others.mean()) ** 2).sum()) * (len(grams) - 1) / len(grams)
    residual = max(float(whole[_LEFT, _LEFT] - value**2 * information), 0.0)
    independent = residual / max(float(counts.sum()) - len(counts) - 1.0, 1.0) / information
    return Wear(float(value), max(jackknife, independent) ** 0.5, max(effective - 1.0, 1.0))
