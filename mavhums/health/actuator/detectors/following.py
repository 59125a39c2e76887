"""A shaft that moves, but not as commanded: a weak supply, motor or winding, or a gear near to jamming.

It needs the command, a sensor of the output shaft's angle, and from the data sheet the slew rate and the
stroke; none of the motor's constants. A model follows the command as a healthy actuator would: with the lag
of its controller, no faster than its slew rate and no farther than its stroke. What the shaft lags behind the
model, no healthy actuator lags: friction, load and play move it by less than the limit.

A shaft that stands is left to the detector of jams. A second in which little is asked shows no fault and
ends none.
"""

from __future__ import annotations

from math import exp
from typing import ClassVar

import numpy as np

from mavhums.actuator.profile import Actuator
from mavhums.core.arrays import Array
from mavhums.core.kernels import kernel
from mavhums.core.quantities import column
from mavhums.health.actuator.detector import DetectorInput, WindowDetector
from mavhums.health.actuator.thresholds import (
    FOLLOWING_ASKED_LIMITS,
    FOLLOWING_LONGEST_GAP_S,
    FOLLOWING_SECONDS,
    FOLLOWING_STANDS_SHARE,
)
from mavhums.health.decision.limits import Levels
from mavhums.health.estimation.fits import Estimates
from mavhums.health.estimation.slots import SENSED, SHAFT, Windows

_V1 = column("V1")


class FollowingDetector(WindowDetector):
    """Error of following: the shaft's angle minus that of the model, root mean square over a second.

    Of a window's ten seconds, the third largest counts.
    """

    fault: ClassVar[str] = "following"
    quantity: ClassVar[str] = "error of following the command"
    unit: ClassVar[str] = "°"
    inspect: ClassVar[str] = (
        "supply, motor, winding and gear, which move the surface too slowly or too little"
    )

    def __init__(self, actuator: Actuator) -> None:
        limits = actuator.limits
        self.levels = Levels(limits.following_deg, limits.following_emergency_deg) if limits else Levels()
        self._limit = self.levels.normal or np.inf
        low, high = sorted(actuator.travel_deg or (-np.inf, np.inf))
        self._model = np.array([actuator.response_lag_s, actuator.slew_deg_s or np.inf, low, high])
        self._state = np.full(3, np.nan)
        self._windows = Windows(1, empty=np.nan)

    @staticmethod
    def suits(actuator: Actuator) -> bool:
        """Return whether the profile has the slew rate and limits."""
        return actuator.slew_deg_s is not None and actuator.limits is not None

    def feed(self, seen: DetectorInput) -> Estimates:
        """Return the error; undecidable where fewer than three seconds of ten show a moving shaft."""
        slots = seen.slots
        own = slots.values[slots.judged]
        shaft = np.where(own[:, SENSED] > 0, own[:, SHAFT], np.nan)
        error = _errors(slots.time_s[slots.judged], own[:, _V1], shaft, self._model, self._state)
        known = np.isfinite(error)
        shown = np.stack([known, np.where(known, error, 0.0) ** 2], axis=1)
        count, squares = slots.sums(shown.astype(np.float64)).T
        rms = np.sqrt(np.divide(squares, count, out=np.full(count.size, np.nan), where=count > 0))
        travel, asked = (
            np.fmax.reduceat(angle, slots.start) - np.fmin.reduceat(angle, slots.start)
            for angle in (shaft, shaft - error)
        )
        # A second that asks little neither shows a fault nor ends one.
        tells = (rms > self._limit) | (asked >= FOLLOWING_ASKED_LIMITS * self._limit)
        # A shaft that stands is jammed or idle; either would read as a large error.
        moved = np.where((travel >= FOLLOWING_STANDS_SHARE * rms) & tells, rms, np.nan)
        windows = self._windows.feed(slots.index, moved[:, None])[:, :, 0]
        # The third largest of ten: one glitch of a sensor, or a step in two seconds, is no fault.
        largest = np.sort(np.where(np.isnan(windows), -np.inf, windows), axis=1)[:, -FOLLOWING_SECONDS]
        return Estimates.of(largest, np.zeros_like(largest), np.ones_like(largest), np.isfinite(largest))


@kernel
def _errors(time_s: Array, command: Array, shaft: Array, model: Array, state: Array) -> Array:
    """Return the shaft's angle minus the model's, NaN where the model starts anew, shape (n,).

    ``model`` holds lag, slew rate and stroke, ``state`` time, command and the model's angle between blocks.
    """
    lag, slew, low, high = model
    error = np.full(time_s.size, np.nan)
    for k in range(time_s.size):
        if np.isnan(command[k]) or np.isnan(shaft[k]):
            continue
        passed = time_s[k] - state[0]
        # After a gap the model starts where the shaft is.
        if passed <= FOLLOWING_LONGEST_GAP_S:  # not of NaN
            # The mean of two commands: a step between the samples came at half time on average.
            asked = min(max((command[k] + state[1]) / 2, low), high)
            step = (asked - state[2]) * (1.0 - exp(-passed / lag))
            state[2] += min(max(step, -slew * passed), slew * passed)
            error[k] = shaft[k] - state[2]
        else:
            state[2] = shaft[k]
        state[0], state[1] = time_s[k], command[k]
    return error
