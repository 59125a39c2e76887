"""Rotors out of balance, against the aircraft's earlier flights: simulated, fresh seeds by --seed.

    python -m benchmarks.unbalance --craft 40 --seed 1 --jobs 2

Each craft has rotors that are out of balance by 3 to 12 µm, and otherwise by 8 % in each flight, as when
propellers are put on anew. Its first flights are its history; after them come healthy ones, and flights of
which one rotor is out of balance by so many times as much.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime

import numpy as np

from benchmarks.motors import rotors, signals
from mavhums.health.decision.baseline import Baseline
from mavhums.health.motor.monitor import MotorMonitor
from mavhums.health.motor.speeds import EscSpeeds
from mavhums.health.motor.vibration import UNBALANCE, RotorVibration
from mavhums.health.verdict.motor import compare_motors
from mavhums.results.verdict import Verdict
from mavhums.vehicle.grid import Grid
from mavhums.vehicle.phases import Phases
from mavhums_sim.multirotor.craft import Craft, draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.log import Rates
from mavhums_sim.multirotor.vibration import rotor_rpm, shaken

TIMES = (1.5, 2.0, 3.0, 5.0)
HISTORIES = (3, 10)
HEALTHY = 20
SECONDS = 90.0
REFITTED = 0.08
SOURCES = {"1 kHz": 1000.0, "200 Hz": 200.0}
FRAMES = ("quad x", "quad +", "hexa x")
_DATE = datetime(2026, 1, 1, tzinfo=UTC)

Flight = tuple[float, int, list[Verdict]]
"""How many times as much, of which motor from 1, and what the flight alone says of each motor."""


def judged(craft: Craft, frame: str, radii: np.ndarray, source: str, number: int) -> list[Verdict]:
    """Fly once, and return the motors with their indicators."""
    flown = fly(craft, draw_plan(np.random.default_rng([number, 2]), SECONDS), number)
    rng, end_s = np.random.default_rng([number, 3]), float(flown.time_s[-1])
    sampled = np.arange(0.0, end_s, 1 / SOURCES[source])
    speeds, vibration = EscSpeeds(), RotorVibration()
    vibration.hear_force("ACC", sampled, shaken(flown, radii, sampled, rng))
    for esc, rpm in enumerate(rotor_rpm(flown).T):
        at = np.arange(rng.uniform(0, 0.1), end_s, 0.1)
        told = np.interp(at, flown.time_s, rpm) * (1 + rng.normal(0.0, 0.002, at.size))
        speeds.hear(esc, at, told)
        vibration.hear_speed(esc, at, told)
    monitor, rates = MotorMonitor(1, rotors(frame), (speeds, vibration)), Rates(outputs=10.0)
    seconds = Grid(0).feed([*signals(flown, rates, number)], final=True)
    if seconds is not None:
        list(monitor.feed(seconds, Phases().feed(seconds, monitor.rotors)))
    return [
        Verdict(
            subject="motor", vehicle=1, actuator=f"motor {k}", condition="normal", worst="normal",
            indicators=shown,
        )
        for k, shown in enumerate(monitor.findings().indicators, 1)
    ]  # fmt: skip


def flights(task: tuple[int, str]) -> list[Flight]:
    """Fly and judge all flights of one craft, its history first: seed and source."""
    seed, source = task
    rng, frame = np.random.default_rng([seed, 8]), FRAMES[seed % 3]
    craft = draw_craft(rng, frame)
    radii, found = rng.uniform(3.0, 12.0, craft.gains.size), list[Flight]()
    for n, times in enumerate((*[1.0] * (HISTORIES[-1] + HEALTHY), *TIMES)):
        motor, own = int(rng.integers(radii.size)), radii * np.exp(rng.normal(0.0, REFITTED, radii.size))
        own[motor] *= times
        found.append((times, motor + 1, judged(craft, frame, own, source, 1000 * seed + n)))
    return found


def compared(flown: list[Verdict], history: Sequence[list[Verdict]], fault: str = UNBALANCE) -> list[int]:
    """Return the motors, from 1, of which the indicator of a fault is said to have grown."""
    known: dict[str, dict[str, Baseline]] = {}
    for k, verdict in enumerate(flown):
        shown = [item for one in history for item in one[k].indicators if item.fault == fault]
        baseline = Baseline.of(shown)
        known[verdict.actuator] = {fault: baseline} if baseline else {}
    told = compare_motors(flown, lambda verdict: known[verdict.actuator], start_utc=_DATE, end_s=SECONDS)
    return [k for k, one in enumerate(told, 1) if any(item.kind == fault for item in one.evidence)]


def outcome(named: list[int], motor: int) -> str:
    """Return whether the right motor is named, a wrong one, or none."""
    return "none" if not named else "right" if named == [motor] else "wrong"


def cells(said: Iterable[Counter[str]]) -> str:
    """Return the cells of a row: of each kind of flight how many name the right motor, and a wrong one."""
    each = (f"{n['right']} of {n.total()}" + f", {n['wrong']} wrong" * bool(n["wrong"]) for n in said)
    return " | ".join(each)


def report(source: str, of: Sequence[list[Flight]]) -> None:
    """Print a row for each length of the history: what is found, and the false alarms."""
    for before in HISTORIES:
        said: dict[float, Counter[str]] = {times: Counter() for times in (1.0, *TIMES)}
        for own in of:
            past = [verdicts for _, _, verdicts in own[:before]]
            for times, motor, verdicts in own[HISTORIES[-1] :]:
                said[times][outcome(compared(verdicts, past), motor)] += 1
        healthy = said.pop(1.0)
        hours, false = healthy.total() * SECONDS / 3600, healthy["right"] + healthy["wrong"]
        print(f"| {source} | {before} | {cells(said.values())} | {false} in {hours:.0f} h |")
    every = [bool(one.indicators[2:]) for own in of for _, _, verdicts in own for one in verdicts]
    print(f"{source}: {100 * np.mean(every):.0f} % of the motors of a flight have a value")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--craft", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    print(f"| samples | flights before | {' | '.join(f'× {times:g}' for times in TIMES)} | false |")
    print("|---" * (3 + len(TIMES)) + "|")
    with ProcessPoolExecutor(options.jobs) as pool:
        for source in SOURCES:
            tasks = [(1000 * options.seed + k, source) for k in range(options.craft)]
            report(source, [*pool.map(flights, tasks)])


if __name__ == "__main__":
    main()
