"""A simulated year of a fleet, asked every morning: ``python benchmarks/fleet_year.py [--read DAY ...]``.

Aircraft fly about four days a week, with four actuators each. Their friction scatters by 3, 5 or 10 % from
flight to flight; some grow, slowly or fast, from the first flight or from a later one; some are repaired or
swapped at the emergency limit, recorded or not; some fall silent. Each flight alone is judged as `analyse`
judges one: degraded from 0.375 and an emergency from 0.875 N·m, by an interval that false alarms widen. Every
morning the store is asked what changed. Counts what was found and when, the flights left against the truth,
growth that is none, and flights above the limit that were called normal; `--read` prints those mornings.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.flights.changes import digest
from mavhums.flights.compare import StandaloneAssessment, packed
from mavhums.flights.history import FlightHistory, PastFlight
from mavhums.flights.queries import STANDINGS_OF
from mavhums.flights.stores.delta import FORMAT, Row, Store
from mavhums.flights.stores.delta_tables import LOGS, STANDINGS
from mavhums.flights.trends import trend_report
from mavhums.log.base.losses import Losses
from mavhums.results.assessment import Assessment, LogSummary
from mavhums.results.standing import Interval, Standing
from mavhums.results.verdict import Indicator, Verdict
from mavhums.show.changes import digest_lines

ACTUATORS = ("aileron_left", "aileron_right", "elevator", "rudder")
DEGRADED, EMERGENCY = 0.375, 0.875
BEGIN = datetime(2026, 1, 5, 6, tzinfo=UTC)
SEED = 36_000
ALONE = 3.0  # standard errors by which one flight alone must leave the limit


@dataclass
class Part:
    """An actuator: its level, its growth a flight after a flight, and what happens to it."""

    level: float
    scatter: float
    growth: float = 0.0
    begin: int = 0
    flown: int = 0
    recorded: bool = True
    told: bool = False

    @property
    def truth(self) -> float:
        return self.level + self.growth * max(self.flown - self.begin, 0)

    def left(self, limit: float) -> float:
        """Return the true number of flights to a limit; infinite without growth."""
        if not self.growth or self.flown < self.begin:
            return float("inf")
        return (limit - self.truth) / self.growth


def drawn(rng: np.random.Generator, scatter: float) -> Part:
    part = Part(level=float(rng.uniform(0.20, 0.25)), scatter=scatter, recorded=bool(rng.random() < 0.5))
    if rng.random() < 0.25:
        part.growth = float(rng.choice([0.0012, 0.0025, 0.005, 0.01]))
        part.begin = int(rng.choice([0, 0, 40, 90]))
    return part


def judged(part: Part, actuator: str, rng: np.random.Generator) -> Verdict:
    """Return the verdict of one flight on one actuator, as `analyse` gives it without a history."""
    error = 0.002 * float(rng.uniform(0.7, 1.8))
    value = (
        part.truth
        + part.scatter * part.level * float(rng.standard_normal())
        + error * float(rng.standard_normal())
    )
    condition: Condition = "normal"
    if value - ALONE * error > EMERGENCY:
        condition = "emergency"
    elif value - ALONE * error > DEGRADED:
        condition = "degraded"
    shown = Indicator(
        fault="friction",
        quantity="Coulomb friction",
        unit="N·m",
        value=Interval(estimate=value, low=value - 2 * error, high=value + 2 * error),
        windows=20,
        scatter=error * 20**0.5,
        limit=DEGRADED,
        emergency=EMERGENCY,
    )
    return Verdict(vehicle=1, actuator=actuator, condition=condition, worst=condition, indicators=(shown,))


def row_of(aircraft: str, number: int, start: datetime, verdicts: list[Verdict]) -> tuple[Row, Assessment]:
    name = f"{aircraft}-{number:04}"
    log = LogSummary(
        path=f"{name}.tlog", sha256=name.rjust(64, "0"), start_utc=start.isoformat(), duration_s=900.0,
        vehicles=(1,), losses=Losses(),
    )  # fmt: skip
    flight = Assessment(log=log, airframe="paper", model=None, verdicts=tuple(verdicts))
    start_us = round(start.timestamp() * 1e6)
    data = packed(StandaloneAssessment(flight, {}, {}))
    row = Row(log.path or "", 1, 1, "", log.sha256, aircraft, None, start_us, 900.0, False, data, None, None)
    return row, flight


def days(
    count: int, fleet: dict[str, dict[str, Part]], rng: np.random.Generator
) -> Iterator[tuple[int, list[str]]]:
    """Yield each day with the aircraft that fly; one falls silent in the last third of the year."""
    names = [*fleet]
    for day in range(count):
        flying = [name for name in names if rng.random() < 4 / 7]
        yield day, [name for name in flying if not (name == names[-1] and day > count * 2 / 3)]


class Year:
    """The store, what is known of each aircraft in it, and what the mornings told."""

    def __init__(self, place: Path, fleet: dict[str, dict[str, Part]], rng: np.random.Generator) -> None:
        self.place, self.fleet, self.rng = place, fleet, rng
        self.store = Store(place)
        self.flown: dict[str, list[PastFlight]] = {name: [] for name in fleet}
        self.repaired: dict[str, dict[str | None, datetime]] = {name: {} for name in fleet}
        self.counts = Counter[str]()
        self.early: list[bool] = []
        self.inside: list[bool] = []
        self.found: list[float] = []
        self.false: set[int] = set()
        self.never: set[int] = set()

    def fly(self, day: int, flying: list[str]) -> None:
        """Fly a day, and store how each aircraft then stands."""
        start = BEGIN + timedelta(days=day, hours=3)
        stored = round((start + timedelta(hours=1)).timestamp() * 1e9)
        logs, rows = [], []
        for aircraft in flying:
            verdicts = [self.one(aircraft, name, start) for name in ACTUATORS]
            row, flight = row_of(aircraft, len(self.flown[aircraft]) + 1, start, verdicts)
            self.flown[aircraft].append(PastFlight.of(flight))
            history = FlightHistory(tuple(self.flown[aircraft]))
            found = trend_report(history, repaired=self.repaired[aircraft]).standings
            self.count(aircraft, found)
            logs.append(row._asdict() | {"scanned": stored, "format": FORMAT})
            text = STANDINGS_OF.dump_json(found).decode()
            rows.append({"aircraft": aircraft, "standings": text, "stored": stored})
        self.store.append(LOGS, logs)
        self.store.append(STANDINGS, rows)
        if day % 40 == 39:
            self.store.tidy()

    def one(self, aircraft: str, name: str, start: datetime) -> Verdict:
        """Fly one actuator; what is worn out is repaired before, recorded or not."""
        part = self.fleet[aircraft][name]
        part.flown += 1
        if part.truth > EMERGENCY or (part.truth > 0.5 and self.rng.random() < 0.1):
            self.counts["repairs"] += 1
            self.counts["unrecorded"] += not part.recorded
            if part.recorded:
                self.repaired[aircraft][name] = start - timedelta(hours=1)
            part.level, part.begin = float(self.rng.uniform(0.20, 0.25)), 0
            part.flown, part.recorded = 1, bool(self.rng.random() < 0.5)
            part.told = False
        return judged(part, name, self.rng)

    def count(self, aircraft: str, found: tuple[Standing, ...]) -> None:
        for one in found:
            part, left = self.fleet[aircraft][one.actuator], one.growth and one.growth.to_degraded
            truth = part.left(DEGRADED)
            if not part.growth:
                self.never.add(id(part))
                if one.growth:
                    self.false.add(id(part))
            if 0 < truth <= 10:
                self.early.append(one.is_finding)
            if left and 0 < truth < float("inf"):
                self.inside.append(left.low <= truth <= (left.high or float("inf")))
                if not part.told:
                    self.found.append(truth)
                part.told = True
            if part.truth > DEGRADED:
                self.counts["flights above"] += 1
                self.counts["above, alone normal"] += SEVERITY[one.last] <= 0
                self.counts["above, state normal"] += SEVERITY[one.condition] <= 0
                self.counts["above, no finding"] += not one.is_finding
            elif part.truth < 0.9 * DEGRADED:
                self.counts["well below, state faulty"] += SEVERITY[one.condition] > 0

    def report(self, lines: list[int]) -> None:
        flights = sum(map(len, self.flown.values()))
        print(f"{flights} flights of {len(self.fleet)} aircraft; {dict(self.counts)}")
        print(f"looks at most 10 flights before the limit: {len(self.early)}, told {mean(self.early)}")
        print(f"flights left when growth was first told: median {np.median(self.found or [0]):.0f}")
        print(f"flights left to degraded, truth inside: {mean(self.inside)} of {len(self.inside)} looks")
        print(f"actuators without growth: {len(self.never)}, growth told of {len(self.false)}")
        one = mean([count == 1 for count in lines])
        print(f"mornings: {len(lines)}, with one line {one}, longest {max(lines)} lines")


def mean(several: list[bool]) -> str:
    return f"{100 * np.mean(several):.1f} %" if several else "—"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--aircraft", type=int, default=20)
    parser.add_argument("--days", type=int, default=350)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--read", type=int, nargs="*", default=[], help="mornings to print; -1: all with news"
    )
    given = parser.parse_args()
    rng = np.random.default_rng([SEED, given.seed])
    fleet = {
        f"D-E{chr(65 + k // 26)}{chr(65 + k % 26)}": {
            name: drawn(rng, (0.03, 0.05, 0.1)[k % 3]) for name in ACTUATORS
        }
        for k in range(given.aircraft)
    }
    lines: list[int] = []
    with tempfile.TemporaryDirectory() as folder:
        year = Year(Path(folder, "store"), fleet, rng)
        for day, flying in days(given.days, fleet, rng):
            year.fly(day, flying)
            morning = BEGIN + timedelta(days=day + 1)
            found = digest(year.place, morning - timedelta(days=1), morning)
            printed = [*digest_lines(found)]
            lines.append(len(printed))
            if day in given.read or (-1 in given.read and not found.is_empty):
                print(f"--- morning of {morning:%Y-%m-%d}", *printed, sep="\n", flush=True)
        year.report(lines)


if __name__ == "__main__":
    main()
