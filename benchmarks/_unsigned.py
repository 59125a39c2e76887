"""Friction from magnitudes alone, in little motion: the section ``unsigned`` of ``benchmarks/health.py``.

ESC_TELEMETRY of actuators with stiction, rigid and elastic gears, five modes and four rates. Commands are
smooth, or have the steps of a servo pulse or of an autopilot; k_t, hinge moment, inertia and winding are
individual. The noise is 50 mV, 10 mA and 5 rev/min unless said otherwise. The rules were developed on
seeds from 31,000,000 on; these flights are others.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks._fleet import SURFACES, Task, fly_all
from mavhums import analyse
from mavhums.core.conditions import Condition
from mavhums_sim import EmaParameters, Flight, FlightRecord, write_tlog
from mavhums_sim.cyclogram import Cyclogram
from mavhums_sim.manoeuvres import CYCLOGRAMS
from mavhums_sim.rates import Rates
from mavhums_sim.sensors import SensorNoise

MODES = ("cruise", "turns", "landing", "gusts", "preflight")
RATES_HZ = (10.0, 25.0, 50.0, 100.0)
FRICTION_NM = (0.2, 0.25, 0.35, 0.45, 0.6, 0.75, 0.875, 0.9, 0.95, 1.0, 1.05, 1.1)
DEAD_BANDS_DEG = (0.0, 0.12, 0.4)
CONDITIONS: tuple[Condition, ...] = ("emergency", "degraded", "normal", "undecided")
SEED = 33_000_000
_SMOOTHED = 0.816  # noise left by the simulator's interpolation between samples at 500 Hz


class Variant(NamedTuple):
    """A population of flights: name, seed, size, noise of the current, and R over the data sheet's."""

    name: str
    seed: int
    flights: int
    noise_a: float = 0.01
    resistance: float = 1.0


VARIANTS = (
    Variant("as described", SEED, 540),
    Variant("current's noise 5 mA", SEED + 500_000, 100, noise_a=0.005),
    Variant("current's noise 20 mA", SEED + 600_000, 100, noise_a=0.02),
    Variant("winding warm, R + 12 %", SEED + 700_000, 100, resistance=1.12),
)


@dataclass(frozen=True, slots=True)
class SteppedFlight(Flight):
    """A flight whose commands have steps of this size."""

    dead_band_deg: float = 0.4

    def fly_cyclogram(self) -> Cyclogram:
        return CYCLOGRAMS[str(self.cyclogram)](self.seed, self.duration_s, self.dead_band_deg)


class Row(NamedTuple):
    """The verdict on one actuator, and its true friction."""

    mode: str
    truth: float
    condition: Condition
    worst: Condition
    interval: tuple[float, float, float] | None
    decidable: int
    share: float


def task(variant: Variant, number: int) -> Task:
    rng = np.random.default_rng([variant.seed, number, 77])
    mode, rate_hz = MODES[number % 5], RATES_HZ[number // 5 % 4]
    dead_band_deg = DEAD_BANDS_DEG[rng.integers(3)]
    friction = rng.choice(FRICTION_NM, len(SURFACES)).tolist()
    paper = EmaParameters.from_data_sheet()
    parameters = paper.two_masses() if rng.integers(2) else paper
    scatter = 1.0 + 0.02 * float(np.clip(rng.standard_normal(), -2.5, 2.5))
    flown = SteppedFlight(
        seed=variant.seed + number,
        friction_nm={surface: (f, f) for surface, f in zip(SURFACES, friction, strict=True)},
        rate_hz=500.0,
        noise=SensorNoise(
            voltage_v=0.05 / _SMOOTHED,
            current_a=variant.noise_a / _SMOOTHED,
            rotor_speed_rev_min=5.0 / _SMOOTHED,
        ),
        parameters=replace(parameters, resistance=variant.resistance * parameters.resistance * scatter),
        cyclogram=mode,
        individuals=variant.seed + number,
        rates=Rates(esc=rate_hz, servo_output=min(rate_hz, 50.0)),
        tiers=("esc-unsigned", "pwm"),
        dead_band_deg=dead_band_deg,
    )
    return Task(mode, flown)


def judge(mode: str, record: FlightRecord) -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.tlog"
        write_tlog(record, path)
        verdicts = {verdict.actuator: verdict for verdict in analyse(path).verdicts}
    rows = []
    for surface, flown in record.actuators.items():
        verdict = verdicts[surface]
        friction, coverage = verdict.friction_nm, verdict.coverage
        rows.append(
            Row(
                mode,
                float(flown.motion.friction[-1]),
                verdict.condition,
                verdict.worst,
                (friction.low, friction.estimate, friction.high) if friction else None,
                coverage.decidable,
                coverage.decidable / max(coverage.windows, 1),
            )
        )
    return rows


def described(name: str, rows: list[Row]) -> str:
    """Return a line of the table."""
    if not rows:
        return f"| {name} | 0 |" + " – |" * 9
    said = Counter(row.condition for row in rows)
    conditions = " | ".join(f"{said[condition]}" for condition in CONDITIONS)
    shown = [(row.truth, *row.interval) for row in rows if row.interval]
    below = sum(high < truth for truth, _, _, high in shown)
    above = sum(low > truth for truth, low, _, _ in shown)
    inside = len(shown) - below - above
    bias = np.mean([estimate - truth for truth, _, estimate, _ in shown]) if shown else np.nan
    unfounded = sum(row.condition != "undecided" and not row.decidable for row in rows)
    return (
        f"| {name} | {len(rows)} | {conditions} | {sum(row.worst == 'normal' for row in rows)} | "
        f"{inside} of {len(shown)} ({inside / max(len(shown), 1):.1%}) | {below} / {above} | {bias:+.3f} | "
        f"{unfounded} | {np.mean([row.share for row in rows]):.0%} |"
    )


def unsigned(args: argparse.Namespace) -> Iterator[str]:
    yield (
        f"| flights, truth in N·m | actuators | {' | '.join(CONDITIONS)} | normal at worst | truth in the "
        "95 % interval | below / above the truth | mean error, N·m | condition without a decidable window | "
        "decidable |"
    )
    yield "|---" * 11 + "|"
    for variant in VARIANTS:
        tasks = [task(variant, number) for number in range(args.count(variant.flights))]
        rows = [row for _, found in fly_all(tasks, judge, args.workers) for row in found]
        worn = [row for row in rows if row.truth >= 0.875]
        yield described(f"{variant.name}, ≥ 0.875", worn)
        yield described("the same, 0.45–0.75", [row for row in rows if 0.375 < row.truth < 0.875])
        yield described("the same, ≤ 0.35", [row for row in rows if row.truth <= 0.375])
        if variant is VARIANTS[0]:
            for mode in MODES:
                yield described(f"≥ 0.875, {mode}", [row for row in worn if row.mode == mode])
