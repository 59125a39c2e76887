"""Evaluation of the windows of all detectors of an actuator, vectorised over detectors.

Each quantity has only one window per second, too few for efficient arrays of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.conditions import SEVERITY
from mavhums.health.decision import bounds, half_width, shown_by, tail_of
from mavhums.health.detector import Detector, Estimates
from mavhums.health.pooled import PooledErrors

__all__ = ["Look", "Panel"]

Array = NDArray[np.float64]


class Look(NamedTuple):
    """Evaluation of one quantity in k windows; arrays of shape (k,).

    Attributes
    ----------
    own, steadied
        The estimates, with each window's own error, and with the error pooled over earlier windows.
    half
        Half the width of each window's own 95 % interval.
    severity, sure
        Severity by the interval with tail probability √α, -1 if inconclusive; and whether the interval
        with tail probability α agrees.
    """

    own: Estimates
    steadied: Estimates
    half: Array
    severity: NDArray[np.int64]
    sure: NDArray[np.bool_]


class Panel:
    """Compares the windows of several quantities with their limits.

    Parameters
    ----------
    detectors
        Detectors of the quantities.
    false_alarms
        Alarms per 100 hours.
    """

    def __init__(self, detectors: Sequence[Detector], false_alarms: float) -> None:
        self._two_sided = np.array([[detector.two_sided] for detector in detectors])
        limits = np.array([bounds(detector.levels) for detector in detectors])
        self._normal, self._emergency = limits[:, :1], limits[:, 1:]
        self._tails = tail_of(false_alarms) ** np.array([0.5, 1.0])[:, None]
        self._errors = PooledErrors()

    def feed(self, estimates: Sequence[Estimates], windows: NDArray[np.bool_]) -> list[Look]:
        """Evaluate each detector's estimates in the selected windows, shape (k,)."""
        own = Estimates(*(np.array(arrays)[:, windows] for arrays in zip(*estimates, strict=True)))
        steadied = self._errors.feed(own)
        size = np.where(self._two_sided, np.abs(own.value), own.value)
        half = half_width(steadied, tail=self._tails)
        severity, surely = shown_by(size - half, size + half, self._normal, self._emergency)
        sure = (severity == SEVERITY["normal"]) | (surely > 0)
        printed = half_width(own, tail=0.025)
        return [
            Look(own.at(k), steadied.at(k), printed[k], severity[k], sure[k]) for k in range(len(estimates))
        ]
