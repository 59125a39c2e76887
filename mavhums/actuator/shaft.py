"""What the angle of a shaft shows: whether it is of one servo, and the travel that a profile lacks.

Servos that share an id report in turn, nearly at the same time: the angle leaps to and fro, faster than any
servo turns. All counts are over the flight, so that the division of the log into blocks does not matter.

How the angle follows from the pulse is a line, fitted to the first seconds in which both move together, and
then held: a shaft that stands later does not follow it. Of a shaft that does not follow from the beginning
there is no line, which is said where the pulse moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from mavhums.actuator.telemetry import Reading
from mavhums.core.arrays import Array, Flags, Integers
from mavhums.core.quantities import column

_V1, _V3 = column("V1"), column("V3")

_FASTEST_DEG_S: Final = 2000.0  # the fastest servos of models take 0.03 s for 60°
_LEAST, _SHARE = 20, 0.25
"""Leaps, and their share of the samples, that show several servos; of two, up to half of the samples leap."""
_SAMPLES: Final = 500  # that a line rests on: 10 s at 50 Hz
_MOVES_DEG: Final = 1.0  # standard deviation of what moves: less is noise
_TOGETHER: Final = 0.95  # correlation from which the shaft follows: its lag costs a few hundredths
_APART: Final = 0.3  # correlation, of either sign, below which the angle has nothing of the pulse


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


class Travel:
    """Converts the pulses of one actuator to angles, block after block."""

    def __init__(self) -> None:
        self._sums = np.zeros(6)  # number, and sums of pulse, angle, and their squares and product
        self._line: tuple[float, float] | None = None

    @property
    def never_follows(self) -> bool:
        """Whether the pulse moved so far and the angle did not go with it, in whatever unit it is."""
        count, x, y, xx, yy, xy = self._sums
        across, along, joint = count * xx - x * x, count * yy - y * y, count * xy - x * y
        along = max(along, 1e-9 * count * yy)  # of an angle that is one number only rounding is left
        moves = count >= _SAMPLES and across > (_MOVES_DEG * count) ** 2
        return self._line is None and bool(moves and joint * joint <= _APART**2 * across * along)

    def scale(self, values: Array, by_pulse: Flags) -> bool:
        """Replace V1 of V1…V12, shape (n, 12), where it is a pulse; NaN until the line is known.

        Return whether it is known.
        """
        rows = np.flatnonzero(by_pulse[:, _V1])
        pulse, angle = values[rows, _V1], values[rows, _V3]
        values[rows, _V1] = np.nan
        first = 0
        if self._line is None:
            both = np.isfinite(angle)
            x, y = np.where(both, pulse, 0.0), np.where(both, angle, 0.0)
            columns = np.stack([both, x, y, x * x, y * y, x * y], axis=1)
            sums = np.cumsum(np.vstack([self._sums, columns]), axis=0)
            self._sums = sums[-1]
            count, x, y, xx, yy, xy = sums[1:].T
            across, along, joint = count * xx - x * x, count * yy - y * y, count * xy - x * y
            moves = np.minimum(across, along) > (_MOVES_DEG * count) ** 2
            known = np.flatnonzero(
                (count >= _SAMPLES) & moves & (joint * joint >= _TOGETHER**2 * across * along)
            )
            if not known.size:
                return False
            first = int(known[0])
            slope = joint[first] / across[first]
            self._line = float(slope), float((y[first] - slope * x[first]) / count[first])
        values[rows[first:], _V1] = self._line[0] * pulse[first:] + self._line[1]
        return True
