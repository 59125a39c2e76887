"""Resamples the signals of one vehicle on an even time grid, in whole seconds, whatever the block size.

A second is settled when the latest received time is :data:`SETTLED_S` past its end. Between samples a signal
is interpolated; over a gap of more than :data:`GAP_S` it is NaN. Samples more than :data:`LATE_S` behind the
latest are ignored, so a settled second does not depend on how the log was cut into blocks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mavhums.vehicle.signals import CONTINUOUS, NAMES, STEPPED, Signal

__all__ = ["GAP_S", "LATE_S", "RATE_HZ", "SETTLED_S", "Grid", "Seconds"]

RATE_HZ: Final = 20
GAP_S: Final = 1.2
LATE_S: Final = 0.5
SETTLED_S: Final = LATE_S + GAP_S
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
    """

    def __init__(self, start_us: int) -> None:
        self._start_us = start_us
        self._times: dict[str, Array] = {name: np.empty(0) for name in NAMES}
        self._values = {name: np.empty((0, n)) for name, n in {**CONTINUOUS, **STEPPED}.items()}
        self._latest_s = -np.inf
        self._settled = -(1 << 40)
        self.sources: dict[str, str] = {}

    def feed(self, signals: Sequence[Signal], *, final: bool = False) -> Seconds | None:
        """Take new samples and return the seconds that they settle; ``final`` marks the end of the input."""
        self._take(signals)
        reach = np.inf if final else np.floor(self._latest_s - SETTLED_S)
        index = self._heard(reach)
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

    def reached_s(self, frames: Times, signals: Sequence[Signal]) -> Times:
        """Return the second of the latest sample before places in the log, (n,), given the next signals.

        It is 0 before the first sample. Seconds that are settled later do not depend on it.
        """
        frame = np.concatenate([np.empty(0, dtype=np.int64), *(signal.frame for signal in signals)])
        time_s = np.concatenate([np.empty(0), *((s.time_us - self._start_us) / 1e6 for s in signals)])
        order = np.argsort(frame, kind="stable")
        latest = np.maximum.accumulate(np.append(max(self._latest_s, 0.0), time_s[order]))
        reached: Times = np.floor(latest[np.searchsorted(frame[order], frames)]).astype(np.int64)
        return reached

    def _take(self, signals: Sequence[Signal]) -> None:
        if not signals:
            return
        times = [(signal.time_us - self._start_us) / 1e6 for signal in signals]
        frame, every = np.concatenate([signal.frame for signal in signals]), np.concatenate(times)
        order = np.argsort(frame, kind="stable")
        latest = np.empty_like(every)
        latest[order] = np.maximum(np.maximum.accumulate(every[order]), self._latest_s)
        in_time = every >= latest - LATE_S
        self._latest_s = float(latest.max())
        edges = np.cumsum([0, *(time.size for time in times)])
        for signal, time_s, a, b in zip(signals, times, edges[:-1], edges[1:], strict=True):
            self._append(signal, time_s, in_time[a:b])

    def _append(self, signal: Signal, time_s: Array, good: NDArray[np.bool_]) -> None:
        kept = self._times[signal.name]
        last = kept[-1] if kept.size else -np.inf
        before = np.maximum.accumulate(np.append(last, np.where(good, time_s, -np.inf)))[:-1]
        rows = good & (time_s > before)
        self._times[signal.name] = np.concatenate([kept, time_s[rows]])
        self._values[signal.name] = np.concatenate([self._values[signal.name], signal.values[rows]])
        self.sources.setdefault(signal.name, signal.source)

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
    """Return the distance between the samples around each time, shape (n, 1); NaN outside them."""
    out = np.full((at.size, 1), np.nan)
    after = np.searchsorted(time_s, at, side="right")
    inside = (after > 0) & (after < time_s.size)
    out[inside, 0] = time_s[after[inside]] - time_s[after[inside] - 1]
    return out


def _held(time_s: Array, values: Array, at: Array) -> Array:
    """Return the last reported value; NaN if none was reported for seconds."""
    if not time_s.size:
        return np.full((at.size, values.shape[1]), np.nan)
    before = np.searchsorted(time_s, at, side="right") - 1
    row = np.maximum(before, 0)
    known = (before >= 0) & (at - time_s[row] <= _HELD_S)
    return np.where(known[:, None], values[row], np.nan)
