"""False alarms of healthy actuators: ``python benchmarks/false_alarms.py [--hours 100] [--first 0]``.

Flights of ten minutes by two-mass individuals, each with sample rate, flight mode and telemetry tier drawn
at random, judged against the limits alone. No rule was developed on these flights: their seeds and
individuals are used nowhere else. An alarm is an actuator whose ``worst`` is degraded or an emergency. A
flight-hour is an hour of one flight; its four actuators make four actuator-hours.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np
from _fleet import MODES, SURFACES, Task, flight, fly_all, judge

from mavhums.core.conditions import SEVERITY
from mavhums_sim import FlightRecord

TIERS = ("instrumented", "csrv", "esc-signed", "esc-unsigned")
RATES_HZ = (10.0, 20.0, 25.0, 50.0, 100.0)
_AIRCRAFT = 4_000
_FLIGHT_S = 600.0


def task(number: int) -> Task:
    rng = np.random.default_rng([number, 31])
    rate, mode, tier = (str(rng.choice(drawn)) for drawn in (RATES_HZ, MODES, TIERS))
    flown = flight(number, _AIRCRAFT + number, rate_hz=float(rate), mode=mode, duration_s=_FLIGHT_S)
    return Task(f"{tier}/{float(rate):g} Hz/{mode}/flight {number}", flown)


def _judged(name: str, record: FlightRecord) -> list[tuple[str, str, str]]:
    """Return of each actuator the condition, the worst, and the faults suspected."""
    return [
        (one.findings.condition, one.findings.worst, ", ".join(s.fault for s in one.findings.suspects))
        for one in judge(name, record, tier=name.split("/", maxsplit=1)[0])
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=100.0, help="flight-hours")
    parser.add_argument("--first", type=int, default=0, help="the first flight's number")
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    flights = max(round(args.hours * 3600 / _FLIGHT_S), 1)
    said: dict[str, Counter[str]] = {tier: Counter() for tier in TIERS}
    tasks = [task(number) for number in range(args.first, args.first + flights)]
    for done, (name, found) in enumerate(fly_all(tasks, _judged, args.workers), start=1):
        for surface, (condition, worst, faults) in zip(SURFACES, found, strict=True):
            alarm = SEVERITY[worst] > SEVERITY["normal"]  # type: ignore[index]
            said[name.split("/")[0]]["alarm" if alarm else condition] += 1
            if alarm:
                print(f"ALARM {name} {surface}: {worst}, now {condition} ({faults})", flush=True)
        if done % 10 == 0 or done == flights:
            hours = done * _FLIGHT_S / 3600
            alarms = sum(each["alarm"] for each in said.values())
            count = f"{hours:.1f} flight-hours, {hours * len(SURFACES):.1f} actuator-hours"
            print(f"{count}: {alarms} alarms", flush=True)
    print("\n| tier | actuator-hours | normal | undecided | alarms |\n|---|---|---|---|---|")
    for tier, counts in said.items():
        hours = counts.total() * _FLIGHT_S / 3600
        print(
            f"| {tier} | {hours:.1f} | {counts['normal']} | {counts['undecided']} | {counts['alarm']} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
