"""A simulated year of a fleet, asked every morning: ``python benchmarks/fleet_year.py [--read DAY ...]``.

Aircraft fly about four days a week, with four actuators each; each is away for 40 days once, and the last
one falls silent. The friction of an aircraft's actuators scatters by 3, 5 or 10 % from flight to flight. A
quarter of them grows, slowly or fast, from the first flight or from a later one, and is repaired above
0.5 N·m, recorded or not; then the same wear begins again. One in twenty is swapped for another sound one, and
nobody records it. Each flight alone is judged as `analyse` judges one: degraded from 0.375 and an emergency
from 0.875 N·m, by an interval that false alarms widen. No log is flown or read: the verdicts on single
flights are drawn; the trend, the states, the store of standings and the digest of each morning are the
program's own.

Counts what was found and when, the flights left against the truth, growth that is none, and flights above the
limit that were called normal; `--read` prints mornings. Seeds below 100 were used for development.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import chain
from pathlib import Path

import numpy as np
from sqlalchemy import insert, update

from mavhums.core.conditions import SEVERITY, Condition
from mavhums.engine.events import StandaloneAssessment
from mavhums.flights.compare import packed
from mavhums.flights.history import PastFlight
from mavhums.flights.reports import digest
from mavhums.flights.store import Row, Store
from mavhums.flights.store.logs import add_logs, aircraft_id
from mavhums.flights.store.tables import FLIGHT, STANDING, us_of
from mavhums.flights.store.verdicts import STANDINGS
from mavhums.flights.trends import trend_report
from mavhums.log.base.decoder import Losses
from mavhums.results.assessment import Assessment, LogSummary
from mavhums.results.standing import Standing
from mavhums.results.verdict import Indicator, Interval, Verdict
from mavhums.show.standing import digest_blocks
from mavhums.show.terminal import plain

ACTUATORS = ("aileron_left", "aileron_right", "elevator", "rudder")
DEGRADED, EMERGENCY = 0.375, 0.875
BEGIN = datetime(2026, 1, 5, 6, tzinfo=UTC)
SEED = 36_000
AWAY_DAYS = 40
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
    warned: float | None = None  # true flights left to degraded at the first report of growth or a finding
    since: str = ""  # when it was repaired; reports of the time before do not count
    swap: int = 0  # flight after which it is swapped for another sound one; 0 for never

    @property
    def truth(self) -> float:
        return self.level + self.growth * max(self.flown - self.begin, 0)

    def knows(self, one: Standing) -> bool:
        """Return whether a standing reports growth or a fault of this part, not of the one before."""
        grows = one.growth is not None and one.growth.since_utc >= self.since
        return grows or (SEVERITY[one.condition] > 0 and (one.since_utc or "") >= self.since)

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
    elif rng.random() < 1 / 20:
        part.swap = int(rng.integers(20, 180))
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
    data = packed(StandaloneAssessment(flight, {}))
    row = Row(
        log.path or "", 1, 1, "", aircraft, log.sha256, start_us=start_us, duration_s=900.0, flight=data
    )
    return row, flight


def days(
    count: int, fleet: dict[str, dict[str, Part]], rng: np.random.Generator
) -> Iterator[tuple[int, list[str]]]:
    """Yield each day with the aircraft that fly; one falls silent in the last third of the year."""
    names = [*fleet]
    away = {name: int(rng.integers(0, max(count - AWAY_DAYS, 1))) for name in names}
    for day in range(count):
        flying = [name for name in names if rng.random() < 4 / 7]
        there = [name for name in flying if not away[name] <= day < away[name] + AWAY_DAYS]
        yield day, [name for name in there if not (name == names[-1] and day > count * 2 / 3)]


class Year:
    """The store, what is known of each aircraft in it, and the reports of the mornings."""

    def __init__(self, place: Path, fleet: dict[str, dict[str, Part]], rng: np.random.Generator) -> None:
        self.place, self.fleet, self.rng = place, fleet, rng
        self.store = Store(place)
        self.flown: dict[str, list[PastFlight]] = {name: [] for name in fleet}
        self.repaired: dict[str, dict[str | None, datetime]] = {name: {} for name in fleet}
        self.counts = Counter[str]()
        self.early: dict[float, list[tuple[int, bool]]] = {}  # flights since it grows, and whether reported
        self.inside: list[bool] = []
        self.crossed: list[tuple[float, int, float, float | None]] = []
        self.false: dict[int, tuple[int, int]] = {}
        self.never: set[int] = set()

    def fly(self, day: int, flying: list[str]) -> None:
        """Fly a day, and store each aircraft's state after it."""
        start = BEGIN + timedelta(days=day, hours=3)
        stored_us = us_of(start + timedelta(hours=1))
        logs, rows = [], []
        for aircraft in flying:
            verdicts = [self.one(aircraft, name, start) for name in ACTUATORS]
            row, flight = row_of(aircraft, len(self.flown[aircraft]) + 1, start, verdicts)
            self.flown[aircraft].append(PastFlight.of(flight))
            found = trend_report(self.flown[aircraft], repaired=self.repaired[aircraft]).standings
            self.count(aircraft, found)
            logs.append(row)
            rows.append((aircraft, STANDINGS.dump_json(found).decode()))
        with self.store.writing() as connection:
            add_logs(connection, logs)
            came = {"due": False, "came_us": stored_us}
            connection.execute(update(FLIGHT).where(FLIGHT.c.due).values(**came))
            for name, text in rows:
                one = {"aircraft_id": aircraft_id(connection, name), "standings": text}
                connection.execute(insert(STANDING).values(**one, stored_us=stored_us))

    def one(self, aircraft: str, name: str, start: datetime) -> Verdict:
        """Fly one actuator; what is worn out is repaired before, recorded or not."""
        part = self.fleet[aircraft][name]
        part.flown += 1
        if part.swap and part.flown == part.swap:
            self.counts["swaps"] += 1
            part.level = float(self.rng.uniform(0.20, 0.25))
        if part.truth > EMERGENCY or (part.truth > 0.5 and self.rng.random() < 0.1):
            self.counts["repairs"] += 1
            self.counts["unrecorded"] += not part.recorded
            if part.recorded:
                self.repaired[aircraft][name] = start - timedelta(hours=1)
            part.level, part.begin = float(self.rng.uniform(0.20, 0.25)), 0
            part.flown, part.recorded = 1, bool(self.rng.random() < 0.5)
            part.warned, part.since = None, start.isoformat()
        return judged(part, name, self.rng)

    def count(self, aircraft: str, found: tuple[Standing, ...]) -> None:
        for one in found:
            part, left = self.fleet[aircraft][one.actuator], one.growth and one.growth.to_degraded
            truth = part.left(DEGRADED)
            if not part.growth:
                self.never.add(id(part))
                if one.growth and id(part) not in self.false:
                    self.false[id(part)] = (one.flights, part.swap if part.flown >= part.swap else 0)
            elif part.knows(one) and part.warned is None and truth < float("inf"):
                part.warned = truth
            if 0 < truth <= 10:
                since = part.flown - part.begin
                self.early.setdefault(part.growth, []).append((since, part.knows(one)))
            if left and 0 < truth < float("inf"):
                self.inside.append(left.low <= truth <= (left.high or float("inf")))
            if -1 < truth <= 0:  # the flight on which it crosses the limit
                self.crossed.append((part.growth, part.begin, part.scatter, part.warned))
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
        for growth, several in sorted({0.0: [*chain(*self.early.values())], **self.early}.items()):
            whose = f"growth of {growth} a flight" if growth else "all growth"
            slow = [known for since, known in several if since >= 20]
            print(
                f"looks at most 10 flights before the limit, {whose}: {len(several)},"
                f" reported {mean([known for _, known in several])}; it has grown for 20 flights or more:"
                f" {len(slow)}, reported {mean(slow)}"
            )
        warned = [left or 0.0 for *_, left in self.crossed]
        at_least = ", ".join(f"{k} {mean([left >= k for left in warned])}" for k in (1, 5, 10, 20))
        print(f"crossings of the limit: {len(warned)}; reported so many flights before: {at_least}")
        print(f"  flights before, median {np.median(warned or [0]):.0f}")
        for growth, begin, scatter, left in sorted(self.crossed, key=lambda one: one[:3]):
            before = "not before" if left is None else f"{max(left, 0):.0f} flights before"
            print(f"  {growth} a flight from flight {begin}, scatter {scatter:.0%}: {before}")
        print(f"flights left to degraded, truth inside: {mean(self.inside)} of {len(self.inside)} looks")
        print(f"actuators without growth: {len(self.never)}, growth reported of {len(self.false)}")
        for flights, swap in self.false.values():
            print(f"  after {flights} flights" + (f", swapped at flight {swap}" if swap else ""))
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
            printed = plain(digest_blocks(found)).splitlines()
            lines.append(len(printed))
            if day in given.read or (-1 in given.read and not found.is_empty):
                print(f"--- morning of {morning:%Y-%m-%d}", *printed, sep="\n", flush=True)
        year.report(lines)


if __name__ == "__main__":
    main()
