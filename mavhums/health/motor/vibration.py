"""How much each rotor shakes the aircraft: the specific force at its speed, by the square of the speed.

A mass m off a rotor's axis by r pulls with m·r·ω², so the aircraft moves by m·r/M at every speed: a propeller
that lost a piece, or a bearing that is worn, moves it more. The specific force of half a second is fitted, by
least squares, by sines and cosines of all rotors' phases and of twice the phases, the phase being the speed
that the ESC reports, integrated. Sampling below twice the speed folds a rotor's line to another place, where
the same sines and cosines have it: what counts is that no other rotor's column is alike (:data:`_ALIKE`), and
not the rate. Sensor filters and the distance from the rotor scale a motor's value, alike in all flights.

References
----------
R. Potter and M. Gribler (1989), Computed order tracking obsoletes older methods, SAE 891131.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import deepcopy
from typing import Final

import numpy as np

from mavhums.core.arrays import Array, Flags
from mavhums.health.decision.thresholds import AGREEING
from mavhums.health.estimation.random_effects import RunningVariance
from mavhums.results.verdict import Indicator
from mavhums.vehicle.grid import RATE_HZ

UNBALANCE: Final = "unbalance"
"""Fault of the indicator: what the rotor moves the aircraft by."""

_WINDOW_S: Final = 0.5
"""Longer ones need a phase that reports of 10 Hz do not have; shorter ones tell no rotors 2 Hz apart."""
_LEAST_S: Final = 0.2  # of samples in a window: a record may begin or break off in it
_LEAST_HZ: Final = 100.0  # of samples: slower ones are a stream that lost most of them
_LEAST_FREEDOM: Final = 20
_MOST_SAMPLES: Final = 4096  # in a window
_ALIKE: Final = 4.0
"""Factor by which the other columns raise a column's variance, from which on it is another's, too."""
_SLOW_HZ: Final = 15.0
"""Speed below which a rotor idles, and its line lies among the aircraft's own motions."""
_SILENT_S: Final = 0.6  # between two reports of a speed that is interpolated
_UNSTEADY: Final = 0.5
"""Turns by which the phase between two reports is uncertain, from which on it is not known: what the speed
changes by, by the time between them."""
_BLOCK: Final = 5  # windows whose median counts as one value: a gust or a turn spoils some of them
_LATE_S: Final = 40  # by which a stream may lag
_MOST_KEPT: Final = 1 << 19  # samples: more in so short a time are damage or an attack
_METRES: Final = 1e-6


def squared_motions(time_s: Array, force: Array, hertz: Array) -> tuple[Array, Array]:
    """Return by how much each rotor moves the aircraft, squared, and the part of it that is noise, m².

    Parameters
    ----------
    time_s
        Shape (n,), increasing.
    force
        Specific force, m/s², shape (n, axes).
    hertz
        Speeds of the rotors, shape (n, rotors).

    Returns
    -------
    tuple
        Shape (rotors,) both, NaN of a rotor whose line is not apart from the others'.
    """
    speed = 2.0 * np.pi * hertz
    steps = np.diff(time_s)[:, None] * (speed[1:] + speed[:-1]) / 2.0
    phase = np.concatenate([np.zeros((1, hertz.shape[1])), steps.cumsum(axis=0)])
    both = np.concatenate([phase, 2.0 * phase], axis=1)
    trend = np.stack([np.ones(time_s.size), np.linspace(-1.0, 1.0, time_s.size)], axis=1)
    design = np.concatenate([trend, np.cos(both), np.sin(both)], axis=1)
    products = design.T @ design
    inverse = np.linalg.inv(products + 1e-9 * time_s.size * np.eye(len(products)))
    weights = inverse @ (design.T @ force)
    freedom = time_s.size - len(products)
    variance = float(((force - design @ weights) ** 2).sum()) / max(freedom, 1)
    rotors = hertz.shape[1]
    own = np.array([2 + np.arange(rotors), 2 + 2 * rotors + np.arange(rotors)])  # its cosine, its sine
    errors = np.diag(inverse)[own]
    apart = (errors * np.diag(products)[own]).max(axis=0) < _ALIKE
    apart &= freedom >= _LEAST_FREEDOM
    # It turns, so it is in two axes: half of their squares is that of the radius.
    scale = np.where(apart, (speed**2).mean(axis=0) ** -2 / 2.0, np.nan)
    return (weights[own] ** 2).sum(axis=(0, 2)) * scale, errors.sum(axis=0) * variance * scale


class _Blocks:
    """Mean and scatter of the blocks of one rotor, in constant memory."""

    def __init__(self) -> None:
        self._windows: list[tuple[float, float]] = []
        self.motions = RunningVariance()

    def add(self, square: float, noise: float) -> None:
        self._windows.append((square, noise))
        if len(self._windows) == _BLOCK:
            total, usual = np.median(self._windows, axis=0).tolist()
            self._windows.clear()
            # What is below the noise is as good as the noise of the block's mean.
            self.motions.add(max(total - usual, usual / _BLOCK**0.5) ** 0.5)


class RotorVibration:
    """Follows by how much each rotor moves the aircraft, in constant memory."""

    def __init__(self) -> None:
        self._force: dict[str, list[tuple[Array, Array]]] = {}
        self._speeds: dict[int, list[tuple[Array, Array]]] = {}
        self._pending: list[int] = []
        self._blocks: dict[int, _Blocks] = {}

    def hear_force(self, source: str, time_s: Array, force: Array) -> None:
        """Take specific force, m/s², shape (n, 3), of one source."""
        known = np.isfinite(force).all(axis=1)
        _keep(self._force.setdefault(source, []), time_s[known], force[known])

    def hear_speed(self, esc: int, time_s: Array, rpm: Array) -> None:
        """Take the speeds of one ESC, from 0, rev/min."""
        known = np.isfinite(rpm)
        _keep(self._speeds.setdefault(esc, []), time_s[known], np.abs(rpm[known, None]) / 60.0)

    def forget(self, before_s: float) -> None:
        """Forget what was heard of before a time."""
        for kept in (*self._force.values(), *self._speeds.values()):
            kept[:] = [one for one in kept if one[0][-1] >= before_s]

    def add(self, first_s: int, flown: Flags) -> None:
        """Take whole seconds: in which rows it flew upright."""
        whole: Flags = np.all(flown.reshape(-1, RATE_HZ), axis=1)
        self._pending += (first_s + np.flatnonzero(whole)).tolist()
        now = first_s + len(whole)
        while self._pending and self._pending[0] < now - _LATE_S:
            self._take(self._pending.pop(0), self._blocks)
        self.forget(now - _LATE_S - 2.0)

    def indicators(self, escs: Sequence[int]) -> list[tuple[Indicator, ...]]:
        """Return the indicator of each motor, given its ESC; none where too few windows tell it apart."""
        blocks = deepcopy(self._blocks)
        for second in self._pending:
            self._take(second, blocks)
        shown = {esc: own.motions for esc, own in blocks.items() if own.motions.count >= AGREEING}
        return [(_indicator(shown[esc]),) if esc in shown else () for esc in escs]

    def _take(self, second: int, blocks: dict[int, _Blocks]) -> None:
        for start_s in np.arange(second, second + 1.0, _WINDOW_S).tolist():
            for esc, square, noise in self._window(start_s):
                blocks.setdefault(esc, _Blocks()).add(square, noise)

    def _window(self, start_s: float) -> Iterator[tuple[int, float, float]]:
        """Yield the squared motion by each rotor in a window, and its noise, by ESC."""
        end_s = start_s + _WINDOW_S
        streams = [_within(kept, start_s, end_s) for kept in self._force.values() if self._speeds]
        time_s, force = max(streams, key=lambda one: one[0].size, default=(np.zeros(0), np.zeros(0)))
        if not time_s.size or time_s[-1] - time_s[0] < _LEAST_S or time_s.size > _MOST_SAMPLES:
            return
        if (time_s.size - 1) / (time_s[-1] - time_s[0]) < _LEAST_HZ:
            return
        known = {esc: speed for esc in self._speeds if (speed := self._speed(esc, time_s)) is not None}
        if not known:
            return
        squares, noises = squared_motions(time_s, force, np.stack([*known.values()], axis=1))
        for esc, square, noise in zip(known, squares.tolist(), noises.tolist(), strict=True):
            if np.isfinite(square) and np.isfinite(noise):
                yield esc, square, noise

    def _speed(self, esc: int, time_s: Array) -> Array | None:
        """Return a rotor's speed at some times, Hz; None if it idles, or is not reported around them."""
        at, hertz = _within(self._speeds[esc], time_s[0] - _SILENT_S, time_s[-1] + _SILENT_S)
        if at.size < 2 or at[0] > time_s[0] or at[-1] < time_s[-1] or np.diff(at).max() > _SILENT_S:
            return None
        if (np.abs(np.diff(hertz[:, 0])) * np.diff(at)).max() > _UNSTEADY:
            return None
        speed = np.interp(time_s, at, hertz[:, 0])
        return speed if speed.min() > _SLOW_HZ and np.ptp(hertz) > 0.0 else None


def _keep(kept: list[tuple[Array, Array]], time_s: Array, values: Array) -> None:
    if time_s.size and sum(one.size for one, _ in kept) < _MOST_KEPT:
        order = np.argsort(time_s, kind="stable")
        kept.append((time_s[order], values[order]))


def _within(kept: Sequence[tuple[Array, Array]], start_s: float, end_s: float) -> tuple[Array, Array]:
    """Return the samples from a time to before another, in order of time, each time once."""
    spans = [(*np.searchsorted(time_s, (start_s, end_s)).tolist(), time_s, values) for time_s, values in kept]
    parts = [(time_s[a:b], values[a:b]) for a, b, time_s, values in spans if a < b]
    if not parts:
        return np.zeros(0), np.zeros((0, 1))
    time_s, values = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    time_s, first = np.unique(time_s, return_index=True)
    return time_s, values[first]


def _indicator(motions: RunningVariance) -> Indicator:
    value, error = motions.mean / _METRES, (motions.variance / motions.count) ** 0.5 / _METRES
    quantity = "unbalance of the rotor, by the aircraft's mass"
    return Indicator.of_mean(
        UNBALANCE, quantity, "µm", (value, error), windows=motions.count, needed=AGREEING
    )
