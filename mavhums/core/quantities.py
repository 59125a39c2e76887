"""The quantities V1–V12 of an actuator (paper, section 5), and their statistics over a window.

Their order is the same everywhere: in arrays of shape ``(n, 12)``, in tables, in the
``data`` field of the instrumented tier and in model files.

Signs: positive current accelerates towards positive angles; V11 is the external (hinge)
load and is positive when it opposes motion towards positive V3.

The statistics, the inputs of a network, are functions of sums over samples: a window costs the memory of its
slots' sums, and its values depend neither on the rate of the log nor on how it was cut into blocks.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mavhums.core.arrays import Array


class Quantity(NamedTuple):
    """One controlled parameter of the actuator."""

    key: str
    name: str
    unit: str


QUANTITIES: Final = (
    Quantity("V1", "input signal", "°"),
    Quantity("V2", "rotor rotation", "°"),
    Quantity("V3", "output shaft angle", "°"),
    Quantity("V4", "supply voltage", "V"),
    Quantity("V5", "supply current", "A"),
    Quantity("V6", "supply power", "W"),
    Quantity("V7", "rotor speed", "rev/min"),
    Quantity("V8", "rotor shaft torque", "N·m"),
    Quantity("V9", "rotor shaft power", "W"),
    Quantity("V10", "output shaft speed", "rev/min"),
    Quantity("V11", "output shaft torque", "N·m"),
    Quantity("V12", "output shaft power", "W"),
)
KEYS: Final = tuple(quantity.key for quantity in QUANTITIES)


def column(key: str) -> int:
    """Return the column of a quantity in an array of shape ``(n, 12)``.

    Raises
    ------
    ValueError
        If ``key`` is none of V1…V12.

    Examples
    --------
    >>> column("V5")
    4
    """
    return KEYS.index(key)


MOMENTS: Final = ("1", "way", "V3", "V4", "V5", "V7", "slope", "V11", "gap", "flank")
"""Columns of a moving sample whose products are summed: one; the sign of V7; V7 in 1000 rev/min; its slope,
1000 rev/min a second; V3 − V2/N, °; and the sign of V5."""

_PLACE = {name: k for k, name in enumerate(MOMENTS)}
_UPPER = np.triu_indices(len(MOMENTS))
_PAIRS = len(_UPPER[0])
_CARRIED = {"commands": "V1", "gaps": "V2", "volts": "V4", "loads": "V11"}
"""Numbers of a window's samples that carry a quantity; the speed and the current are those of its motion."""
_OTHERS = ("samples", "commanded", "flown", "missed", "missed²", "V4²", *_CARRIED, "peak")
SUMS: Final = _PAIRS + len(_OTHERS)
"""Number of sums of a slot: the products of the moments over its moving samples, then those of all samples;
the last is no sum but the largest |V4|."""

_VOTERS, _EACH_WAY = 20, 5
_SAMPLES = 75
"""Three quarters of a window's samples at 10 Hz, the lowest rate that networks learn: fewer alias."""
_COMMANDED_DEG, _HELD = 5.0, 0.25
"""A window without motion shows one thing: that the shaft stays behind a command of several degrees."""

_RIDGE = 0.01
"""Of a regressor's variance: a window that hardly excites it gives a small coefficient, not a wild one."""


WINDOW_FEATURES: Final[Mapping[str, tuple[str, ...]]] = {
    "V5 way": ("V5", "V7"),  # current: half the difference of the means forward and backward, A
    "V5 both": ("V5", "V7"),  # current: the middle of the means forward and backward, A
    "V5 rms": ("V5",),  # current, A
    "V5 std": ("V5",),  # current, A
    "V5 work": ("V5", "V7"),  # current, weighted by speed in its direction, A
    "V5|V3 way": ("V3", "V5", "V7"),  # current with the sign of the speed; angle, speed and slope apart, A
    "V5|V3 rest": ("V3", "V5", "V7"),  # what way, angle, speed and slope leave of the current, A
    "V5|V11 way": ("V5", "V7", "V11"),  # current with the sign of the speed; load, speed and slope apart, A
    "V5|V11 load": ("V5", "V7", "V11"),  # current for each newton metre of load, A/(N·m)
    "V5|V11 rest": ("V5", "V7", "V11"),  # what way, load, speed and slope leave of the current, A
    "V11 work": ("V7", "V11"),  # load, weighted by speed in its direction, N·m
    "V11 rms": ("V11",),  # load, N·m
    "V4 way": ("V4", "V7"),  # voltage: half the difference of the means forward and backward, V
    "V4 rms": ("V4",),  # voltage, moving, V
    "V4|V5": ("V4", "V5", "V7"),  # voltage for each ampere; speed apart, Ω
    "V4|V7": ("V4", "V5", "V7"),  # voltage for each 1000 rev/min; current apart, V·min/1000
    "V4 rest": ("V4", "V5", "V7"),  # what current and speed leave of the voltage, V
    "V4 loss": ("V4", "V5"),  # mean of voltage times current, W
    "V7 rms": ("V7",),  # speed, 1000 rev/min
    "gap mean": ("V2", "V3"),  # output shaft's angle less the rotor's through the gear, °
    "gap std": ("V2", "V3"),  # the same, °
    "gap flank": ("V2", "V3", "V5"),  # the same: part with the sign of the current, °
    "flown": ("V1", "V7"),  # path flown for each degree commanded, 1
    "missed mean": ("V1", "V2", "V3"),  # command less angle, °
    "missed std": ("V1", "V3"),  # command less angle, °
    "V4 all rms": ("V4",),  # voltage, at rest or in motion, V
    "V4 peak": ("V4",),  # largest magnitude of the voltage, V
}
"""What each statistic of a window needs, in the order of the columns of :func:`window_features`."""
WINDOW_KEYS: Final = tuple(WINDOW_FEATURES)
_NEEDING = {
    of: [k for k, needs in enumerate(WINDOW_FEATURES.values()) if of in needs] for of in _CARRIED.values()
}


_OF_ALL = {WINDOW_KEYS.index(key) for key in ("flown", "missed mean", "missed std", "V4 all rms", "V4 peak")}
"""Columns of the statistics of all samples; the others are of those in motion."""


def products(moments: Array) -> Array:
    """Return the products of samples' moments, shape (n, pairs), of shape (n, len(MOMENTS))."""
    result: Array = moments[:, _UPPER[0]] * moments[:, _UPPER[1]]
    return result


def of_window(slots: Array) -> Array:
    """Return the sums of windows, shape (k, ``SUMS``), of their slots', shape (k, slots, ``SUMS``)."""
    return np.concatenate([slots[:, :, :-1].sum(axis=1), slots[:, :, -1:].max(axis=1)], axis=1)


def shows_something(sums: Array) -> NDArray[np.bool_]:
    """Return which windows can show a condition, shape (n,), of their sums, shape (n, ``SUMS``).

    Those with twenty samples in motion, five of them either way; and those whose shaft stays behind a
    command of several degrees. An actuator at rest that nothing commands is not asked, nor one that reports
    more rarely than those that networks are trained on.
    """
    moving, way = sums[:, 0], sums[:, 1]
    other = dict(zip(_OTHERS, sums[:, _PAIRS:].T, strict=True))
    in_motion = (moving >= _VOTERS) & (moving - np.abs(way) >= 2 * _EACH_WAY)
    held = (other["commanded"] >= _COMMANDED_DEG) & (other["flown"] < _HELD * other["commanded"])
    return np.asarray((in_motion | held) & (other["samples"] >= _SAMPLES))


def window_features(sums: Array) -> Array:
    """Return the statistics of windows, shape (n, features), of their sums, shape (n, ``SUMS``).

    NaN where a quantity is not measured; a statistic of the motion is 0 where nothing moves.
    """
    count = len(sums)
    gram = np.empty((count, len(MOMENTS), len(MOMENTS)))
    gram[:, _UPPER[0], _UPPER[1]] = gram[:, _UPPER[1], _UPPER[0]] = sums[:, :_PAIRS]
    other = dict(zip(_OTHERS, sums[:, _PAIRS:].T, strict=True))
    moving = gram[:, 0, 0]
    mean = gram / np.maximum(moving, 1.0)[:, None, None]

    def of(left: str, right: str = "1") -> Array:
        return np.asarray(mean[:, _PLACE[left], _PLACE[right]])

    def deviation(square: Array, first: Array) -> Array:
        return np.sqrt(np.maximum(square - first**2, 0.0))

    def ways(name: str) -> tuple[Array, Array]:
        forward = (of(name) + of(name, "way")) / np.maximum(1 + of("way"), 1e-9)
        backward = (of(name) - of(name, "way")) / np.maximum(1 - of("way"), 1e-9)
        return (forward - backward) / 2, (forward + backward) / 2

    def regress(target: str, *regressors: str) -> tuple[Array, Array]:
        return _regression(mean, _PLACE[target], [_PLACE[name] for name in regressors])

    speed = np.maximum(of("V7", "way"), 1e-9)
    ampere_way, ampere_both = ways("V5")
    by_angle, angle_rest = regress("V5", "way", "V3", "V7", "slope")
    by_load, load_rest = regress("V5", "way", "V11", "V7", "slope")
    voltage, voltage_rest = regress("V4", "V5", "V7")
    gap, _ = regress("gap", "flank", "way")
    commands, volts = (np.maximum(other[name], 1.0) for name in ("commands", "volts"))
    missed = other["missed"] / commands
    columns = [
        ampere_way, ampere_both, np.sqrt(of("V5", "V5")), deviation(of("V5", "V5"), of("V5")),
        of("V5", "V7") / speed, by_angle[:, 0], angle_rest, by_load[:, 0], by_load[:, 1], load_rest,
        of("V11", "V7") / speed, np.sqrt(of("V11", "V11")), ways("V4")[0], np.sqrt(of("V4", "V4")),
        voltage[:, 0], voltage[:, 1], voltage_rest, of("V4", "V5"), np.sqrt(of("V7", "V7")),
        of("gap"), deviation(of("gap", "gap"), of("gap")), gap[:, 0],
        other["flown"] / np.maximum(other["commanded"], 1.0), missed,
        deviation(other["missed²"] / commands, missed), np.sqrt(other["V4²"] / volts), other["peak"],
    ]  # fmt: skip
    features = np.stack(columns, axis=1)
    # Sums are 0 also of what the log does not carry, but those of a motion, which are NaN then.
    for name, of_what in _CARRIED.items():
        lacks = 2 * other[name] < other["samples"]
        features[np.ix_(lacks & (moving == 0), _NEEDING[of_what])] = np.nan
        features[np.ix_(lacks, [k for k in _NEEDING[of_what] if k in _OF_ALL])] = np.nan
    return features


def _regression(mean: Array, target: int, regressors: list[int]) -> tuple[Array, Array]:
    """Return coefficients, shape (n, k), and rms of the residuals, (n,), of a ridge on centred moments."""
    places = [*regressors, target]
    first = mean[:, 0, :][:, places]
    covariance = mean[:, places, :][:, :, places] - first[:, :, None] * first[:, None, :]
    k = len(regressors)
    scale = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-12))
    correlation = covariance / (scale[:, :, None] * scale[:, None, :])
    known = np.isfinite(correlation).all(axis=(1, 2))
    result, rest = np.full((len(mean), k), np.nan), np.full(len(mean), np.nan)
    if known.any():
        square = correlation[known]
        left, right = square[:, :k, :k] + _RIDGE * np.eye(k), square[:, :k, k]
        solved = np.linalg.solve(left, right[:, :, None])[:, :, 0]
        result[known] = solved * scale[known][:, k:] / scale[known][:, :k]
        explained = (solved * (2 * right - (square[:, :k, :k] @ solved[:, :, None])[:, :, 0])).sum(axis=1)
        rest[known] = scale[known][:, k] * np.sqrt(np.maximum(square[:, k, k] - explained, 0.0))
    return result, rest
