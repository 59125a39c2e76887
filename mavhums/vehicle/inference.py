"""Infers which outputs move the aircraft from its response, if no parameter and no profile defines them.

Roll: the output to which the roll rate responds, and the outputs that move with it. Pitch: the one other
output to which the pitch acceleration responds, if no second output is nearly as good. A rudder cannot be
inferred in this way: it mostly moves with the ailerons.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.vehicle.flight import Rows
from mavhums.vehicle.signals import OUTPUTS
from mavhums.vehicle.surfaces import Moved, Surfaces

__all__ = ["inferred"]

_MOVES_US: Final = 10.0
_HALF_US: Final = 400.0
_ALIKE: Final = 0.97
_ROLL: Final = 0.6
_PITCH: Final = 0.35
_APART: Final = 2.0

Array = NDArray[np.float64]

Explains = Callable[[str, Array], float]
"""How well an axis, by name, is explained by a demand of shape (n,): a share from 0 to 1."""


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
    moving = [k for k in range(OUTPUTS) if rows.flying.any() and _moves(pulses[rows.flying, k])]
    flying = rows.flying & np.isfinite(pulses[:, moving]).all(axis=1)
    if not moving or not flying.any():
        return None
    centred = {k: pulses[:, k] - float(np.median(pulses[flying, k])) for k in moving}
    rolls = {k: explains("roll", centred[k] / _HALF_US) for k in moving}
    best = max(rolls, key=rolls.__getitem__, default=None)
    if best is None or rolls[best] < _ROLL:
        return None
    alike = {k: float(np.corrcoef(centred[k][flying], centred[best][flying])[0, 1]) for k in moving}
    found = [
        _moved(k, "aileron", pulses, flying, _slope(centred[k][flying], centred[best][flying]))
        for k in moving
        if abs(alike[k]) >= _ALIKE
    ]
    rest = {k: explains("pitch", centred[k] / _HALF_US) for k in moving if abs(alike[k]) < _ALIKE}
    order = sorted(rest, key=rest.__getitem__, reverse=True)
    if order and rest[order[0]] >= _PITCH and (len(order) < 2 or rest[order[0]] > _APART * rest[order[1]]):
        found.append(_moved(order[0], "elevator", pulses, flying, 1.0))
    return Surfaces(tuple(found), "inferred")


def _moves(pulses: Array) -> bool:
    return bool(np.isfinite(pulses).mean() > 0.9) and float(np.nanstd(pulses)) > _MOVES_US


def _slope(pulses: Array, best: Array) -> float:
    """Return how far an output moves for each microsecond of the best one, signed.

    Outputs that move together then give the same demand, so that one of them that stops changes nothing.
    """
    return float(pulses @ best) / float(best @ best)


def _moved(k: int, surface: str, pulses: Array, flying: NDArray[np.bool_], slope: float) -> Moved:
    return Moved(k + 1, surface, float(np.median(pulses[flying, k])), slope * _HALF_US)
