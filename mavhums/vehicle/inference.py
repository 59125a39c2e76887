"""Infers which outputs move the aircraft from its response, if no parameter and no profile defines them.

Roll: the output to which the roll rate responds, and the outputs that move as one with it. Pitch: the one
other output to which the pitch acceleration responds, if no second output is nearly as good. A rudder cannot
be inferred in this way: it mostly moves with the ailerons.

An inference must be the only one that the flight allows. Elevons move with pitch as well, so that another
output explains what one of them leaves; a rudder that an autopilot mixes with the roll demand of elevons
is the difference of two other outputs. Neither is taken for an aileron.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array
from mavhums.vehicle.facts import OUTPUTS
from mavhums.vehicle.rows import Rows
from mavhums.vehicle.surfaces import ALIKE_US, Moved, Surfaces

__all__ = ["HALF_US", "LEAST_SHARE", "inferred", "moves"]

_MOVES_US: Final = 10.0  # standard deviation: less is trim and noise, from which a slope follows by chance
_MOVES_SHARE: Final = 0.9  # of the rows: an output that is off for longer shows no flight
HALF_US: Final = 400.0
"""Half of the usual travel, 1100 to 1900 µs: the scale of a demand, which no share depends on."""
_AS_ONE: Final = 0.99  # share of the rows in which outputs with one demand differ by less than ALIKE_US
_ROLLS_RAD_S: Final = 0.05  # deviation of the roll rate: without turns any slow output explains what is left
LEAST_SHARE: Final = {"roll": 0.6, "pitch": 0.35}
"""Share of the motion that an output must explain to be the one that moves the axis. In roll, lower takes
other outputs for ailerons; in pitch, the share of the acceleration, gusts and speed count as well."""
_APART: Final = 2.0  # the second best output leaves so many times as much, or explains so many times less
_MIXED: Final = (
    0.4  # of what ailerons leave, others explained up to 0.35 in development, of elevons from 0.48
)
_DOUBLE: Final = 0.95  # share of a demand that other outputs carry as well

Explains = Callable[[str, Array, Array], tuple[float, float]]
"""How much of the motion about an axis a demand (n,) explains, and how much of the rest others (n, k) do."""


def inferred(rows: Rows, pulses: Array, explains: Explains) -> Surfaces | None:
    """Return the surfaces inferred from the flight; None if not even the ailerons are clear.

    Parameters
    ----------
    rows
        Rows of forward flight, with turns.
    pulses
        Pulses of the outputs over the same rows, µs, shape (n, OUTPUTS).
    explains
        Returns how well a demand explains the motion about an axis.
    """
    moving = [k for k in range(OUTPUTS) if moves(pulses[rows.flying, k])]
    flying = rows.flying & np.isfinite(pulses[:, moving]).all(axis=1)
    if not moving or not flying.any() or float(np.nanstd(rows.roll_rate[flying])) < _ROLLS_RAD_S:
        return None
    demands = {k: (pulses[:, k] - float(np.median(pulses[flying, k]))) / HALF_US for k in moving}
    none = np.empty((len(rows), 0))
    rolls = {k: explains("roll", demands[k], none)[0] for k in moving}
    best = max(rolls, key=rolls.__getitem__)
    slopes = {k: _slope(demands[k][flying], demands[best][flying]) for k in moving}
    alike = [k for k in moving if _are_one(demands[k][flying], slopes[k] * demands[best][flying])]
    others = [k for k in moving if k not in alike]
    beside = np.column_stack([none, *(demands[k] for k in others)])
    second = max((rolls[k] for k in others), default=0.0)
    if rolls[best] < LEAST_SHARE["roll"] or 1.0 - second < _APART * (1.0 - rolls[best]):
        return None
    if _carried(demands[best][flying], beside[flying]) or explains("roll", demands[best], beside)[1] > _MIXED:
        return None
    found = [_moved(k, "aileron", pulses, flying, slopes[k]) for k in alike]
    rest = {k: explains("pitch", demands[k], none)[0] for k in others}
    order = sorted(rest, key=rest.__getitem__, reverse=True)
    clear = len(order) < 2 or rest[order[0]] > _APART * rest[order[1]]
    if order and clear and rest[order[0]] >= LEAST_SHARE["pitch"]:
        found.append(_moved(order[0], "elevator", pulses, flying, 1.0))
    return Surfaces(tuple(found), "inferred")


def moves(pulses: Array) -> bool:
    """Return whether an output moves, from its pulses over the rows of flight, µs, shape (n,)."""
    if not pulses.size or np.isfinite(pulses).mean() <= _MOVES_SHARE:
        return False
    return float(np.nanstd(pulses)) > _MOVES_US


def _slope(pulses: Array, best: Array) -> float:
    """Return how far an output moves for each microsecond of the best one, signed.

    Outputs that move together then give the same demand, so that one of them that stops changes nothing.
    """
    return float(pulses @ best) / float(best @ best)


def _are_one(demand: Array, expected: Array) -> bool:
    """Return whether two outputs carry one demand."""
    return bool((np.abs(demand - expected) * HALF_US <= ALIKE_US).mean() >= _AS_ONE)


def _carried(demand: Array, others: Array) -> bool:
    """Return whether other outputs together carry nearly the same demand."""
    if not others.size:
        return False
    left = demand - others @ np.linalg.lstsq(others, demand, rcond=None)[0]
    return float(left @ left) <= (1.0 - _DOUBLE) * float(demand @ demand)


def _moved(k: int, surface: str, pulses: Array, flying: NDArray[np.bool_], slope: float) -> Moved:
    return Moved(k + 1, surface, float(np.median(pulses[flying, k])), slope * HALF_US)
