"""Which samples show the actuator in motion: a standing actuator shows no friction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator
from mavhums.health.slots import Slot
from mavhums.quantities import column

__all__ = ["Motion", "motion"]

_PERIODS = 2.5


class Motion(NamedTuple):
    """The slot's samples that have neighbours on both sides; arrays of shape (m,).

    Attributes
    ----------
    moving
        Whether the rotor turns the same way, and fast enough, before, at and after the sample, and
        the samples come often enough to be evidence.
    speed
        Output shaft, rad/s.
    acceleration
        Output shaft, rad/s², from central differences.
    values
        V1…V12, shape (m, 12).
    """

    moving: NDArray[np.bool_]
    speed: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    values: NDArray[np.float64]


def motion(actuator: Actuator, slot: Slot) -> Motion | None:
    """Return the motion in a slot, or None if it has fewer than three samples."""
    if slot.time_s.size < 3:
        return None
    rev_min = slot.values[:, column("V7")]
    speed = rev_min * actuator.rad_s(1.0)
    span = slot.time_s[2:] - slot.time_s[:-2]
    fast = np.abs(rev_min) > actuator.moving_speed_rev_min
    sign = np.sign(rev_min)
    one_way = (sign[:-2] == sign[1:-1]) & (sign[1:-1] == sign[2:])
    moving = fast[:-2] & fast[1:-1] & fast[2:] & one_way & (span < _PERIODS / actuator.min_rate_hz)
    return Motion(moving, speed[1:-1], (speed[2:] - speed[:-2]) / span, slot.values[1:-1])
