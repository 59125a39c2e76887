"""A surface that is commanded and does not move: jammed, disconnected or without power.

It takes the command and the output shaft's angle, and none of the actuator's constants. An angle that
was integrated from a speed whose sign the command gave is no witness.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.health.detector import Estimates, Levels, Seen
from mavhums.health.least_squares import Fit
from mavhums.health.slots import SHAFT
from mavhums.health.windows import Windows
from mavhums.quantities import column

__all__ = ["Detector"]

_V1 = column("V1")
_STANDS = 0.9
_LEAST_COMMAND_DEG = 4.0
_LASTING_S = 3.0
_FOLLOWING_S = 1.0

Array = NDArray[np.float64]


class Detector:
    """Share of the commanded travel that the shaft leaves out, within three seconds.

    The command's last second does not count: the shaft may not have followed yet.
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
        self._windows = Windows(4, ceil(_LASTING_S / slot_s), empty=np.nan)

    @staticmethod
    def suits(actuator: Actuator) -> bool:
        """Return True: nothing of the actuator need be known."""
        return True

    def feed(self, seen: Seen) -> Estimates:
        """Return the share; undecidable where less than 4° of travel was commanded."""
        own, start = seen.slots.values[seen.slots.judged], seen.slots.start
        extremes = np.stack(
            [
                np.maximum.reduceat(own[:, _V1], start),
                -np.minimum.reduceat(own[:, _V1], start),
                np.maximum.reduceat(own[:, SHAFT], start),
                -np.minimum.reduceat(own[:, SHAFT], start),
            ],
            axis=1,
        )
        windows = self._windows.feed(seen.slots.index, extremes)
        commanded = windows[:, : -self._following, :2].max(axis=1).sum(axis=1)
        travelled = windows[:, :, 2:].max(axis=1).sum(axis=1)
        moved = commanded >= _LEAST_COMMAND_DEG
        share = 1.0 - np.divide(travelled, commanded, out=np.full_like(commanded, np.nan), where=moved)
        return Estimates.of(share, np.zeros_like(share), np.ones_like(share), moved)

    def overall(self, flight: Mapping[str, Fit]) -> None:
        """Return None: a jam has no mean."""
        return

    def conclusion(self, flight: Mapping[str, Fit]) -> None:
        """Return None: a jam has no mean."""
        return
