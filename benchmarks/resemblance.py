"""Comparison of closed-loop flights with real ones.

    python benchmarks/resemblance.py                                  # the simulator's, 4 Hz
    python benchmarks/resemblance.py --outputs 6,2,4 --travel 400 alfa/*_no_failure.tlog

Per flight, from ordinary messages: excitation, roll rate per aileron and its lag, tracking, turbulence.
Median and range over the flights.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

import mavhums
from benchmarks._closed_loop import Planned, healthy
from mavhums.core.arrays import Array
from mavhums_sim.closed_loop.outputs import Outputs

STEP_S, SETTLED_S = 0.1, 25.0
LAGS_S = np.arange(0.0, 0.8, 0.04)
TRACKING_S = np.arange(0.0, 2.0, 0.1)
ROWS = {
    "airspeed, m/s; its SD": ("speed, m/s", "speed SD, m/s"),
    "roll rate per full aileron, rad/s": ("roll rate per full aileron, rad/s",),
    "R² of roll rate by aileron": ("its R²",),
    "lag of roll rate, s": ("its lag, s",),
    "SD of aileron; elevator, share of travel": ("aileron SD", "elevator SD"),
    "10 s windows with SD ≥ 0.05": ("10 s windows with SD ≥ 0.05",),
    "rudder–aileron correlation": ("rudder–aileron correlation",),
    "p; q SD, rad/s": ("p SD, rad/s", "q SD, rad/s"),
    "vertical; lateral acceleration SD, g": ("vertical acceleration SD, g", "lateral acceleration SD, g"),
    "roll error SD, °; lag, s": ("roll error SD, °", "roll lag, s"),
    "pitch error SD, °; lag, s": ("pitch error SD, °", "pitch lag, s"),
}


class Signals:
    """Signals of one log at 10 Hz, from 25 s after the start of flight to 5 s before its end."""

    def __init__(self, path: Path) -> None:
        self._messages = mavhums.read_log(path).messages
        speed_at, ground = self.raw("VFR_HUD", "groundspeed")
        air = self.raw("VFR_HUD", "airspeed")[1]
        self.speed_name = "airspeed" if np.median(air) > 3.0 else "groundspeed"
        moving = speed_at[(air if self.speed_name == "airspeed" else ground) > 10.0]
        self.grid = np.arange(moving[0] + SETTLED_S, moving[-1] - 5.0, STEP_S) if moving.size else np.empty(0)

    def raw(self, message: str, field: str) -> tuple[Array, Array]:
        table = self._messages[message]
        times = pd.DatetimeIndex(table.index).tz_localize(None).to_numpy(dtype="datetime64[ns]")
        return times.astype(np.int64) / 1e9, table[field].to_numpy(dtype=np.float64)

    def at(self, message: str, field: str, late_s: float = 0.0) -> Array:
        times, values = self.raw(message, field)
        return np.interp(self.grid - late_s, times, values)


def describe(
    path: Path, outputs: tuple[int, int, int], trim: float, half: float, sign: float
) -> dict[str, float]:
    """Return the statistics of one flight; empty if it is too short."""
    signals = Signals(path)
    if signals.grid.size < 200:
        return {}
    aileron, elevator, rudder = (f"servo{n}_raw" for n in outputs)
    speed = signals.at("VFR_HUD", signals.speed_name)
    relative = speed / speed.mean()
    p = np.convolve(signals.at("RAW_IMU", "xgyro") / 1000.0, np.ones(6) / 6.0, "same")
    fits = []
    for lag in LAGS_S:
        demand = sign * (signals.at("SERVO_OUTPUT_RAW", aileron, lag) - trim) / half
        demand = np.convolve(demand, np.ones(6) / 6.0, "same")
        causes = np.stack([relative * demand, relative], axis=1)
        found = np.linalg.lstsq(causes, p, rcond=None)[0]
        fits.append((1.0 - np.var(p - causes @ found) / np.var(p), lag, found[0]))
    explained, lag, gain = max(fits)
    demand = (signals.at("SERVO_OUTPUT_RAW", aileron) - trim) / half
    windows = [demand[k : k + 100].std() for k in range(0, demand.size - 100, 100)]
    roll, pitch = signals.at("ATTITUDE", "roll"), signals.at("ATTITUDE", "pitch")
    nav_roll, nav_pitch = (
        np.radians(signals.at("NAV_CONTROLLER_OUTPUT", f"nav_{n}")) for n in ("roll", "pitch")
    )
    return {
        "speed, m/s": speed.mean(),
        "speed SD, m/s": speed.std(),
        "roll rate per full aileron, rad/s": gain,
        "its R²": explained,
        "its lag, s": lag,
        "aileron SD": demand.std(),
        "10 s windows with SD ≥ 0.05": float(np.mean(np.array(windows) >= 0.05)),
        "elevator SD": signals.at("SERVO_OUTPUT_RAW", elevator).std() / half,
        "rudder–aileron correlation": abs(_correlation(demand, signals.at("SERVO_OUTPUT_RAW", rudder))),
        "p SD, rad/s": p.std(),
        "q SD, rad/s": float(np.std(signals.at("RAW_IMU", "ygyro"))) / 1000.0,
        "vertical acceleration SD, g": float(np.std(signals.at("RAW_IMU", "zacc"))) / 1000.0,
        "lateral acceleration SD, g": float(np.std(signals.at("RAW_IMU", "yacc"))) / 1000.0,
        "roll error SD, °": float(np.degrees((nav_roll - roll).std())),
        "roll lag, s": _lag(nav_roll, roll),
        "pitch error SD, °": float(np.degrees((nav_pitch - pitch).std())),
        "pitch lag, s": _lag(nav_pitch, pitch),
    }


def _correlation(one: Array, other: Array) -> float:
    return float(np.corrcoef(one, other)[0, 1]) if one.std() > 0 and other.std() > 0 else 0.0


def _lag(demanded: Array, flown: Array) -> float:
    """Return the delay at which the flown attitude correlates best with the demanded one, s."""
    n = demanded.size - 20
    return max((_correlation(demanded[:n], flown[round(d / STEP_S) :][:n]), float(d)) for d in TRACKING_S)[1]


def simulated(count: int) -> Iterator[dict[str, float]]:
    """Yield the statistics of healthy flights as ArduPlane reports them at 4 Hz."""
    with TemporaryDirectory() as folder:
        for planned in list(healthy(count / 4.0, seed=77))[:count]:
            flight = replace(planned.flight, layout="conventional", flavour="ardupilot", duration_s=600.0)
            labelled = Planned(planned.name, flight, 4.0).fly()
            path = Path(folder) / "flight.tlog"
            path.write_bytes(labelled.tlog)
            outputs = Outputs.of(labelled.flown)
            sign = -1.0 if outputs.reversed_[0] else 1.0
            yield describe(path, (1, 3, 4), float(outputs.trim[0]), float(outputs.half_range[0]), sign)


def show(whose: str, flights: list[dict[str, float]]) -> None:
    """Print the medians of the flights, of single quantities their ranges, too."""
    flights = [flight for flight in flights if flight]
    print(f"| | {whose} |\n|---|---|")
    for title, names in ROWS.items():
        values = [[flight[name] for flight in flights] for name in names]
        cells = [f"{np.median(several):.2f}" for several in values]
        if len(values) == 1:
            cells[0] += f" ({min(values[0]):.2f}…{max(values[0]):.2f})"
        print(f"| {title} | {'; '.join(cells)} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("logs", nargs="*", type=Path)
    parser.add_argument("--outputs", default="1,2,4", help="of aileron, elevator, rudder")
    parser.add_argument("--travel", type=float, default=500.0, help="µs from 1500 to full deflection")
    parser.add_argument("--flights", type=int, default=12, help="simulated, where no log is given")
    arguments = parser.parse_args()
    first, second, third = (int(n) for n in arguments.outputs.split(","))
    if arguments.logs:
        own = [describe(p, (first, second, third), 1500.0, arguments.travel, 1.0) for p in arguments.logs]
        show(f"{len(own)} logs", own)
    else:
        show("closed loop", list(simulated(arguments.flights)))


if __name__ == "__main__":
    main()
