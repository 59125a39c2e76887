"""Flights made of the axis equations themselves, row by row: the oracle of effectiveness."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mavhums.health.axis.monitor import AxisMonitor
from mavhums.health.decision.events import ConditionChanged
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows

Array = NDArray[np.float64]

SPEED = 18.0


def changes_of(monitor: AxisMonitor, flight: Rows) -> list[ConditionChanged]:
    return [event for event in monitor.feed(flight) if isinstance(event, ConditionChanged)]


def steady(seconds: int) -> dict[str, Array]:
    """Level flight without wind: what the tests change."""
    n = seconds * RATE_HZ
    zero = np.zeros(n)
    return {
        "roll_rate": zero.copy(),
        "pitch_rate": zero.copy(),
        "yaw_rate": zero.copy(),
        "side_force": zero.copy(),
        "load": zero - 1.0,
        "roll": zero.copy(),
        "pitch": zero.copy(),
        "roll_demand": zero.copy(),
        "pitch_demand": zero.copy(),
        "speed": zero + SPEED,
        "sources": zero.copy(),
        "spacing": zero + 0.1,
        "outputs": np.zeros((n, 3)),
    }


def rows(flight: dict[str, Array], *, first: int = 0, flying: bool = True) -> Rows:
    n = len(flight["speed"])
    up = np.full(n, flying)
    return Rows(
        first, True, **flight, flying=up, up=up, aloft=up, trusted=np.full(n, True), settled=np.full(n, True)
    )


def without_level(values: Array, known: NDArray[np.bool_], memory_s: float) -> Array:
    """Subtract the mean over the last seconds, as pandas has it; NaN where a value is not known."""
    series = pd.Series(np.where(known, values, np.nan))
    share = 1.0 - np.exp(-1.0 / RATE_HZ / memory_s)
    return np.asarray(series - series.ewm(alpha=share, ignore_na=False).mean(), dtype=np.float64)


def excited(seconds: int, seed: int = 1, size: float = 0.15) -> Array:
    """A demand as an autopilot in turbulence gives it: white noise through a lag of half a second."""
    noise = np.random.default_rng(seed).normal(size=seconds * RATE_HZ)
    share = 1 - np.exp(-1 / RATE_HZ / 0.5)
    out = np.zeros_like(noise)
    for k in range(1, noise.size):
        out[k] = out[k - 1] + share * (noise[k] - out[k - 1])
    excited: Array = size * out / out.std()
    return excited


def rolling(
    seconds: int,
    gain: Callable[[Array], Array],
    *,
    noise: float = 0.03,
    delay: int = 4,
    seed: int = 1,
    size: float = 0.15,
) -> Rows:
    """A flight whose roll rate is gain · demand, a fifth of a second late, with noise."""
    flight = steady(seconds)
    demand = excited(seconds, seed, size)
    time_s = np.arange(demand.size) / RATE_HZ
    late = np.concatenate([np.zeros(delay), demand[:-delay]]) if delay else demand
    flight["outputs"][:, 0] = demand
    random = np.random.default_rng(seed + 1).normal(size=demand.size)
    flight["roll_rate"] = gain(time_s) * late + noise * random
    return rows(flight)


def turning(seconds: int, *, spiral: float, every_s: int = 12) -> Rows:
    """Banked turns to one side and the other: the yaw rate r rolls the aircraft by spiral · r as well."""
    flight = steady(seconds)
    side = np.where(np.arange(seconds * RATE_HZ) // (every_s * RATE_HZ) % 2, -1.0, 1.0)
    share = 1 - np.exp(-1 / RATE_HZ / 0.4)
    bank, begun = np.zeros_like(side), np.zeros_like(side)
    for k in range(1, side.size):
        begun[k] = begun[k - 1] + share * (0.75 * side[k] - begun[k - 1])
        bank[k] = bank[k - 1] + share * (begun[k] - bank[k - 1])
    rate = np.gradient(bank, 1 / RATE_HZ)
    yaw = 9.81 / SPEED * np.sin(bank)
    demand = (rate - spiral * yaw) / 2.2
    flight["roll"], flight["roll_rate"], flight["yaw_rate"] = bank, rate, yaw
    flight["outputs"][:, 0] = np.concatenate([demand[4:], np.zeros(4)])
    return rows(flight)
