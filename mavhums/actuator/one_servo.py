"""Whether the angles under one id are those of one servo, or of several that share the id.

Servos that share an id report in turn, nearly at the same time: the angle leaps to and fro, faster than any
servo turns. All counts are over the flight, so that the division of the log into blocks does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from mavhums.actuator.telemetry import Reading
from mavhums.core.arrays import Integers
from mavhums.core.quantities import column

_V3: Final = column("V3")
_FASTEST_DEG_S: Final = 2000.0  # the fastest servos of models take 0.03 s for 60°
_LEAST, _SHARE = 20, 0.25
"""Leaps, and their share of the samples, that show several servos; of two, up to half of the samples leap."""


class OneServo:
    """Counts the leaps of one actuator's angle."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[int, float]] = {}
        self._steps = self._leaps = 0

    @property
    def shared(self) -> bool:
        """Whether the angles so far are those of several servos."""
        return self._leaps >= max(_LEAST, _SHARE * self._steps)

    def feed(self, readings: Sequence[Reading], loose: Integers | None) -> None:
        """Take new readings; of the frames ``loose`` the time is not certain."""
        for reading in readings:
            angle, frame = reading.values[:, _V3], reading.frame
            known = np.isfinite(angle) & ~np.isin(frame, [] if loose is None else loose)
            if not known.any():
                continue
            time_us, angle = reading.utc_us[known], angle[known]
            last = self._last.get(reading.source, (int(time_us[0]), float(angle[0])))
            passed_s = np.diff(time_us, prepend=last[0]) * 1e-6
            leaps = np.abs(np.diff(angle, prepend=last[1])) > _FASTEST_DEG_S * passed_s
            self._steps += passed_s.size
            self._leaps += int((leaps & (passed_s >= 0.0)).sum())
            self._last[reading.source] = int(time_us[-1]), float(angle[-1])
