"""An aircraft whose elevator wears with each flight: judge every log, keep the results, show the trend.

    python examples/wear_over_flights.py FOLDER [FLIGHTS]

It flies in the simulator, a flight a day, and leaves the logs in FOLDER/logs and the flights in
FOLDER/flights.sqlite, so that afterwards `mavhums trend --store FOLDER/flights.sqlite` shows the same.
"""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console
from rich.progress import track

import mavhums
from mavhums.results.standing import TrendReport
from mavhums.show.terminal import draw
from mavhums.show.trend import trend_blocks
from mavhums_sim import Flight, fly, write_tlog
from mavhums_sim.link import Link

START_NM, WEAR_NM = 0.225, 0.015
"""Friction of the elevator in the first flight, and what each flight adds."""


def main(folder: str, flights: int = 20) -> TrendReport:
    """Simulate and judge each flight and keep its results; print and return the trend."""
    logs, kept = Path(folder, "logs"), Path(folder, "flights.sqlite")
    logs.mkdir(parents=True, exist_ok=True)
    for day in track(range(flights), "flying", console=Console(stderr=True), transient=True):
        log = logs / f"day-{day:02d}.tlog"
        worn = START_NM + WEAR_NM * day
        flight = Flight(seed=500 + day, duration_s=40.0, rate_hz=50.0, friction_nm={"elevator": (worn, worn)})
        write_tlog(fly(flight), log, Link(day=float(day)))
        mavhums.analyse(log, store=kept, keep=True)
    report = mavhums.trend(kept, faults=["friction"])
    draw(trend_blocks(report), Console())
    return report


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: wear_over_flights.py FOLDER [FLIGHTS]")
    try:
        main(sys.argv[1], *map(int, sys.argv[2:3]))
    except mavhums.MavhumsError as error:
        sys.exit(str(error))
