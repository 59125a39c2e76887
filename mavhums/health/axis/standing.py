"""Constants of the response in the reference that one aircraft keeps from flight to flight.

Wind and manoeuvres change an estimate of the gain more than they change some ratios of coefficients: of one
regression all coefficients are attenuated alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.health.axis.chain import Form

__all__ = ["Constant", "constants"]

_BLOCKS: Final = 9

Array = NDArray[np.float64]


class Constant(NamedTuple):
    """A constant and its standard error."""

    value: float
    error: float


def constants(form: Form, speed: float, design: Array, answer: Array) -> Mapping[str, Constant]:
    """Return the constants of a form, by the fault that changes them, with delete-one-block jackknife errors.

    Parameters
    ----------
    form
        The regression.
    speed
        Reference speed, m/s.
    design, answer
        Columns of the regression in the reference, the drive first, and the response; shapes (n, p), (n,).

    References
    ----------
    B. Efron, "The Jackknife, the Bootstrap and Other Resampling Plans", SIAM 1982, chapter 3.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return _constants(form, speed, design, answer)


def _constants(form: Form, speed: float, design: Array, answer: Array) -> Mapping[str, Constant]:
    whole = form.kept(_fitted(design, answer), speed)
    if not whole:
        return {}
    without = []
    for block in np.array_split(np.arange(len(answer)), _BLOCKS):
        beta = _fitted(np.delete(design, block, axis=0), np.delete(answer, block))
        without.append(form.kept(beta, speed))
    found = {}
    for fault, value in whole.items():
        parts = np.array([part[fault] for part in without])
        error = float(np.sqrt((_BLOCKS - 1) / _BLOCKS * ((parts - parts.mean()) ** 2).sum()))
        if np.isfinite(value) and np.isfinite(error):
            found[fault] = Constant(float(value), error)
    return found


def _fitted(design: Array, answer: Array) -> Array:
    return np.asarray(np.linalg.lstsq(design, answer, rcond=None)[0], dtype=np.float64)
