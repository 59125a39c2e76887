"""Identifies a servo's motor from its own flights: resistance, back-EMF constant and drop, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from mavhums.health.own.grams import unpacked
from mavhums.health.own.voltage import NAME
from mavhums.report.assessment import Interval, OwnRecord

__all__ = ["Identified", "identified"]

_SIZE = 4
_LEAST_GROUPS = 4
_MOST_ALIKE = 0.999  # correlation of the columns beyond which they cannot be separated

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Identified:
    """The constants of a servo's motor, estimated from flights.

    Attributes
    ----------
    resistance
        Resistance of the winding and its wiring, Ω.
    back_emf
        V·s/rad of the rotor. It is the torque constant in N·m/A where V4·V5 is the electrical power, as of a
        direct-current motor; a drive that reports amplitudes, r.m.s. or phase values has another factor.
    drop
        Voltage drop of brushes or dead time, V.
    flights
        Flights that were used.
    """

    resistance: Interval
    back_emf: Interval
    drop: Interval
    flights: int


def identified(records: Sequence[OwnRecord]) -> Identified | None:
    """Return the joint estimate of flights; None if their currents and speeds vary too little.

    The intervals are those of the delete-one jackknife over parts of the flights, and include the bias from
    current noise: the true value lies between the least squares of the voltage and of the current.

    Parameters
    ----------
    records
        Records of the voltage equation of one actuator; others are ignored.
    """
    own = [record for record in records if record.equation == NAME]
    rows = [row for record in own for row in record.groups]
    if len(rows) < _LEAST_GROUPS:
        return None
    grams = np.array([unpacked(row[1:], _SIZE) for row in rows])
    total = grams.sum(axis=0)
    value = _solved(total)
    if value is None:
        return None
    others = [rest for gram in grams if (rest := _solved(total - gram)) is not None]
    count = len(others)
    spread = np.array(others) - np.mean(others, axis=0)
    error = np.sqrt((spread**2).sum(axis=0) * (count - 1) / count)
    noise = _attenuation(total, value)
    value = value + noise / 2.0
    half = stdtrit(count - 1, 0.975) * np.hypot(error, noise / np.sqrt(12.0))
    resistance, back_emf, drop = (
        Interval(estimate=float(f"{v:.6g}"), low=float(f"{v - h:.6g}"), high=float(f"{v + h:.6g}"))
        for v, h in zip(value, half, strict=True)
    )
    if resistance.low <= 0.0 or back_emf.low <= 0.0:
        return None
    return Identified(resistance, back_emf, drop, len(own))


def _attenuation(gram: Array, value: Array) -> Array:
    """Return the largest bias of the coefficients, reached if the whole residual is current noise."""
    left_over = float(gram[-1, -1] - value @ gram[:-1, -1])
    most: Array = left_over / value[0] * np.linalg.inv(gram[:-1, :-1])[:, 0]
    return most


def _solved(gram: Array) -> Array | None:
    normal, right = gram[:-1, :-1], gram[:-1, -1]
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0.0).all():
        return None
    alike = normal / np.outer(scale, scale)
    if np.abs(np.triu(alike, 1)).max() > _MOST_ALIKE:
        return None
    solved: Array = np.linalg.solve(alike, right / scale) / scale
    return solved
