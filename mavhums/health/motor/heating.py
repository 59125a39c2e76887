"""How much each motor's ESC warms beside the others, for the thrust that is asked of its motor.

A board heats with the losses in it and cools towards the air: dT/dt = q·u − (T − T_air)/τ. Losses go with the
square of the current, and that with the square of the thrust, u, which every log has. Integrated,
T − T(0) = q·∫u − (1/τ)·∫T + (T_air/τ)·t is linear in q and τ of each ESC, given the one air that all share,
and the air is the one that leaves least. Sun, battery, payload and what is left of the flight before act on
all ESCs alike; so what counts is q·τ, the rise by load, of one by the mean of the others. What hinders the
cooling of one, or drags at its motor, raises that from one flight to the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Final

import numpy as np

from mavhums.core.arrays import Array
from mavhums.health.decision.thresholds import AGREEING
from mavhums.results.verdict import Indicator

HEATING: Final = "heating"
"""Fault of the indicator: what the ESC warms by beside the others, by the thrust asked of their motors."""
_WARMING: Final = "warming of the ESC by its load, beside the others"

_MOST_ESCS: Final = 16
_BESIDE_S: Final = 2  # on either side: of five seconds the median counts, as one may be damaged, or missing
_LATE_S: Final = 40  # by which a stream may lag
_MOST_KEPT: Final = 1 << 15  # seconds: more that are not taken yet are damage or an attack
_USUAL_C: Final = 25.0  # from which temperatures are counted, so that integrals stay small
_RUN_S: Final = 600
"""Seconds after which integration begins anew: what is not modelled adds up."""
_TOGETHER_S: Final = 60.0
"""Time by which errors are alike: a board follows its load and the air as slowly. By hand: the errors of half
of simulated flights are then as large as is said, those of the others larger, as they show in the scatter."""
_AIR_C: Final = (-60.0, 60.0)
_NOISE: Final = 1.0 / 12.0  # K²: that of whole degrees
_LEAST_ESCS: Final = 3  # of two that differ, nothing says which one changed
_LEAST_S: Final = 120  # two of these
_MOST_ERROR: Final = 0.25
"""Standard error of the share, from which on a flight says nothing: too short, or its ESCs hardly warm."""


class EscHeating:
    """Follows the temperatures of ESCs beside the loads of the motors, in constant memory."""

    def __init__(self) -> None:
        self._heard: dict[int, dict[int, float]] = {}  # by ESC and second the lowest reading
        self._pending: list[tuple[int, Array]] = []
        self._courses: dict[int, _Course] = {}

    def hear(self, esc: int, time_s: Array, celsius: Array) -> None:
        """Take the temperatures of one ESC, from 0, °C."""
        known = np.isfinite(celsius)
        if known.any() and 0 <= esc < _MOST_ESCS:
            seconds, place = np.unique(time_s[known] // 1, return_inverse=True)
            lowest = np.full(seconds.size, np.inf)
            np.minimum.at(lowest, place, celsius[known])
            heard = self._heard.setdefault(esc, {})
            for second, value in zip(seconds.astype(np.int64).tolist(), lowest.tolist(), strict=True):
                if second in heard or len(heard) < _MOST_KEPT:
                    heard[second] = min(value, heard.get(second, value))

    def forget(self, first: int) -> None:
        """Forget what was heard before a second."""
        for heard in self._heard.values():
            for second in [one for one in heard if one < first]:
                del heard[second]

    def add(self, second: int, load: Array) -> None:
        """Take a second in which it flew; ``load`` is the mean square of each motor's thrust, (motors,)."""
        self._pending.append((second, load))
        while self._pending[0][0] < second - _LATE_S:
            self._take(*self._pending.pop(0), self._courses)
            self.forget(self._pending[0][0] - _BESIDE_S)

    def indicators(self, escs: Sequence[int]) -> list[tuple[Indicator, ...]]:
        """Return the indicator of each motor, given its ESC; none where the flight does not show it."""
        courses = deepcopy(self._courses)
        for pending in self._pending:
            self._take(*pending, courses)
        found: list[tuple[Indicator, ...]] = [()] * len(escs)
        motors = [k for k, esc in enumerate(escs) if esc in courses and courses[esc].seconds >= _LEAST_S]
        seconds = {k: courses[escs[k]].seconds for k in motors}
        # An ESC without a sensor reports nothing, or the same throughout.
        sums = {k: own for k in motors if (own := courses[escs[k]].sums(k))[0, 0] > _NOISE * seconds[k]}
        if len(sums) >= _LEAST_ESCS:
            samples = np.array([seconds[k] for k in sums])
            for k, value, error in zip(sums, *shares(np.stack([*sums.values()]), samples), strict=True):
                if 0.0 < error <= _MOST_ERROR:
                    blocks = int(seconds[k] / _TOGETHER_S)
                    mean = (float(value), float(error))
                    shown = Indicator.of_mean(HEATING, _WARMING, "1", mean, windows=blocks, needed=AGREEING)
                    found[k] = (shown,)
        return found

    def _take(self, second: int, load: Array, courses: dict[int, _Course]) -> None:
        for esc, heard in self._heard.items():
            beside = range(second - _BESIDE_S, second + _BESIDE_S + 1)
            values = [heard[one] for one in beside if one in heard]
            if values:
                courses.setdefault(esc, _Course()).add(
                    second, sorted(values)[(len(values) - 1) // 2] - _USUAL_C, load
                )


class _Course:
    """How one ESC's temperature, its integral, the time and the integrals of all loads vary together."""

    def __init__(self) -> None:
        self._run: list[tuple[float, ...]] = []  # the seconds since the last gap
        self._last_s = -1
        self._sums: Array | float = 0.0
        self.seconds = 0

    def add(self, second: int, kelvin: float, load: Array) -> None:
        if second != self._last_s + 1 or len(self._run) == _RUN_S:
            self._sums = self._sums + _products(self._run) if self._run else self._sums
            self._run = []
        self._run.append((kelvin, 1.0, *load.tolist()))
        self._last_s, self.seconds = second, self.seconds + 1

    def sums(self, motor: int) -> Array:
        """Return the sums of products about their means of these with the load of one motor, shape (4, 4)."""
        own = [0, 1, 2, 3 + motor]
        return np.asarray(self._sums + _products(self._run))[np.ix_(own, own)]


def _products(run: list[tuple[float, ...]]) -> Array:
    values = np.array(run)
    integrals = values.cumsum(axis=0) - values
    both = np.concatenate([values[:, :1], integrals], axis=1)
    off = both - both.mean(axis=0)
    products: Array = off.T @ off
    return products


def shares(sums: Array, seconds: Array) -> tuple[Array, Array]:
    """Return by how much each ESC's load warms it, by the mean of the others, and the standard errors.

    NaN where the model explains nothing: an ESC that its load does not heat, or that does not cool.

    Parameters
    ----------
    sums
        Of products, about their means, of an ESC's temperature, its integral, time, and the integral of the
        load, shape (ESCs, 4, 4).
    seconds
        Number of the samples of each, shape (ESCs,).
    """
    from scipy.optimize import minimize_scalar  # few flights have temperatures

    def fit(air: float) -> tuple[Array, Array, Array]:
        """Return what is left of each, its rates of heating and of cooling, and the inverse of the design."""
        columns = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, -1.0, air, 0.0]])
        response = (columns @ sums)[:, :, 0]
        inverse = np.linalg.pinv(columns @ sums @ columns.T, hermitian=True)
        rates = (inverse @ response[:, :, None])[:, :, 0]
        return sums[:, 0, 0] - (rates * response).sum(axis=1), rates, inverse

    lowest, highest = (bound - _USUAL_C for bound in _AIR_C)
    air = minimize_scalar(lambda air: float(fit(air)[0].sum()), bounds=(lowest, highest), method="bounded")
    left, rates, inverse = fit(float(air.x))
    variance = np.maximum(left / seconds, _NOISE) * _TOGETHER_S
    others = (np.ones((len(sums), len(sums))) - np.eye(len(sums))) / (len(sums) - 1)
    with np.errstate(all="ignore"):
        warming = np.where(rates.min(axis=1) > 0.0, rates[:, 0] / rates[:, 1], np.nan)
        slopes = np.stack([1.0 / rates[:, 1], -warming / rates[:, 1]], axis=1)
        errors = np.einsum("ij,ijk,ik->i", slopes, inverse, slopes) * variance
        usual = others @ warming
        value = warming / usual
        return value, np.sqrt(errors + value**2 * (others**2 @ errors)) / usual
