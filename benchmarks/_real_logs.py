"""Recordings of real actuators as telemetry logs, for ``benchmarks/real_actuators.py``.

A folder holds ``*.parquet`` with ``*_meta.parquet`` (bus servos under a pendulum) and ``cranfield/*.csv.gz``
(screw rig).
"""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from mavhums.health.estimation.motion import angle_speed

Array = NDArray[np.float64]

GRAVITY = 9.81
EPOCH_US = 1_750_000_000_000_000
FLIGHT_APART_S = 3600.0
RUN_APART_S = 1.0  # between the recordings of one flight, whose ends do not meet
REV_MIN = 60 / (2 * np.pi)
DUTY_STEPS = 885  # of the full supply, of a Dynamixel X
CURRENTS = ("sensor", "sensor with V11", "sensor, magnitude", "register", "register, signed", "none")
"""How a log of the servo carries its current: a sensor's, its magnitude, the register's, none."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """Data sheet of a servo; ``constant`` (V·s/rad and N·m/A at the shaft) is of its no-load row."""

    gear_ratio: float
    constant: float
    resistance: float
    stall_nm: float
    supply_v: float


SHEETS = {
    "sts3215": Sheet(345.0, 2.377, 12.0 / 2.7, 2.94, 12.0),
}
"""Data sheets by the name of the recording; another servo's constants are identified from its flights."""
GEAR_RATIO = 345.0  # of a servo without a sheet: only its product with the motor's constant counts
SUPPLY_V = 12.0


class Friction(NamedTuple):
    """Coefficients of V = r·τ + j·dw/dt + (F_c + m·|τ|)·sgn w + k·w + c; μ = m/r, T_c = F_c/r."""

    volts_per_nm: float
    inertia_v: float
    by_load_v: float
    constant_v: float
    back_emf: float
    offset_v: float

    def sheet(self) -> Sheet:
        """Return the constants of the data sheet that give these."""
        resistance = self.volts_per_nm * self.back_emf
        return Sheet(GEAR_RATIO, self.back_emf, resistance, SUPPLY_V / self.volts_per_nm, SUPPLY_V)


class Flight(NamedTuple):
    """One flight: time, s, and V1…V12 without the current, shapes (n,) and (n, 12); the pendulum's load, N·m,
    and inertia, kg·m²."""

    number: int
    case: int
    rep: int
    time_s: Array
    values: Array
    register_a: Array
    true_load: Array
    inertia: float

    def geared(self, ratio: float) -> Flight:
        """Return the flight of a servo whose gear has this ratio."""
        values = self.values.copy()
        values[:, 6] *= ratio / GEAR_RATIO
        return self._replace(values=values)


def fitted(flights: Sequence[Flight]) -> Friction:
    """Return friction and motor of a servo from all its flights, whose load torque is known."""
    rows, left = [], []
    for flight in flights:
        angle, volts = np.radians(flight.values[:, 2]), flight.values[:, 3]
        speed = angle_speed(flight.time_s, angle, 0.04)
        rate = np.gradient(speed, flight.time_s)
        steady = (np.abs(speed) > 0.2) & (np.abs(rate) < 15.0) & (np.abs(volts) < 0.95 * SUPPLY_V)
        steady &= np.gradient(flight.time_s) < 0.05
        load, way = flight.true_load, np.sign(speed)
        terms = np.stack(
            [load + flight.inertia * rate, rate, np.abs(load) * way, way, speed, np.ones(load.size)], axis=1
        )
        rows.append(terms[steady])
        left.append(volts[steady])
    return Friction(*np.linalg.lstsq(np.concatenate(rows), np.concatenate(left))[0].tolist())


def register_rates(rows: pd.DataFrame) -> dict[str, float]:
    """Return the changes a second of each register while the servo moves."""
    moves = (rows["speed"].abs() > 0.2) & (rows["run"] == rows["run"].shift())
    seconds = float(rows["time"].diff()[moves].sum())
    names = [name for name in ("position", "duty", "speed", "voltage", "current") if name in rows]
    return {name: float((rows[name].diff()[moves] != 0.0).sum()) / seconds for name in names}


def profile(sheet: Sheet | None, *, friction: str = "") -> str:
    """Return the airframe profile of one servo; ``friction`` are further keys of ``[actuators.ema]``."""
    text = (
        'name = "bench"\n[[actuators]]\nname = "servo"\nservo = 1\nesc = 0\npwm_us = [1000, 1500, 2000]\n'
        "travel_deg = [-180.0, 180.0]\nmoving_speed_deg_s = 12.0\n"
    )
    if sheet is None:
        return text
    # Limits are the paper's shares of the torque at stall; inertia is the pendulum's, which cases change.
    n = sheet.gear_ratio
    return text + (
        f"[actuators.ema]\ngear_ratio = {n}\ntorque_constant = {sheet.constant / n}\n"
        f"resistance = {sheet.resistance}\ninertia = {0.02 / n**2}\ninertia_uncertainty = 2.0\n"
        f"torque_uncertainty = 0.1\nsupply_voltage = {sheet.supply_v}\n{friction}"
        f"[actuators.limits]\nnormal = {0.075 * sheet.stall_nm}\nemergency = {0.175 * sheet.stall_nm}\n"
    )


def servos(folder: Path) -> dict[str, tuple[pd.DataFrame, pd.DataFrame]]:
    """Return recordings and their meta data by the name of the servo."""
    names = [path.name.removesuffix("_meta.parquet") for path in sorted(folder.glob("*_meta.parquet"))]
    return {
        name: (pd.read_parquet(folder / f"{name}.parquet"), pd.read_parquet(folder / f"{name}_meta.parquet"))
        for name in names
    }


def servo_flights(rows: pd.DataFrame, meta: pd.DataFrame, gear_ratio: float) -> Iterator[Flight]:
    """Yield the flights of a servo: the runs of one arm, weight and repetition, one after another.

    Rows with the torque off (a limp arm) and with read errors are left out, as a driver would.
    """
    by_run = dict(iter(rows.groupby("run")))
    for number, runs in meta.groupby("flight"):
        parts, first = [], runs.iloc[0]
        for k, run in enumerate(runs.sort_values("run")["run"]):
            own = by_run[run]
            angle = own["position"].to_numpy()
            read = np.abs(angle - np.median(angle)) < 3.0
            read &= ~((angle < -3.13) & (np.abs(np.gradient(angle)) > 0.3))
            read &= own["voltage"].between(9.0, 14.0).to_numpy() & own["torque_enable"].to_numpy()
            own = own[read]
            parts.append(own.assign(time=own["time"] + k * (6.0 + RUN_APART_S)))
        whole = pd.concat(parts)
        values = np.full((len(whole), 12), np.nan)
        values[:, 0] = np.degrees(whole["goal_position"])
        values[:, 2] = np.degrees(whole["position"])
        values[:, 3] = whole["duty"] * whole["voltage"]
        values[:, 6] = whole["speed"] * REV_MIN * gear_ratio
        arm = first["mass"] * first["length"] + first["arm_mass"] * first["length"] / 2
        load = arm * GRAVITY * np.sin(whole["position"].to_numpy(dtype=np.float64))
        time_s = whole["time"].to_numpy(dtype=np.float64)
        yield Flight(
            int(str(number)), int(first["case"]), int(first["rep"]), time_s, values,
            whole["current"].to_numpy(dtype=np.float64), load,
            first["mass"] * first["length"] ** 2 + first["arm_mass"] * first["length"] ** 2 / 3,
        )  # fmt: skip


def pendulum_runs(folder: Path) -> Iterator[tuple[str, Flight]]:
    """Yield the runs of a Dynamixel XL330-M288 under a pendulum, each with its motion and gain.

    Rows with the torque off are left out. The register of the duty is a signed 16-bit number, read unsigned.
    """
    for number, path in enumerate(sorted(folder.glob("*.json.gz"))):
        with gzip.open(path) as file:
            run = json.load(file)
        rows = pd.DataFrame(run["entries"]).query("torque_enable")
        duty = rows["load"].to_numpy(dtype=np.int64).astype(np.int16) / DUTY_STEPS
        values = np.full((len(rows), 12), np.nan)
        values[:, 0] = np.degrees(rows["goal_position"])
        values[:, 2] = np.degrees(rows["position"])
        values[:, 3] = duty * rows["input_volts"]
        values[:, 6] = rows["speed"] * REV_MIN * GEAR_RATIO
        load = run["mass"] * run["length"] * GRAVITY * np.sin(rows["position"].to_numpy(dtype=np.float64))
        time_s, none = rows["timestamp"].to_numpy(dtype=np.float64), np.full(len(rows), np.nan)
        flight = Flight(number, 0, 0, time_s, values, none, load, run["mass"] * run["length"] ** 2)
        yield f"{run['trajectory']}, gain {run['kp']}", flight


def with_current(flight: Flight, kind: str, sheet: Sheet) -> Array:
    """Return V1…V12 with the current of this kind."""
    values = flight.values.copy()
    rng = np.random.default_rng([34, flight.number])
    true = (values[:, 3] - sheet.constant / sheet.gear_ratio / REV_MIN * values[:, 6]) / sheet.resistance
    # No register gives a true current: what a sensor of 10 mA noise would have shown.
    sensor = true + rng.normal(0.0, 0.01, true.size)
    if kind.startswith("sensor"):
        values[:, 4] = np.abs(sensor) if "magnitude" in kind else sensor
        values[:, 10] = flight.true_load if "V11" in kind else np.nan
    elif kind.startswith("register"):
        values[:, 4] = flight.register_a * (np.sign(values[:, 3]) if "signed" in kind else 1.0)
    return values


def write_log(path: Path, number: int, time_s: Array, values: Array) -> Path:
    """Write samples as a ``.tlog`` with DEBUG_FLOAT_ARRAY named EMA."""
    begin_us = EPOCH_US + round(number * FLIGHT_APART_S * 1e6)
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    spare, heartbeat = [0.0] * 46, mavlink.MAVLink_heartbeat_message(1, 3, 209, 10, 4, 3)
    beat = -1
    with path.open("wb") as file:
        for at, row in zip(time_s.tolist(), values.tolist(), strict=True):
            us = round(at * 1e6)
            messages = [mavlink.MAVLink_debug_float_array_message(1_000_000 + us, b"EMA", 1, row + spare)]
            if int(at) > beat:
                beat = int(at)
                messages.insert(0, heartbeat)
            for message in messages:
                file.write(struct.pack(">Q", begin_us + us) + message.pack(link))
                link.seq = (link.seq + 1) % 256
    return path
