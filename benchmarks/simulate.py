"""Speed of the simulator: ``python benchmarks/simulate.py [--quick]``.

Simulated seconds per wall second of each model on one core, then flights of 100 s with four
actuators as arrays and as logs, on one core and on two, and the aircraft in closed loop.
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from mavhums_sim import EmaParameters, Flight, FlightRecord, simulate, write_tlog
from mavhums_sim.campaign import consume
from mavhums_sim.closed_loop import Air, ClosedLoop, fly_closed_loop
from mavhums_sim.closed_loop.encode import encode
from mavhums_sim.closed_loop.reports import report
from mavhums_sim.ema import FrictionMethod

SECONDS = 100.0


def models(runs: int) -> None:
    """Best of several runs of one actuator, 100 s, waves against a hinge moment."""
    n = 100_000
    at = np.arange(n) * 1e-3
    command = np.radians(15 * np.sin(2 * np.pi * 0.25 * at) + 5 * np.sin(2 * np.pi * 0.63 * at))
    inputs = command, np.full(n, 0.225), np.full(n, 5.6), np.full(n, 0.5)
    paper = EmaParameters.from_data_sheet()
    methods: tuple[FrictionMethod, ...] = ("impulse", "karnopp")
    print("\nmodel        friction  step ms  simulated s per wall s   per CPU s (one core)")
    for name, parameters in (("one mass", paper), ("two masses", paper.two_masses())):
        for method in methods:
            for step in (1e-4, 1e-3):
                actuator = replace(parameters, friction_method=method)
                simulate(actuator, inputs[0][:2], inputs[1][:2], inputs[2][:2], inputs[3][:2], step_s=step)
                walls, busy = [], []
                for _ in range(runs):
                    begin, used = time.perf_counter(), time.process_time()
                    simulate(actuator, *inputs, step_s=step)
                    walls.append(time.perf_counter() - begin)
                    busy.append(time.process_time() - used)
                speeds = f"{SECONDS / min(walls):22,.0f} {SECONDS / min(busy):12,.0f}"
                print(f"{name:12} {method:9} {step * 1e3:7.1f}  {speeds}")


def peak_current(name: str, record: FlightRecord) -> float:
    """Imitate a consumer that keeps little of the arrays."""
    return max(float(np.abs(actuator.values[:, 4]).max()) for actuator in record.actuators.values())


def log(name: str, record: FlightRecord, *, folder: Path) -> int:
    return sum(write_tlog(record, folder / f"{name}.tlog").values())


def flights(arrays: int, logs: int) -> None:
    """Wall time of campaigns on one process and on two, start of the processes included."""
    print("\nflights of 100 s, 4 actuators   processes   wall s   flight s per wall s")
    walls: dict[tuple[str, int], float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for what, count, consumer in (
            ("arrays", arrays, peak_current),
            ("logs", logs, partial(log, folder=Path(folder))),
        ):
            for workers in (1, 2):
                planned = [(str(seed), Flight(seed=seed)) for seed in range(count)]
                begin = time.perf_counter()
                for _ in consume(planned, consumer, workers):
                    pass
                wall = walls[what, workers] = time.perf_counter() - begin
                speed = count * SECONDS / wall
                print(f"{count:5} as {what:22} {workers:9} {wall:8.1f}   {speed:10,.0f}")
            print(f"      scaling from one core to two: {walls[what, 1] / walls[what, 2]:.2f}")


def closed_loop(duration_s: float) -> None:
    """Seconds of flight per CPU second of one core, after compiling."""
    ways: dict[str, tuple[Flight | None, bool]] = {
        "servos of reduced order": (None, False),
        "… and messages as arrays": (None, True),
        "EMAs of one mass": (Flight(), False),
        "EMAs of two masses": (Flight(parameters=EmaParameters.from_data_sheet().two_masses()), False),
    }
    print("\nclosed loop, turbulence, 10 Hz streams    flight s per CPU s (one core)")
    for name, (emas, arrays) in ways.items():
        for lasts in (30.0, duration_s):
            flight = ClosedLoop(seed=1, airframe=3, duration_s=lasts, air=Air(5.0, 40.0, 9.0), emas=emas)
            used = time.process_time()
            tables = report(fly_closed_loop(flight)) if arrays else fly_closed_loop(flight)
            used = time.process_time() - used
        print(f"{name:40} {duration_s / used:12,.0f}")
        if isinstance(tables, list):
            encode(tables, 1)
            used = time.process_time()
            size = len(encode(tables, 1))
            speed = duration_s / (time.process_time() - used)
            print(f"{'their tlog, beside that':40} {speed:12,.0f}   {size / 1e6:.1f} MB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one flight of each kind")
    quick = parser.parse_args().quick
    load = os.getloadavg()[0]
    print(
        f"{platform.machine()}, {os.cpu_count()} cores, load {load:.1f}, Python {platform.python_version()}"
    )
    models(1 if quick else 5)
    flights(*(1, 1) if quick else (1000, 100))
    closed_loop(30.0 if quick else 600.0)


if __name__ == "__main__":
    main()
