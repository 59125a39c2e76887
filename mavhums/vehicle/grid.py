"""Resamples the signals of one vehicle on an even time grid, in whole seconds, whatever the block size.

A second is settled once every stream has passed it, see :mod:`mavhums.vehicle.order`; samples that come
later are counted and ignored, so a settled second does not depend on how the log was cut into blocks. Between
samples a signal is interpolated; over a gap of more than :data:`GAP_S` it is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.vehicle.order import GAP_S, Order, Received
from mavhums.vehicle.signals import CONTINUOUS, NAMES, STEPPED, Signal

__all__ = ["GAP_S", "RATE_HZ", "Grid", "Seconds"]

RATE_HZ: Final = 20
_HELD_S: Final = 5.0
_SPACED: Final = ("outputs", "outputs_2", "rates", "slow_rates")

Array = NDArray[np.float64]
Times = NDArray[np.int64]


class Seconds:
    """Settled seconds: arrays of k seconds with ``RATE_HZ`` rows each.

    Attributes
    ----------
    index
        Whole flight seconds, shape (k,), increasing; seconds without any sample are omitted.
    signals
        By name, shape (k, RATE_HZ, columns). Names such as ``outputs_spacing`` have one column: the distance
        between the samples before and after a row, s.
    """

    def __init__(self, index: Times, signals: Mapping[str, Array]) -> None:
        self.index = index
        self.signals = signals


class Grid:
    """Resamples one vehicle's signals on the grid.

    Parameters
    ----------
    start_us
        Start of flight time, microseconds of UTC.

    Attributes
    ----------
    sources
        Message or record of each signal heard.
    """

    def __init__(self, start_us: int) -> None:
        self._start_us = start_us
        self._times: dict[str, Array] = {name: np.empty(0) for name in NAMES}
        self._values = {name: np.empty((0, n)) for name, n in {**CONTINUOUS, **STEPPED}.items()}
        self._order = Order()
        self._settled = -(1 << 40)
        self.sources: dict[str, str] = {}

    def feed(self, signals: Sequence[Signal], *, final: bool = False) -> Seconds | None:
        """Take new samples and return the seconds that they settle; ``final`` marks the end of the input."""
        self._take(signals)
        index = self._heard(np.inf if final else self._order.settled_s)
        if not index.size:
            return None
        at = (index[:, None] + np.arange(RATE_HZ) / RATE_HZ).ravel()
        shape = (index.size, RATE_HZ, -1)
        found = {name: _between(self._times[name], self._values[name], at) for name in CONTINUOUS}
        found |= {name: _held(self._times[name], self._values[name], at) for name in STEPPED}
        found |= {f"{name}_spacing": _spacing(self._times[name], at) for name in _SPACED}
        self._settled = int(index[-1]) + 1
        self._forget()
        return Seconds(index, {name: values.reshape(shape) for name, values in found.items()})

    @property
    def held(self) -> int:
        """Number of samples that are kept for the seconds to come."""
        return sum(time_s.size for time_s in self._times.values())

    def reached_s(self, frames: Times, signals: Sequence[Signal]) -> Times:
        """Return the second of the latest sample before places in the log, (n,), given the next signals.

        It is 0 before the first sample, and never before a second that is settled.
        """
        frame = np.concatenate([np.empty(0, dtype=np.int64), *(signal.frame for signal in signals)])
        time_s = np.concatenate([np.empty(0), *((s.time_us - self._start_us) / 1e6 for s in signals)])
        order = np.argsort(frame, kind="stable")
        latest = np.maximum.accumulate(np.append(max(self._order.newest_s, 0.0), time_s[order]))
        reached: Times = np.floor(latest[np.searchsorted(frame[order], frames)]).astype(np.int64)
        return reached

    def received(self) -> dict[str, Received]:
        """Return, by message, how many samples were kept, came late, or came twice."""
        found: dict[str, Received] = {}
        for name, source in self.sources.items():
            counts = self._order.received(name)
            found[source] = max(found.get(source, counts), counts, key=sum)
        return found

    def _take(self, signals: Sequence[Signal]) -> None:
        times = [(signal.time_us - self._start_us) / 1e6 for signal in signals]
        for signal, time_s, good in zip(signals, times, self._order.feed(signals, times), strict=True):
            name = signal.name
            self._times[name] = np.concatenate([self._times[name], time_s[good]])
            self._values[name] = np.concatenate([self._values[name], signal.values[good]])
            self.sources.setdefault(name, signal.source)

    def _heard(self, reach: float) -> Times:
        """Return the settled seconds that contain or adjoin a sample of the attitude or of an output."""
        heard = [
            np.floor(self._times[name]) for name in ("outputs", "outputs_2", "attitude", "rates", "state")
        ]
        seconds = np.unique(np.concatenate(heard)).astype(np.int64)
        return seconds[(seconds >= self._settled) & (seconds + 1 <= reach)]

    def _forget(self) -> None:
        """Keep the samples that the next second may need: the one before it, and all later ones."""
        for name in NAMES:
            first = max(int(np.searchsorted(self._times[name], self._settled - GAP_S)) - 1, 0)
            self._times[name] = self._times[name][first:]
            self._values[name] = self._values[name][first:]


def _between(time_s: Array, values: Array, at: Array) -> Array:
    """Interpolate; return NaN where the samples on both sides are more than a gap apart."""
    out = np.full((at.size, values.shape[1]), np.nan)
    after = np.searchsorted(time_s, at, side="right")
    inside = (after > 0) & (after < time_s.size)
    right = after[inside]
    left = right - 1
    span = time_s[right] - time_s[left]
    close = span <= GAP_S
    share = ((at[inside] - time_s[left]) / span)[:, None]
    a, b = values[left], values[right]
    step = b - a
    mixed = a + share * step
    out[inside] = np.where(close[:, None], mixed, np.nan)
    return out


def _spacing(time_s: Array, at: Array) -> Array:
    """Return the distance between the samples around each time, shape (n, 1); NaN where they are far apart.

    Of a stream that was silent for long, the next sample may or may not be known when a second settles.
    """
    out = np.full((at.size, 1), np.nan)
    after = np.searchsorted(time_s, at, side="right")
    inside = (after > 0) & (after < time_s.size)
    out[inside, 0] = time_s[after[inside]] - time_s[after[inside] - 1]
    out[out > _HELD_S] = np.nan
    return out


def _held(time_s: Array, values: Array, at: Array) -> Array:
    """Return the last reported value; NaN if none was reported for seconds."""
    if not time_s.size:
        return np.full((at.size, values.shape[1]), np.nan)
    before = np.searchsorted(time_s, at, side="right") - 1
    row = np.maximum(before, 0)
    known = (before >= 0) & (at - time_s[row] <= _HELD_S)
    return np.where(known[:, None], values[row], np.nan)
