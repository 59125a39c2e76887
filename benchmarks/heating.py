"""ESCs that run hot, against the aircraft's earlier flights: simulated, fresh seeds by --seed.

    python -m benchmarks.heating --craft 40 --seed 1 --jobs 2

Flights of 3 to 10 minutes on days of −5 to 38 °C, some with the ESCs still warm, a third with a payload that
is dropped or taken. The first flights of each craft are its history; after them come healthy ones, one in
which the cooling of all ESCs is worse, and flights with a fault of one motor.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np

from benchmarks.motors import rotors, signals
from benchmarks.unbalance import cells, compared, outcome
from mavhums.health.motor.heating import HEATING, EscHeating
from mavhums.health.motor.monitor import MotorMonitor
from mavhums.health.motor.speeds import EscSpeeds
from mavhums.health.motor.vibration import RotorVibration
from mavhums.results.verdict import Verdict
from mavhums.vehicle.grid import Grid
from mavhums.vehicle.phases import Phases
from mavhums_sim.multirotor.craft import Craft, Event, draw_craft, draw_plan
from mavhums_sim.multirotor.flight import fly
from mavhums_sim.multirotor.heating import Escs, draw_escs, temperatures
from mavhums_sim.multirotor.log import Rates
from mavhums_sim.multirotor.vibration import rotor_rpm

FAULTS = {
    "cooling of one ÷ 1.3": (1.3, 0.0),
    "÷ 1.5": (1.5, 0.0),
    "÷ 2": (2.0, 0.0),
    "bearing drags 5 %": (1.0, 0.05),
    "10 %": (1.0, 0.1),
    "20 %": (1.0, 0.2),
}
"""By how many times one ESC is cooled less, and a bearing's torque by the propeller's at full thrust."""
HEALTHY, ALIKE = "healthy", "cooling of all ÷ 1.5"
HISTORIES = (3, 10)
EACH = 10
FRAMES = ("quad x", "quad +", "hexa x", "octa x")


class Flight(NamedTuple):
    """What was wrong, of which motor from 1, for how long, and what the flight alone says of each motor."""

    fault: str
    motor: int
    seconds: float
    verdicts: list[Verdict]


def judged(
    craft: Craft, frame: str, escs: Escs, hindered: tuple[np.ndarray, np.ndarray], number: int
) -> tuple[float, list[Verdict]]:
    """Fly once; return for how long, and the motors with their indicators."""
    rng, seconds = np.random.default_rng([number, 2]), np.random.default_rng([number, 1]).uniform(180, 600)
    event = Event()
    if rng.random() < 1 / 3:
        shift = rng.uniform(-0.1, 0.1, 2)
        event = Event(
            payload_s=rng.uniform(0, seconds), mass=rng.uniform(0.85, 1.25), shift=(shift[0], shift[1])
        )
    flown = fly(craft, draw_plan(rng, seconds, event=event), number)
    blocked, drag = hindered
    thermometer = temperatures(flown, escs, number, blocked=blocked, drag=drag)
    speeds, heating = EscSpeeds(), EscHeating()
    at = np.arange(rng.uniform(0, 0.5), flown.time_s[-1], 0.5)
    for esc, (rpm, celsius) in enumerate(zip(rotor_rpm(flown).T, thermometer(at).T, strict=True)):
        speeds.hear(esc, at, np.interp(at, flown.time_s, rpm) * (1 + rng.normal(0.0, 0.002, at.size)))
        heating.hear(esc, at, celsius)
    monitor = MotorMonitor(1, rotors(frame), (speeds, RotorVibration(), heating))
    rows = Grid(0).feed([*signals(flown, Rates(outputs=10.0), number)], final=True)
    if rows is not None:
        list(monitor.feed(rows, Phases().feed(rows, monitor.rotors)))
    return float(flown.time_s[-1]), [
        Verdict(
            subject="motor", vehicle=1, actuator=f"motor {k}", condition="normal", worst="normal",
            indicators=shown,
        )
        for k, shown in enumerate(monitor.findings().indicators, 1)
    ]  # fmt: skip


def flights(seed: int) -> list[Flight]:
    """Fly and judge all flights of one craft, its history first."""
    rng, frame = np.random.default_rng([seed, 8]), FRAMES[seed % len(FRAMES)]
    craft, found = draw_craft(rng, frame), list[Flight]()
    motors = craft.gains.size
    escs = draw_escs(rng, motors)
    for n, fault in enumerate((*[HEALTHY] * (HISTORIES[-1] + EACH), ALIKE, *FAULTS)):
        motor = int(rng.integers(motors))
        blocked, drag = np.ones(motors) * (1.5 if fault == ALIKE else 1.0), np.zeros(motors)
        blocked[motor], drag[motor] = FAULTS.get(fault, (blocked[motor], 0.0))
        found.append(Flight(fault, motor + 1, *judged(craft, frame, escs, (blocked, drag), 1000 * seed + n)))
    return found


def report(of: Sequence[list[Flight]]) -> None:
    """Print a row for each length of the history: what is found, and the false alarms."""
    for before in HISTORIES:
        said = {fault: Counter[str]() for fault in (HEALTHY, ALIKE, *FAULTS)}
        hours = 0.0
        for own in of:
            past = [one.verdicts for one in own[:before]]
            for one in own[HISTORIES[-1] :]:
                said[one.fault][outcome(compared(one.verdicts, past, HEATING), one.motor)] += 1
                hours += one.seconds / 3600 * (one.fault in (HEALTHY, ALIKE))
        false = sum(n["right"] + n["wrong"] for n in (said.pop(HEALTHY), said.pop(ALIKE)))
        print(f"| {before} | {cells(said.values())} | {false} in {hours:.0f} h |")
    values = [one.indicators[2:] for own in of for flight in own for one in flight.verdicts]
    print(f"{100 * np.mean([bool(shown) for shown in values]):.0f} % of the motors of a flight have a value")
    scatter = [
        np.std(known, ddof=1) / np.mean(known)
        for own in of
        for k in range(len(own[0].verdicts))
        if len(
            known := [
                one.verdicts[k].indicators[-1].value.estimate
                for one in own
                if one.fault == HEALTHY and one.verdicts[k].indicators[2:]
            ]
        )
        > 2
    ]
    print(f"scatter between healthy flights: {np.mean(scatter):.3f}, highest {np.max(scatter):.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--craft", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    print(f"| flights before | {' | '.join(FAULTS)} | false |")
    print("|---" * (2 + len(FAULTS)) + "|")
    with ProcessPoolExecutor(options.jobs) as pool:
        report([*pool.map(flights, range(1000 * options.seed, 1000 * options.seed + options.craft))])


if __name__ == "__main__":
    main()
