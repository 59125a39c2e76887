"""A servo whose balance of currents is known exactly, and what a flight of it leaves."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mavhums.actuator.profile import Actuator, load_airframe
from mavhums.core.quantities import column
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.equations.interface import OwnEquation
from mavhums.health.estimation.equations.own_scale import CURRENT
from mavhums.health.estimation.flight_sums import KEPT, OwnSums
from mavhums.health.estimation.least_squares import packed, unpacked
from mavhums.health.estimation.motor_identification import VoltageSums
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums.health.estimation.strokes import StrokeSums
from mavhums.results.verdict import OwnRecord
from tests.health.builders import samples
from tests.present import present

Array = NDArray[np.float64]
EQUATION = CURRENT
NOISE_V = 0.05


def blank() -> Actuator:
    """Return an actuator of which no constant is known."""
    paper = load_airframe("paper").actuators[0]
    return paper.model_copy(update={"ema": None, "limits": None, "travel_deg": None})


@dataclass(frozen=True, slots=True)
class Servo:
    """Friction current and nuisances, and the motor's constants."""

    friction_a: float = 0.05
    drag: float = 2e-4
    inertia: float = 6e-5
    hinge: float = 2e-6
    resistance: float = 20.0
    back_emf: float = 0.015
    drop_v: float = 0.3
    load_friction: float = 0.0

    def flown(
        self, seed: int, *, noise_a: float = 0.002, seconds: float = 100.0, rate_hz: float = 50.0
    ) -> tuple[Array, Array, Array]:
        """Return times, V1…V12 (V1 is noise, V2 and V3 are not measured) and the airspeed."""
        rng = np.random.default_rng(seed)
        count = int(seconds * rate_hz)
        time_s = (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / rate_hz
        tones, phases = np.array([0.11, 0.23, 0.41, 0.67]), rng.uniform(0, 2 * np.pi, 4)
        swing = 60.0 * rng.uniform(0.8, 1.2)
        angle, speed, acceleration = np.zeros((3, time_s.size))
        for tone, phase in zip(2 * np.pi * tones, phases, strict=True):
            angle += swing / tone * np.sin(tone * time_s + phase)
            speed += swing * np.cos(tone * time_s + phase)
            acceleration -= swing * tone * np.sin(tone * time_s + phase)
        airspeed = 25.0 + 3.0 * np.sin(0.05 * time_s + phases[0])
        load = self.hinge * 0.5 * 1.225 * airspeed**2 * angle
        current = self.friction_a * np.sign(speed) + self.drag * speed + self.inertia * acceleration + load
        current += self.load_friction * np.abs(load + 0.02) * np.sign(speed)
        current += 0.02 + noise_a * rng.standard_normal(time_s.size)
        voltage = self.resistance * current + self.back_emf * speed + self.drop_v * np.sign(current)
        known = {"V1": rng.normal(0.0, 30.0, time_s.size), "V4": voltage, "V5": current}
        return time_s, samples(time_s.size, **known, V7=speed * 30.0 / np.pi), airspeed


def collected(
    collector: OwnSums | VoltageSums | StrokeSums,
    flight: tuple[Array, Array, Array | None],
    cuts: tuple[int, ...] = (),
) -> OwnRecord | None:
    """Return what a flight leaves that comes in these pieces."""
    time_s, values, airspeed = flight
    wide = with_extra_columns(values, np.isfinite(values), None, airspeed)
    cutter = SlotCutter()
    pieces = [cutter.feed(time_s[a:b], wide[a:b]) for a, b in pairwise((0, *sorted(cuts), time_s.size))]
    for slots in filter(None, [*pieces, cutter.finish()]):
        collector.feed(slots)
    return collector.record()


def past(*records: OwnRecord, healthy: bool = True) -> list[PastRecord]:
    """Return earlier flights, one a day."""
    return [PastRecord((record,), f"2026-03-{k:02d}", healthy) for k, record in enumerate(records, 1)]


def voltage(
    seed: int, servo: Servo | None = None, *, noise_a: float = 0.0, seconds: float = 100.0
) -> OwnRecord:
    """Return what a flight leaves of the motor's voltage, which is measured with noise."""
    flight = (servo or Servo()).flown(seed, seconds=seconds)
    rng = np.random.default_rng([seed, 5])
    flight[1][:, column("V4")] += NOISE_V * rng.standard_normal(flight[0].size)
    flight[1][:, column("V5")] += noise_a * rng.standard_normal(flight[0].size)
    return present(collected(VoltageSums(blank()), flight))


def scaled(record: OwnRecord, **times: float) -> OwnRecord:
    """Return the record of the same flight with columns of its samples multiplied."""
    scale = np.array([times.get(name, 1.0) for name in KEPT])
    grams = [(row[0], unpacked(row[1:], len(KEPT)) * np.outer(scale, scale)) for row in record.groups]
    return record.model_copy(update={"groups": tuple((count, *packed(gram)) for count, gram in grams)})


def left(servo: Servo, seed: int, equation: OwnEquation = EQUATION, **flight: float) -> OwnRecord:
    """Return what a flight of a servo leaves of an equation."""
    return present(collected(OwnSums(equation, blank()), servo.flown(seed, **flight)))
