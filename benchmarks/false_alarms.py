"""False alarms of healthy actuators: ``python benchmarks/false_alarms.py [--hours 100] [--first 0]``.

Flights of ten minutes by two-mass individuals, each with a sample rate and a flight mode drawn at random,
judged in every telemetry tier against the limits alone. No rule was developed on these flights: their seeds
and individuals are used nowhere else. An alarm is an actuator whose ``worst`` is degraded or an emergency.

A flight-hour is an hour of one flight. Its four actuators make four actuator-hours, each of which is judged
four times, once by tier.
"""

from __future__ import annotations

import argparse
from collections import Counter
from functools import partial
from unittest.mock import patch

import numpy as np

import mavhums_sim.flight
from benchmarks._fleet import MODES, SURFACES, Task, flight, fly_all, judge
from mavhums.core.conditions import SEVERITY
from mavhums_sim import FlightRecord
from mavhums_sim.motion import simulate

TIERS = ("instrumented", "csrv", "esc-signed", "esc-unsigned")
RATES_HZ = (10.0, 20.0, 25.0, 50.0, 100.0)
_AIRCRAFT = 4_000
_FLIGHT_S = 600.0
_STEP_S = 5e-4  # of the physics: nearly twice as fast as 0.1 ms, and the gear's wind-up still resolved


def task(number: int) -> Task:
    rng = np.random.default_rng([number, 31])
    rate, mode = float(rng.choice(RATES_HZ)), str(rng.choice(MODES))
    flown = flight(number, _AIRCRAFT + number, rate_hz=rate, mode=mode, duration_s=_FLIGHT_S)
    return Task(f"{rate:g} Hz, {mode}, flight {number}", flown)


def outcomes(name: str, record: FlightRecord) -> list[tuple[str, str, str]]:
    """Return tier, condition ("alarm" for any fault) and description of each actuator in each tier."""
    found = []
    for tier in TIERS:
        for one in judge(name, record, tier=tier):
            worst = one.findings.worst
            kind: str = "alarm" if SEVERITY[worst] > SEVERITY["normal"] else one.findings.condition
            faults = ", ".join(suspect.fault for suspect in one.findings.suspects)
            found.append((tier, kind, f"{one.surface}, {tier}, {name}: {worst} ({faults})"))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=100.0, help="flight-hours")
    parser.add_argument("--first", type=int, default=0, help="the first flight's number")
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    flights = max(round(args.hours * 3600 / _FLIGHT_S), 1)
    counts: Counter[tuple[str, str]] = Counter()
    tasks = [task(number) for number in range(args.first, args.first + flights)]
    with patch.object(mavhums_sim.flight, "simulate", partial(simulate, step_s=_STEP_S)):  # workers are forks
        for done, (_, found) in enumerate(fly_all(tasks, outcomes, args.workers), start=1):
            for tier, kind, text in found:
                counts[tier, kind] += 1
                if kind == "alarm":
                    print(f"ALARM {text}", flush=True)
            if done % 10 == 0 or done == flights:
                hours = done * _FLIGHT_S / 3600
                print(
                    f"\n{hours:.1f} flight-hours, {hours * len(SURFACES):.1f} actuator-hours in each tier\n"
                )
                print("| tier | normal | undecided | alarms |\n|---|---|---|---|")
                for tier in TIERS:
                    numbers = (str(counts[tier, kind]) for kind in ("normal", "undecided", "alarm"))
                    print(f"| {tier} | {' | '.join(numbers)} |", flush=True)


if __name__ == "__main__":
    main()
