"""A surface that is commanded and does not move: jammed, disconnected or without power.

It needs the command and the output shaft's angle, and none of the actuator's constants. An angle integrated
from a speed whose sign is derived from the command is no evidence. An angle calculated from the rotor's moves
with the rotor, which moves through the gear's play and winds up the gear even if the shaft is jammed.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.core.quantities import column
from mavhums.health.detector import Estimates, Levels, Seen
from mavhums.health.least_squares import Fit
from mavhums.health.slots import SENSED, SHAFT
from mavhums.health.windows import Windows

__all__ = ["Detector"]

_V1 = column("V1")
_STANDS = 0.9
_LEAST_COMMAND_DEG = 4.0
_LASTING_S = (3.0, 10.0)
_FOLLOWING_S = 1.0
_WOUND_UP_DEG = 1.5  # of a gear of 400 N·m/rad and 0.1° of play, by 5 N·m to either side

Array = NDArray[np.float64]


class Detector:
    """Fraction of the commanded travel that the shaft does not follow within three seconds.

    If three seconds contain too little commanded travel, ten seconds are used. The last second of the command
    does not count, because the shaft may not have followed yet.
    """

    fault: ClassVar[str] = "jam"
    quantity: ClassVar[str] = "commanded travel not flown"
    unit: ClassVar[str] = "1"
    inspect: ClassVar[str] = "gearbox and linkage for what blocks them, and the actuator's supply"
    equations: ClassVar[tuple[str, ...]] = ()
    two_sided: ClassVar[bool] = False

    def __init__(self, actuator: Actuator, slot_s: float = 1.0) -> None:
        self.levels = Levels(_STANDS, _STANDS)
        self._following = ceil(_FOLLOWING_S / slot_s)
        self._lasting = [ceil(lasting_s / slot_s) for lasting_s in _LASTING_S]
        self._windows = Windows(5, max(self._lasting), empty=np.nan)

    @staticmethod
    def suits(actuator: Actuator) -> bool:
        """Return True: no constants of the actuator are needed."""
        return True

    def feed(self, seen: Seen) -> Estimates:
        """Return the fraction; undecidable if less than 4° of travel was commanded."""
        own, start = seen.slots.values[seen.slots.judged], seen.slots.start
        extremes = np.stack(
            [
                np.maximum.reduceat(own[:, _V1], start),
                -np.minimum.reduceat(own[:, _V1], start),
                np.maximum.reduceat(own[:, SHAFT], start),
                -np.minimum.reduceat(own[:, SHAFT], start),
                _WOUND_UP_DEG * (1.0 - np.minimum.reduceat(own[:, SENSED], start)),
            ],
            axis=1,
        )
        windows = self._windows.feed(seen.slots.index, extremes)
        share = np.full(len(windows), np.nan)
        for slots in self._lasting:
            left_out = self._left_out(windows[:, -slots:])
            share = np.where(np.isnan(share), left_out, share)
        return Estimates.of(share, np.zeros_like(share), np.ones_like(share), np.isfinite(share))

    def _left_out(self, windows: Array) -> Array:
        """Return the fraction of the commanded travel not followed; NaN if too little was commanded."""
        commanded = windows[:, : -self._following, :2].max(axis=1).sum(axis=1)
        travelled = windows[:, :, 2:4].max(axis=1).sum(axis=1) - windows[:, :, 4].max(axis=1)
        enough = np.where(commanded >= _LEAST_COMMAND_DEG, commanded, np.nan)
        share: Array = 1.0 - np.maximum(travelled, 0.0) / enough
        return share

    def overall(self, flight: Mapping[str, Fit]) -> None:
        """Return None: a jam has no mean."""
        return

    def conclusion(self, flight: Mapping[str, Fit]) -> None:
        """Return None: a jam has no mean."""
        return
