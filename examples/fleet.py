"""A small fleet: fly it, break some of it, scan the logs into a store, print the worst.

    python examples/fleet.py FOLDER [AIRCRAFT]

It leaves the logs in FOLDER/logs, a folder for each aircraft, and the store in FOLDER/store, which
`mavhums fleet worst --store FOLDER/store` shows again.
"""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console
from rich.progress import track

from mavhums import MavhumsError, Options, fleet
from mavhums.results.standing import LastFlightOf
from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.link import Link

FLIGHTS = 11
HEALTHY_NM, DRIFTED_NM, FAILED_NM = 0.225, 0.30, 1.1


def main(folder: str, aircraft: int = 3) -> list[LastFlightOf]:
    """Fly, scan and print the actuators of all aircraft, the worst first."""
    logs = Path(folder, "logs")
    for number in track(range(aircraft), "flying", console=Console(stderr=True), transient=True):
        _fly(logs / f"D-{number:03d}", number)
    (logs / "D-000" / "broken.tlog").write_bytes(b"no log")
    done = fleet.scan([logs], Path(folder, "store"), fleet.ScanOptions(judging=Options(aircraft="folder")))
    print(f"{done.judged} logs judged, {done.failed} could not be")
    found = fleet.worst(Path(folder, "store"), most=5)
    for one in found:
        print(f"{one.aircraft} {one.verdict.actuator}: {one.verdict.gravest}")
    return found


def _fly(folder: Path, number: int) -> None:
    """Fly an aircraft: the elevator of the first fails in its last flight, that of the second drifts."""
    folder.mkdir(parents=True, exist_ok=True)
    for day in range(FLIGHTS):
        last = {0: FAILED_NM, 1: DRIFTED_NM}.get(number, HEALTHY_NM) if day == FLIGHTS - 1 else HEALTHY_NM
        flight = Flight(
            seed=100 * number + day,
            duration_s=25.0,
            rate_hz=25.0,
            friction_nm={"elevator": (last, last)},
            individuals=number,
            tiers=("instrumented",),
        )
        write_tlog(fly(flight), folder / f"day-{day:02d}.tlog", Link(day=float(day)))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: fleet.py FOLDER [AIRCRAFT]")
    try:
        main(sys.argv[1], *map(int, sys.argv[2:3]))
    except MavhumsError as error:
        sys.exit(str(error))
