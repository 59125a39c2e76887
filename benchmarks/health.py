"""Accuracy, delay and certainty of verdicts: ``python benchmarks/health.py [SECTION…] [--scale 1.0]``.

Sections: windows, flights, friction, jams, early, alarms, growth, conditions, unsigned, replay, bounds, cost;
all if none is named.
Every flight is flown by two-mass individuals with dispersion, from seeds that training never used, at
100 s and five flight modes in turn, unless said otherwise. ``--scale`` changes the number of flights.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks._against_baseline import alarms, conditions, early, growth
from benchmarks._against_limits import flights, friction, jams, windows
from benchmarks._fleet import ACTUATORS, MODES, flight, quantities, replayed
from benchmarks._unsigned import unsigned
from mavhums.core.arrays import Array
from mavhums.health.actuator.monitor import Monitor
from mavhums_sim import fly
from mavhums_sim.sensors import SensorNoise

Rows = Iterator[str]


def replay(args: argparse.Namespace) -> Rows:
    cyclograms = tuple(replayed(args.logs))
    if not cyclograms:
        yield f"no real logs in {args.logs}"
        return
    yield from windows(args, cyclograms)
    yield ""
    yield from friction(args, cyclograms)


def bounds(args: argparse.Namespace) -> Rows:
    yield "What 100 s show of the torque constant to one who knows the resistance and the offset exactly."
    yield ""
    yield "| rate | mode | back-EMF, rms, V | noise of a sample, V | k_t scatters by |"
    yield "|---|---|---|---|---|"
    ema, noise = ACTUATORS["elevator"].known_ema(), SensorNoise()
    noise_v = float(np.hypot(noise.voltage_v, ema.resistance * noise.current_a))
    for rate_hz in (25.0, 100.0):
        for mode in MODES:
            squares: list[float] = []
            for k in range(args.count(5)):
                record = fly(flight(k, 950 + k, rate_hz=rate_hz, mode=mode))
                for surface, flown in record.actuators.items():
                    _, values = quantities(flown, ACTUATORS[surface], "instrumented")
                    squares += [float(np.sum((ema.torque_constant * np.pi / 30 * values[:, 6]) ** 2))]
            of_flight = float(np.mean(squares))
            rms = np.sqrt(of_flight / (100.0 * rate_hz))
            scatter = noise_v / np.sqrt(of_flight)
            yield f"| {rate_hz:g} Hz | {mode} | {rms:.2f} | {noise_v:.2f} | {scatter:.1%} |"


def cost(args: argparse.Namespace) -> Rows:
    yield "| flight | block | ms of processor time per actuator and flight-minute |"
    yield "|---|---|---|"
    actuator = ACTUATORS["elevator"]
    flown = fly(flight(0, 900, rate_hz=100.0, mode="gusts", duration_s=100.0)).actuators["elevator"]
    times, values = quantities(flown, actuator, "instrumented")
    for copies in (1, 10):
        long_t = np.concatenate([times + 100.0 * k for k in range(copies)])
        long_v = np.tile(values, (copies, 1))
        for block in (100, 1000, 10_000):
            spent = min(_timed(actuator, long_t, long_v, block) for _ in range(3))
            yield f"| {100 * copies} s | {block / 100:g} s | {1000 * spent / (copies * 100 / 60):.2f} |"


def _timed(actuator: object, times: Array, values: Array, block: int) -> float:
    monitor = Monitor(1, actuator)  # type: ignore[arg-type]
    start = time.process_time()
    for k in range(0, times.size, block):
        list(monitor.feed(times[k : k + block], values[k : k + block]))
    list(monitor.finish())
    return time.process_time() - start


SECTIONS: dict[str, Callable[[argparse.Namespace], Rows]] = {
    "windows": windows,
    "flights": flights,
    "friction": friction,
    "jams": jams,
    "early": early,
    "alarms": alarms,
    "growth": growth,
    "conditions": conditions,
    "unsigned": unsigned,
    "replay": replay,
    "bounds": bounds,
    "cost": cost,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "section", nargs="*", choices=[[], *SECTIONS], help="what to measure; everything if omitted"
    )
    parser.add_argument("--scale", type=float, default=1.0, help="of the number of flights")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--later", type=int, default=0, help="added to the aircraft's numbers, in the sections with baselines"
    )
    parser.add_argument("--logs", type=Path, default=Path("logs"), help="folder of real logs")
    args = parser.parse_args()
    args.count = lambda number: max(round(number * args.scale), 1)
    args.aircraft = lambda first, number: range(args.later + first, args.later + first + args.count(number))
    args.say = lambda text: print(f"  {text}", flush=True)
    for name in args.section or SECTIONS:
        start = time.perf_counter()
        print(f"\n## {name}\n", flush=True)
        for line in SECTIONS[name](args):
            print(line, flush=True)
        print(f"\n({time.perf_counter() - start:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
