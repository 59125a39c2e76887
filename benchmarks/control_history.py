"""Faults that are there from the start of a flight, found against the aircraft's earlier healthy flights.

    python benchmarks/control_history.py [--aircraft N] [--first A] [--flights N] [--tests N] [--jobs J]
        [--fault NAME]

Each of several individual aircraft of the closed-loop simulator flies ``--flights`` healthy flights in winds
and turbulence that change from flight to flight. Then come ``--tests`` more healthy ones and the same number
of each fault, all compared with the same earlier flights; ``--fault none`` flies healthy ones only.
Aircraft 0 to 2 were used to choose the method.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks._closed_loop import TURBULENCE
from mavhums import Options
from mavhums.app.analysis import analyse_alone
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.compare import compared
from mavhums.flights.history import PastFlight, baselines_of, records_of
from mavhums.results.verdict import Verdict
from mavhums_sim.closed_loop import Air, ClosedLoop, SurfaceFault, fly_closed_loop
from mavhums_sim.closed_loop.encode import encode
from mavhums_sim.closed_loop.reports import Streams, report
from mavhums_sim.link import Link

RATES = (4.0, 10.0, 25.0)
DURATION_S = 420.0
_LEFT, _RIGHT, _ELEVATOR = "aileron_left", "aileron_right", "elevator"
FAULTS: dict[str, tuple[str, tuple[tuple[str, str, float], ...]]] = {
    "none": ("", ()),
    "one aileron frozen at neutral": ("roll", ((_LEFT, "freeze", 0.0),)),
    "one aileron frozen at 6°": ("roll", ((_RIGHT, "freeze", 6.0),)),
    "one aileron without effect": ("roll", ((_LEFT, "gain", 0.0),)),
    "both ailerons at 60 %": ("roll", ((_LEFT, "gain", 0.6), (_RIGHT, "gain", 0.6))),
    "one aileron at 50 %": ("roll", ((_LEFT, "gain", 0.5),)),
    "ailerons slow, 0.8 s": ("roll", ((_LEFT, "slow", 0.8), (_RIGHT, "slow", 0.8))),
    "one aileron bent by 8°": ("roll", ((_LEFT, "bias", 8.0),)),
    "elevator at 50 %": ("pitch", ((_ELEVATOR, "gain", 0.5),)),
    "elevator at 70 %": ("pitch", ((_ELEVATOR, "gain", 0.7),)),
    "rudder frozen at neutral": ("yaw", (("rudder", "freeze", 0.0),)),
}


@dataclass(frozen=True, slots=True)
class Flown:
    """One flight to be flown and judged: the fault is a key of ``FAULTS``."""

    aircraft: int
    day: int
    fault: str

    def judged(self) -> StandaloneAssessment:
        """Fly it, and judge its log by itself."""
        rng = np.random.default_rng([self.aircraft, self.day, 51])
        air = Air(float(rng.uniform(0, 9)), float(rng.uniform(0, 360)), float(rng.choice(TURBULENCE)))
        faults = tuple(SurfaceFault(name, kind, value) for name, kind, value in FAULTS[self.fault][1])
        seed = 1000 * self.aircraft + self.day
        flight = ClosedLoop(seed=seed, airframe=self.aircraft, duration_s=DURATION_S, air=air, faults=faults)
        rate = RATES[self.aircraft % len(RATES)]
        tables = report(fly_closed_loop(flight), Streams(rate=rate, status=2.0))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{self.day}.tlog"
            path.write_bytes(encode(tables, seed, Link(day=self.day)))
            return analyse_alone(path, Options().resolved())


def judged(flown: Flown) -> StandaloneAssessment:
    """Fly and judge, in a process of its own."""
    return flown.judged()


def plan(aircraft: int, flights: int, tests: int, faults: Collection[str]) -> Iterator[Flown]:
    """Yield the flights of one aircraft: the earlier ones first."""
    yield from (Flown(aircraft, day, "none") for day in range(flights))
    for k, fault in enumerate(FAULTS):
        if fault not in faults:
            continue
        yield from (Flown(aircraft, 100 + 50 * k + test, fault) for test in range(tests))


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--aircraft", type=int, default=6)
    parser.add_argument("--first", type=int, default=3)
    parser.add_argument("--flights", type=int, default=10)
    parser.add_argument("--tests", type=int, default=6)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--fault", action="append", choices=FAULTS, help="can be repeated; all if absent")
    options = parser.parse_args()
    alone, found, wrong, shares = Counter[str](), Counter[str](), Counter[str](), Counter[str]()
    with ProcessPoolExecutor(options.jobs) as pool:
        for aircraft in range(options.first, options.first + options.aircraft):
            flown = [*plan(aircraft, options.flights, options.tests, options.fault or FAULTS)]
            flights = [*pool.map(judged, flown)]
            past = [PastFlight.of(one.assessment) for one in flights[: options.flights]]
            for one, flight in zip(flown[options.flights :], flights[options.flights :], strict=True):
                axis = FAULTS[one.fault][0]
                before = _alarmed(flight.assessment.verdicts)
                earlier = partial(baselines_of, past), partial(records_of, past)
                after = _alarmed(compared(flight, *earlier).verdicts)
                shares[one.fault] += 1
                alone[one.fault] += axis in before
                found[one.fault] += axis in after
                wrong[one.fault] += bool((after - before) - {axis})
    print(f"{options.aircraft} aircraft from {options.first}, {options.flights} earlier flights each")
    print("| fault | flights | found alone | against earlier flights | another axis named |")
    print("|---|---|---|---|---|")
    for fault, count in shares.items():
        print(f"| {fault} | {count} | {alone[fault]} | {found[fault]} | {wrong[fault]} |")


def _alarmed(verdicts: tuple[Verdict, ...]) -> set[str]:
    return {v.actuator for v in verdicts if v.subject == "axis" and v.worst in ("degraded", "emergency")}


if __name__ == "__main__":
    main()
