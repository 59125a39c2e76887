"""All detectors of an actuator side by side: what their windows show, worked out for all at once.

Each quantity has one window a second, too few to be worth arrays of their own.
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
    """What k windows show of one quantity; arrays of shape (k,).

    Attributes
    ----------
    own, steadied
        The estimates, with the errors of each window by itself, and steadied by those before.
    half
        Half the width of each window's own 95 % interval.
    severity, sure
        What each shows by the interval that is left with √α, -1 for nothing, and whether it would with α.
    """

    own: Estimates
    steadied: Estimates
    half: Array
    severity: NDArray[np.int64]
    sure: NDArray[np.bool_]


class Panel:
    """Holds the windows of some quantities against their limits.

    Parameters
    ----------
    detectors
        Whose quantities they are.
    false_alarms
        Alarms per 100 hours.
    """

    def __init__(self, detectors: Sequence[Detector], false_alarms: float) -> None:
        self._two_sided = np.array([[detector.two_sided] for detector in detectors])
        limits = np.array([bounds(detector.levels) for detector in detectors])
        self._normal, self._emergency = limits[:, :1], limits[:, 1:]
        self._tails = tail_of(false_alarms) ** np.array([0.5, 1.0])[:, None, None]
        self._errors = PooledErrors()

    def feed(self, estimates: Sequence[Estimates], windows: NDArray[np.bool_]) -> list[Look]:
        """Return what each detector's estimates show in those of their windows that count, shape (k,)."""
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
