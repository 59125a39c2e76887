"""Faults of multirotors' motors that are found, and false alarms: simulated, or in logs.

    python -m benchmarks.motors --faults 20 --hours 10 --seed 1 --jobs 2     simulated, fresh seeds by --seed
    python -m benchmarks.motors LOG ...                                      what is said of logs

Each simulated flight is its own craft, plan and seed. A fault comes at 35 to 55 s of 90 s; a healthy flight
lasts 240 s, a third of them drop or shift a payload or meet a strong gust, and 40 % land.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mavhums.health.decision.events import ConditionChanged
from mavhums.health.motor.monitor import MotorMonitor
from mavhums.vehicle.facts import OUTPUTS, Signal
from mavhums.vehicle.grid import Grid
from mavhums.vehicle.parameters import Parameters
from mavhums.vehicle.phases import Phases
from mavhums.vehicle.rotors import Rotors, rotors_of
from mavhums_sim.multirotor.craft import FRAMES, Event, draw_craft, draw_plan
from mavhums_sim.multirotor.flight import Flown, fly
from mavhums_sim.multirotor.log import FUNCTIONS, PARAMETERS, Rates, pulses, sampled

LOSSES = (1.0, 0.7, 0.5, 0.3)
HZ = (2.0, 4.0, 10.0, 25.0, 50.0)
RATES = {"≥ 10 Hz": (10.0, 25.0, 50.0), "4 Hz": (4.0,)}
SIZES = ("quad", "hexa", "octa")


class Case(NamedTuple):
    """One flight, and what was said of it; NaN and 0 where nothing was."""

    frame: str
    hz: float
    loss: float
    motor: int
    fault_s: float
    kind: str
    named: int
    delay_s: float
    share: float
    low: float
    high: float
    several: bool
    flown_s: float
    bound: float
    seed: int


def signals(flown: Flown, rates: Rates, seed: int) -> Iterator[Signal]:
    """Yield what a log of these rates records of a flight."""
    rng = np.random.default_rng([seed, 6])

    def signal(name: str, rate_hz: float, values: np.ndarray) -> Signal:
        time_s, rows = sampled(rng, flown, rate_hz)
        time_us = np.rint(time_s * 1e6).astype(np.int64)
        return Signal(1, name, name, time_us, time_us, values[rows])  # a log in order of time

    outputs = np.full((flown.time_s.size, OUTPUTS), np.nan)
    outputs[:, : flown.command.shape[1]] = pulses(flown.command)
    yield signal("outputs", rates.outputs, outputs)
    yield signal("rates", rates.imu, np.round(flown.rates, 3))
    yield signal("attitude", rates.attitude, flown.attitude)


def rotors(frame: str) -> Rotors:
    kind, type_ = FRAMES[frame].parameters
    known = rotors_of(
        Parameters(1, False, {**PARAMETERS, **FUNCTIONS, "FRAME_CLASS": kind, "FRAME_TYPE": type_})
    )
    assert isinstance(known, Rotors)
    return known


def case(task: tuple[int, str, float, float, str]) -> Case:
    """Fly and judge one flight: its seed, frame, rate of the outputs, loss, and what else happens."""
    seed, frame, hz, loss, kind = task
    rng = np.random.default_rng([seed, 1])
    craft = draw_craft(rng, frame)
    motors = craft.gains.size
    event, seconds = Event(), 240.0
    if loss:
        seconds = 90.0
        event = Event(fault_s=rng.uniform(35, 55), motor=int(rng.integers(motors)), loss=loss)
    elif kind == "payload":
        shift = rng.uniform(-0.15, 0.15, 2)
        event = Event(payload_s=rng.uniform(40, 180), mass=rng.uniform(0.85, 1.25), shift=tuple(shift))
    elif kind == "gust":
        event = Event(gust_s=rng.uniform(40, 180), gust_mps=6.0)
    plan = draw_plan(rng, seconds, event=event, lands=not loss and rng.random() < 0.4)
    flown = fly(craft, plan, seed)
    rates = Rates(outputs=hz, attitude=max(hz, 4.0), imu=max(hz, 10.0))
    grid, monitor = Grid(0), MotorMonitor(1, rotors(frame))
    settled = grid.feed([*signals(flown, rates, seed)], final=True)
    first = None
    for change in monitor.feed(settled, Phases().feed(settled, monitor.rotors)) if settled else ():
        first = first or (change if isinstance(change, ConditionChanged) else None)
    found = monitor.findings()
    said = found.loss
    named = said.motor if said and not found.several else 0
    return Case(
        frame, hz, loss, event.motor + 1 if loss else 0, event.fault_s, kind, named,
        first.time_s - event.fault_s if first and loss else first.time_s if first else np.nan,
        said.share.estimate if said else np.nan, said.share.low if said else np.nan,
        said.share.high if said else np.nan, bool(found.several), float(flown.time_s[-1]),
        max(found.bound), seed,
    )  # fmt: skip


def tasks(seed: int, faults: int, hours: float) -> list[tuple[int, str, float, float, str]]:
    rng = np.random.default_rng([seed, 0])
    frames = list(FRAMES)
    found, n = [], seed * 1_000_000
    for loss in LOSSES if faults else ():
        for frame in frames:
            for hz in sum(RATES.values(), ()):
                for _ in range(faults):
                    n += 1
                    found.append((n, frame, hz, loss, ""))
    for k in range(int(hours * 15)):
        n += 1
        kind = ("", "", "", "", "payload", "gust")[k % 6] if k % 6 != 5 else ("payload", "gust")[k // 6 % 2]
        found.append((n, frames[int(rng.integers(5))], HZ[int(rng.integers(5))], 0.0, kind))
    return found


def share(hits: int, of: int) -> str:
    """Return a share with its 95 % interval by Wilson."""
    if not of:
        return "–"
    p, z = hits / of, 1.96
    middle, half = p + z * z / 2 / of, z * np.sqrt(p * (1 - p) / of + z * z / 4 / of / of)
    low, high = ((middle - half) / (1 + z * z / of), (middle + half) / (1 + z * z / of))
    return f"{p:.2f} ({low:.2f}–{high:.2f})"


def _found(own: Sequence[Case]) -> str:
    """Return how many are rightly named within 0.5, 2 and 30 s, of how many, and the median delay, s."""
    right = [c.delay_s for c in own if c.named == c.motor and c.delay_s >= 0]
    if not own:
        return "–"
    within = ", ".join(str(sum(delay <= limit for delay in right)) for limit in (0.5, 2, 30))
    return f"{within} of {len(own)}" + (f"; {np.median(right):.2f}" if right else "")


def report(cases: Sequence[Case]) -> None:
    """Print what was found of faults, and the false alarms."""
    print(f"| lost thrust | craft | {' | '.join(f'outputs {name}' for name in RATES)} |")
    print("|---" * (2 + len(RATES)) + "|")
    faults = [c for c in cases if c.loss and c.flown_s > c.fault_s]
    for loss in LOSSES:
        for size in SIZES:
            own = [c for c in faults if c.loss == loss and c.frame.startswith(size)]
            cells = [_found([c for c in own if c.hz in rates]) for rates in RATES.values()]
            print(f"| {100 * loss:.0f} % | {size} | {' | '.join(cells)} |")
    wrong = sum(c.named not in (0, c.motor) for c in faults)
    early, several = sum(c.delay_s < 0 for c in faults), sum(c.several for c in faults)
    print(f"\nwrong motor {wrong}, before the fault {early}, more than one {several}, of {len(faults)}")
    right = [c for c in faults if c.named == c.motor and c.delay_s >= 0]
    inside = sum(c.low <= c.loss <= c.high for c in right)
    excluded = sum(c.bound < c.loss for c in faults if not c.named)
    print(f"share lost in its interval {inside} of {len(right)}; unnamed and excluded {excluded}")
    healthy = [c for c in cases if not c.loss]
    hours = sum(c.flown_s for c in healthy) / 3600
    if not healthy:
        return
    false = [c for c in healthy if c.named or c.several]
    print(f"\n{len(false)} false alarms in {hours:.1f} h: {100 * len(false) / hours:.1f} per 100 h")
    for kind in ("", "payload", "gust"):
        own = [c for c in healthy if c.kind == kind]
        h = sum(c.flown_s for c in own) / 3600
        print(f"  {kind or 'neither':8} {sum(c in false for c in own)} in {h:.1f} h")
    for size in SIZES:
        own = [c for c in healthy if c.frame.startswith(size)]
        bounds = np.array([c.bound for c in own if not c.named])
        if not bounds.size:
            continue
        print(
            f"  {size}: {sum(c in false for c in own)} in {sum(c.flown_s for c in own) / 3600:.1f} h; "
            f"losses excluded above: median {np.median(bounds):.2f}, 90 % {np.quantile(bounds, 0.9):.2f}"
        )
    for c in false[:40]:
        print("   ", c)


def of_logs(paths: Sequence[Path]) -> None:
    """Print what is said of logs."""
    import mavhums

    for path in paths:
        for verdict in mavhums.analyse(path).verdicts:
            if verdict.subject == "motor":
                print(path.name, verdict.actuator, verdict.condition, verdict.since, verdict.reason)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("logs", nargs="*", type=Path)
    parser.add_argument("--faults", type=int, default=5, help="of each kind, frame and rate")
    parser.add_argument("--hours", type=float, default=5.0, help="of healthy flight")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--to", type=Path, help="also append each flight's result to this file, as JSON")
    parser.add_argument("--read", type=Path, help="report what was appended to this file")
    options = parser.parse_args()
    if options.logs:
        of_logs(options.logs)
        return
    if options.read:
        report([Case(*json.loads(line)) for line in options.read.read_text().splitlines()])
        return
    todo, cases = tasks(options.seed, options.faults, options.hours), []
    np.random.default_rng(0).shuffle(todo)  # what is done of a run that is stopped is a sample of it
    with ProcessPoolExecutor(options.jobs) as pool:
        for one in pool.map(case, todo, chunksize=8):
            cases.append(one)
            if options.to:
                with options.to.open("a") as file:
                    file.write(json.dumps(one) + "\n")
    report(cases)


if __name__ == "__main__":
    main()
