"""Flights whose own-scale records ``benchmarks/own_history.py`` compares."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

import mavhums_sim.flight
from benchmarks._fleet import ACTUATORS, MODES, added, flight
from mavhums.core.arrays import Array
from mavhums.health.estimation.equations import OWN_EQUATIONS
from mavhums.health.estimation.equations.interface import OwnEquation
from mavhums.health.estimation.flight_sums import KEPT, OwnSums
from mavhums.health.estimation.least_squares import packed, unpacked
from mavhums.health.estimation.motor_identification import VoltageSums
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums.results.verdict import OwnRecord
from mavhums_sim import FlightRecord, fly
from mavhums_sim.flight import ActuatorRecord
from mavhums_sim.motion import simulate

BLANK = {
    surface: actuator.model_copy(update={"ema": None, "limits": None, "travel_deg": None})
    for surface, actuator in ACTUATORS.items()
}
_BY_NAME = {equation.name: equation for equation in OWN_EQUATIONS}
_STEP_S = 5e-4  # of the physics: five times as fast as 0.1 ms, and the gear's wind-up still resolved
_PULSE_DEG = 0.12


@dataclass(frozen=True, slots=True)
class Tier:
    """What is measured, how often, and by which equation it is judged."""

    equation: OwnEquation
    every: int
    airspeed: bool = True
    command: bool = False

    @property
    def rate_hz(self) -> float:
        return 100.0 / self.every


TIERS = {
    "motor, 100 Hz": Tier(_BY_NAME["own_current"], 1),
    "motor, 50 Hz": Tier(_BY_NAME["own_current"], 2),
    "motor, 25 Hz": Tier(_BY_NAME["own_current"], 4),
    "motor, 50 Hz, no airspeed": Tier(_BY_NAME["own_current"], 2, airspeed=False),
    "position, 50 Hz": Tier(_BY_NAME["own_tracking"], 2, command=True),
    "position, 25 Hz": Tier(_BY_NAME["own_tracking"], 4, command=True),
}


@dataclass(frozen=True, slots=True)
class Task:
    """One flight of several aircraft through the same air: what they have, and which tiers are kept."""

    kind: str
    number: int
    fault: str
    severity: float
    aircraft: tuple[int, ...]
    tiers: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Row:
    """What one actuator's flight left.

    ``rise`` is that of its friction, as a share of its healthy one; ``voltage`` is what the motor side leaves
    of the voltage equation.
    """

    kind: str
    number: int
    actuator: tuple[int, str]
    tier: str
    record: OwnRecord | None
    rise: float = 0.0
    voltage: OwnRecord | None = None


def flown(tasks: list[Task], workers: int) -> Iterator[Row]:
    """Fly on all workers, and yield what is left of each actuator's flight."""
    from rich.progress import track

    with ProcessPoolExecutor(workers) as pool:
        results = pool.map(_rows, tasks)
        for rows in track(results, total=len(tasks), description=f"{len(tasks)} flights"):
            yield from rows


def _rows(task: Task) -> list[Row]:
    mavhums_sim.flight.simulate = partial(simulate, step_s=_STEP_S)  # type: ignore[attr-defined]
    rows, cyclogram = [], None
    mode = MODES[task.number % len(MODES)]
    for aircraft in task.aircraft:
        planned = flight(
            task.number,
            aircraft,
            rate_hz=100.0,
            mode=cyclogram or mode,  # type: ignore[arg-type]
            conditions=added(task.fault, task.severity),
        )
        record = fly(planned)
        cyclogram = record.cyclogram
        for surface, own in record.actuators.items():
            more = task.severity if task.fault == "friction" else 0.0
            rise = more / (float(own.motion.friction[0]) - more)
            for name in task.tiers:
                left, voltage = _records(TIERS[name], record, own, surface, task.number)
                rows.append(Row(task.kind, task.number, (aircraft, surface), name, left, rise, voltage))
    return rows


def _records(
    tier: Tier, record: FlightRecord, own: ActuatorRecord, surface: str, number: int
) -> tuple[OwnRecord | None, OwnRecord | None]:
    """Return what a flight leaves in a tier: V1 in pulses, V7 in whole rev/min, airspeed at 10 Hz."""
    some = slice(None, None, tier.every)
    time_s, true = own.time_s[some], own.values[some]
    values = np.full_like(true, np.nan)
    values[:, 0] = np.rint(true[:, 0] / _PULSE_DEG) * _PULSE_DEG
    if tier.command:
        values[:, 2] = true[:, 2]
    else:
        values[:, [3, 4]] = own.esc[some, :2].astype(np.float32)
        values[:, 6] = np.rint(own.esc[some, 2])
    airspeed = _airspeed(record, time_s, number) if tier.airspeed else None
    actuator = BLANK[surface]
    sums, volts, cutter = OwnSums(tier.equation, actuator), VoltageSums(actuator), SlotCutter()
    for slots in (
        cutter.feed(time_s, with_extra_columns(values, np.isfinite(values), None, airspeed)),
        cutter.finish(),
    ):
        if slots is not None:
            sums.feed(slots)
            volts.feed(slots)
    return sums.record(), volts.record()


def _airspeed(record: FlightRecord, time_s: Array, number: int) -> Array:
    rng = np.random.default_rng([number, 12])
    at_s = np.arange(0.0, time_s[-1] + 0.1, 0.1)
    sensed = np.interp(at_s, record.cyclogram.time_s, record.cyclogram.airspeed)
    sensed = np.maximum(sensed + 0.3 * rng.standard_normal(at_s.size), 0.0)
    held: Array = sensed[np.maximum(np.searchsorted(at_s, time_s, side="right") - 1, 0)]
    return held


def scattered(record: OwnRecord, by: float) -> OwnRecord:
    """Return the record that the flight would have left with so much more friction."""
    rows = np.array(record.groups)
    size = len(KEPT)
    more = np.eye(size)
    more[KEPT.index("sign"), -1] += by
    grams = [more.T @ unpacked(row[1:], size) @ more for row in rows]
    groups = tuple((float(row[0]), *packed(gram)) for row, gram in zip(rows, grams, strict=True))
    return record.model_copy(update={"groups": groups})
