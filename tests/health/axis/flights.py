"""Flights made of the axis equations themselves, row by row: the oracle of effectiveness."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import lfilter

from mavhums.health.axis.monitor import AxisMonitor
from mavhums.health.decision.events import ConditionChanged
from mavhums.vehicle.grid import RATE_HZ
from mavhums.vehicle.rows import Rows

Array = NDArray[np.float64]

SPEED = 18.0
STILL = ("roll_rate", "pitch_rate", "yaw_rate", "roll", "pitch", "roll_demand", "pitch_demand")


def changes_of(monitor: AxisMonitor, flight: Rows) -> list[ConditionChanged]:
    return [event for event in monitor.feed(flight) if isinstance(event, ConditionChanged)]


def steady(seconds: int) -> dict[str, Array]:
    """Level flight without wind: what the tests change."""
    n = seconds * RATE_HZ
    still = {name: np.zeros(n) for name in (*STILL, "side_force", "sources", "force_source")}
    level = {"load": np.full(n, -1.0), "speed": np.full(n, SPEED), "spacing": np.full(n, 0.1)}
    level |= {name: np.full(n, 0.1) for name in ("demand_spacing", "force_spacing")}
    return still | level | {"outputs": np.zeros((n, 3))}


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


def lagged(values: Array, tau_s: float, start: float = 0.0) -> Array:
    """Return what follows values through a first-order lag, from a start on."""
    share = 1 - np.exp(-1 / RATE_HZ / tau_s)
    return np.asarray(start + lfilter([share], [1.0, share - 1.0], values - start))


def late(values: Array, delay: int = 4) -> Array:
    """Return values that come so many rows later, and nothing before."""
    return np.concatenate([np.zeros(delay), values[: values.size - delay]])


def excited(seconds: int, seed: int = 1, size: float = 0.15) -> Array:
    """A demand as an autopilot in turbulence gives it: white noise through a lag of half a second."""
    noise = np.random.default_rng(seed).normal(size=seconds * RATE_HZ)
    noise[0] = 0.0
    out = lagged(noise, 0.5)
    return np.asarray(size * out / out.std())


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
    flight["outputs"][:, 0] = demand
    random = np.random.default_rng(seed + 1).normal(size=demand.size)
    flight["roll_rate"] = gain(time_s) * late(demand, delay) + noise * random
    return rows(flight)


def turning(seconds: int, *, spiral: float, every_s: int = 12) -> Rows:
    """Banked turns to one side and the other: the yaw rate r rolls the aircraft by spiral · r as well."""
    flight = steady(seconds)
    side = np.where(np.arange(seconds * RATE_HZ) // (every_s * RATE_HZ) % 2, -1.0, 1.0)
    side[0] = 0.0
    bank = lagged(lagged(0.75 * side, 0.4), 0.4)
    rate = np.gradient(bank, 1 / RATE_HZ)
    yaw = 9.81 / SPEED * np.sin(bank)
    demand = (rate - spiral * yaw) / 2.2
    flight["roll"], flight["roll_rate"], flight["yaw_rate"] = bank, rate, yaw
    flight["outputs"][:, 0] = np.concatenate([demand[4:], np.zeros(4)])
    return rows(flight)
