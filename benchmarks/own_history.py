"""Detection from a servo's own earlier flights: ``python benchmarks/own_history.py [--first 10]``.

Flights of 100 s by two-mass individuals with dispersion, five flight modes in turn. Everything was tuned on
aircraft 0–2; the figures are for aircraft from ``--first`` on, whose seeds tuning never used.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks._fleet import (
    ACTUATORS,
    MODES,
    Judged,
    Known,
    added,
    baselines_of,
    flight,
    fly_all,
    judge,
    quantities,
)
from benchmarks._fleet import Task as Sheet
from benchmarks._own_flights import BLANK, TIERS, Row, Task, flown, scattered
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.estimation.motor_identification import VoltageSums, identified
from mavhums.health.estimation.slots import SlotCutter, with_extra_columns
from mavhums.health.estimation.wear import learned, shows, wear
from mavhums.health.self_baseline.comparison import Comparison, compare
from mavhums.health.self_baseline.motor import constant_lost
from mavhums.results.verdict import OwnRecord
from mavhums_sim import FlightRecord

BASELINES = (10, 20)
FLIGHTS_BEFORE = 30  # position only shows nothing in some of them
SCATTERS = (0.0, 0.05, 0.10)
FLOATS, STEPS = "floats (instrumented, named)", "esc-signed, 10 mV and 10 mA"
IDENTIFIED, IDENTIFIED_HZ = (FLOATS, "esc-signed", STEPS), (100.0, 25.0)
SCATTERED = ("motor, 50 Hz",)
SCANNED = (
    "motor, 50 Hz",
    "motor, 25 Hz",
    "position, 50 Hz",
    "position, 25 Hz",
)
FRICTIONS = (0.02, 0.05, 0.1, 0.2)
OTHERS = {
    "resistance": 0.3,
    "torque_constant": 0.15,
    "backlash": 1.5,
    "slow": 0.2,
    "supply_sag": 10.0,
    "sensor_bias": 0.5,
}
PAPER_CONSTANT = ACTUATORS["elevator"].known_ema().torque_constant
PAPER_RESISTANCE = ACTUATORS["elevator"].known_ema().resistance
Counts = dict[tuple[object, ...], Counter[str]]


class Fleet:
    """The baselines of all actuators, and what their flights were found to be."""

    def __init__(self) -> None:
        self.reference: dict[tuple[tuple[int, str], str], list[OwnRecord]] = defaultdict(list)
        self.voltages: dict[tuple[tuple[int, str], str], list[OwnRecord | None]] = defaultdict(list)
        self.counts: Counts = defaultdict(Counter)
        self.promised: Counts = defaultdict(Counter)
        self.constant: Counter[tuple[object, ...]] = Counter()
        self._level: dict[tuple[tuple[int, str], str], float] = {}
        self._pasts: dict[tuple[tuple[int, str], str, int, float], list[PastRecord]] = {}

    def learn(self, row: Row) -> None:
        if row.record is not None and shows(row.record):
            self.reference[row.actuator, row.tier].append(row.record)
            self.voltages[row.actuator, row.tier].append(row.voltage)

    def take(self, row: Row) -> None:
        """Compare a flight with its baselines of 10 and 20 flights, with and without natural scatter."""
        scatters = SCATTERS if row.tier in SCATTERED else SCATTERS[:1]
        for scatter in scatters:
            own = row.record and self._with(row.record, row, scatter, 10_000 + row.number)
            for flights in BASELINES:
                key = row.tier, flights, scatter
                found = self._compared(row, own, flights, scatter) if own else None
                condition = found.condition if found else "undecided"
                self.counts[(*key, row.kind)][condition] += 1
                if found and condition == "changed" and self._by_constant(row, found, flights):
                    self.constant[(*key, row.kind)] += 1
                if found and found.least_rise is not None and row.rise >= found.least_rise:
                    self.promised[key][condition] += 1

    def _compared(self, row: Row, own: OwnRecord, flights: int, scatter: float) -> Comparison:
        equation = TIERS[row.tier].equation
        equation = replace(equation, min_flights=min(flights, equation.min_flights))
        return compare(equation, own, self._past(row, flights, scatter))

    def _by_constant(self, row: Row, found: Comparison, flights: int) -> bool:
        """Return whether the verdict names the torque constant as the cause."""
        several = self.voltages[row.actuator, row.tier][:flights]
        past = [PastRecord((record,), "2026-01-01", True) for record in several if record]
        return row.voltage is not None and constant_lost(found, [row.voltage], past) is not None

    def _past(self, row: Row, flights: int, scatter: float) -> list[PastRecord]:
        key = row.actuator, row.tier, flights, scatter
        if key not in self._pasts:
            self._pasts[key] = [
                PastRecord((self._with(record, row, scatter, k),), "2026-01-01", True)
                for k, record in enumerate(self.reference[row.actuator, row.tier][:flights])
            ]
        return self._pasts[key]

    def _with(self, record: OwnRecord, row: Row, scatter: float, number: int) -> OwnRecord:
        if not scatter:
            return record
        aircraft, surface = row.actuator
        rng = np.random.default_rng([aircraft, len(surface), ord(surface[0]), ord(surface[-1]), number])
        return scattered(record, scatter * self.level(row) * rng.standard_normal())

    def level(self, row: Row) -> float:
        """Return an actuator's healthy level in a tier."""
        key = row.actuator, row.tier
        if key not in self._level:
            individual = learned(self.reference[key])
            shown = [w.value for record in self.reference[key] if (w := wear(record, individual))]
            self._level[key] = float(np.mean(shown))
        return self._level[key]


def tasks_of(args: argparse.Namespace) -> tuple[list[Task], list[Task]]:
    aircraft = tuple(range(args.first, args.first + args.aircraft))
    every = tuple(tier for tier in TIERS if tier.startswith(tuple(args.only or [""])))
    scanned = tuple(tier for tier in every if tier in SCANNED)
    base = [Task("base", k, "friction", 0.0, aircraft, every) for k in range(FLIGHTS_BEFORE)]
    worn = [
        Task(f"+{severity:g} N·m", 2000 + 100 * n + k, "friction", severity, aircraft, every)
        for n, severity in enumerate(FRICTIONS)
        for k in range(args.each)
    ]
    others = [
        Task(fault, 3000 + 100 * n + k, fault, severity, aircraft, scanned)
        for n, (fault, severity) in enumerate(OTHERS.items())
        for k in range(args.each)
    ]
    healthy = [
        Task("healthy", 5000 + k, "friction", 0.0, aircraft, every if k < 40 else scanned)
        for k in range(args.healthy)
    ]
    return base, [*worn, *others, *healthy]


def found_table(fleet: Fleet) -> Iterator[str]:
    """Yield the share of flights found, by measurement and scatter, after each number of flights before."""
    kinds = [f"+{severity:g} N·m" for severity in FRICTIONS]
    yield f"| measured | scatter | {' | '.join(kinds)} | least rise kept | false alarms |"
    yield "|---" * (len(kinds) + 4) + "|"
    for tier, scatter in dict.fromkeys((key[0], key[2]) for key in fleet.counts):
        keys = [(tier, flights, scatter) for flights in BASELINES]
        cells = [_shares([fleet.counts[*key, kind] for key in keys]) for kind in kinds]
        healthy = [fleet.counts[*key, "healthy"] for key in keys]
        alarms = " / ".join(str(counter["changed"]) for counter in healthy)
        cells += [_shares([fleet.promised[key] for key in keys])]
        hours = healthy[0].total() * 100.0 / 3600.0
        yield f"| {tier} | {scatter:.0%} | {' | '.join(cells)} | {alarms} in {hours:.0f} h |"


def _shares(counters: Iterable[Counter[str]]) -> str:
    shown = [f"{100 * c['changed'] / c.total():.0f}" if c.total() else "–" for c in counters]
    return f"{' / '.join(shown)} %"


def confusion_table(fleet: Fleet) -> Iterator[str]:
    """Yield the share of flights said to be changed after the most flights, and with which cause."""
    tiers = list(dict.fromkeys(key[0] for key in fleet.counts if key[3] == next(iter(OTHERS))))
    yield f"| fault | {' | '.join(map(str, tiers))} |"
    yield "|---" * (len(tiers) + 1) + "|"
    for kind, severity in OTHERS.items():
        cells = []
        for tier in tiers:
            key = tier, BASELINES[-1], 0.0, kind
            named = fleet.constant[key] / max(fleet.counts[key].total(), 1)
            cells.append(_shares([fleet.counts[key]]) + (f" (torque constant {named:.0%})" if named else ""))
        yield f"| {kind} {severity:g} | {' | '.join(cells)} |"


ByDataSheet = tuple[list[bool], list[Judged]]


def _by_data_sheet(name: str, record: FlightRecord, *, baselines: Known | None = None) -> ByDataSheet:
    judged = judge(name, record, tier="esc-signed", baselines=baselines)
    return [any(s.fault == "friction" for s in one.findings.suspects) for one in judged], judged


def sheet_table(args: argparse.Namespace) -> Iterator[str]:
    """Judge the 50 Hz logs with the data sheet as well: friction in N·m against the same baseline."""
    aircraft = range(args.first, args.first + args.sheet)

    def fly_them(
        severity: float, first: int, count: int, baselines: Known | None
    ) -> list[tuple[str, ByDataSheet]]:
        tasks = [
            Sheet(
                f"{a}/{k}",
                flight(
                    first + k,
                    a,
                    rate_hz=50.0,
                    mode=MODES[k % len(MODES)],
                    conditions=added("friction", severity),
                ),
            )
            for a in aircraft
            for k in range(count)
        ]
        return list(fly_all(tasks, partial(_by_data_sheet, baselines=baselines), args.workers))

    known = baselines_of([(name, judged) for name, (_, judged) in fly_them(0.0, 0, 20, None)])
    yield "| esc-signed, 50 Hz, with data sheet | found | of |"
    yield "|---|---|---|"
    for n, severity in enumerate((0.0, *FRICTIONS[1:3])):
        flown_ = fly_them(severity, 9000 + 100 * n, args.each, known)
        said = [one for _, (found, _) in flown_ for one in found]
        yield f"| +{severity:g} N·m | {np.mean(said):.0%} | {len(said)} |"


def _voltages(name: str, record: FlightRecord, *, tier: str) -> list[tuple[str, OwnRecord | None, float]]:
    """Return each actuator's record of the voltage equation, and its true back-EMF constant."""
    left = []
    for surface, own in record.actuators.items():
        sums, cutter = VoltageSums(BLANK[surface]), SlotCutter()
        time_s, values = quantities(own, BLANK[surface], "without load" if tier == FLOATS else "esc-signed")
        if tier == STEPS:
            values[:, [3, 4]] = np.rint(values[:, [3, 4]] / 0.01) * 0.01
        for slots in (cutter.feed(time_s, with_extra_columns(values)), cutter.finish()):
            if slots is not None:
                sums.feed(slots)
        left.append((surface, sums.record(), own.individual.torque_constant * PAPER_CONSTANT))
    return left


def identify_table(args: argparse.Namespace) -> Iterator[str]:
    yield "| tier, rate | flights | R, error | k_e, error | drop, V | R inside | k_e inside | of |"
    yield "|---|---|---|---|---|---|---|---|"
    for tier in IDENTIFIED:
        for rate_hz in IDENTIFIED_HZ:
            yield from _identified_rows(args, tier, rate_hz)


def _identified_rows(args: argparse.Namespace, tier: str, rate_hz: float) -> Iterator[str]:
    records: dict[tuple[str, str], list[OwnRecord]] = defaultdict(list)
    truth: dict[tuple[str, str], float] = {}
    tasks = [
        Sheet(f"{a}/{k}", flight(9500 + k, a, rate_hz=rate_hz, mode=MODES[k % len(MODES)]))
        for a in range(args.first, args.first + args.identify)
        for k in range(5)
    ]
    for name, several in fly_all(tasks, partial(_voltages, tier=tier), args.workers):
        for surface, record, constant in several:
            key = name.split("/")[0], surface
            truth[key] = constant
            records[key] += [record] if record else []
    for flights in (1, 5):
        yield _identified_row(f"{tier}, {rate_hz:g} Hz", flights, records, truth)


def _identified_row(
    rate: str,
    flights: int,
    records: dict[tuple[str, str], list[OwnRecord]],
    truth: dict[tuple[str, str], float],
) -> str:
    errors, inside = [], []
    for key, several in records.items():
        for first in range(0, len(several), flights):
            found = identified(several[first : first + flights])
            if found is None:
                continue
            resistance, constant = found.resistance, found.back_emf
            errors.append(
                (
                    resistance.estimate / PAPER_RESISTANCE - 1,
                    constant.estimate / truth[key] - 1,
                    found.drop.estimate,
                )
            )
            inside.append(
                (
                    resistance.low <= PAPER_RESISTANCE <= resistance.high,
                    constant.low <= truth[key] <= constant.high,
                )
            )
    (r, k, drop), (r_sd, k_sd, drop_sd) = np.mean(errors, axis=0), np.std(errors, axis=0)
    r_in, k_in = np.mean(inside, axis=0)
    return (
        f"| {rate} | {flights} | {r:+.2%} ± {r_sd:.2%} | {k:+.2%} ± {k_sd:.2%} | "
        f"{drop:+.3f} ± {drop_sd:.3f} | "
        f"{r_in:.0%} | {k_in:.0%} | {len(errors)} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=10, help="first aircraft")
    parser.add_argument("--aircraft", type=int, default=6, help="number of aircraft, of four actuators each")
    parser.add_argument("--each", type=int, default=10, help="flights of each fault")
    parser.add_argument("--healthy", type=int, default=450, help="healthy flights of each aircraft")
    parser.add_argument("--sheet", type=int, default=2, help="aircraft judged with their data sheet as well")
    parser.add_argument("--identify", type=int, default=4, help="aircraft whose motors are identified")
    parser.add_argument("--only", action="append", help="first letters of the tiers; may be repeated")
    parser.add_argument("--report", type=int, default=10**9, help="print the table after so many comparisons")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    start = time.perf_counter()
    if args.sheet:
        print("\n## The same with the data sheet, 20 flights before\n")
        print("\n".join(sheet_table(args)), flush=True)
    if args.identify:
        print("\n## Identified without a data sheet\n")
        print("\n".join(identify_table(args)), flush=True)
    if not args.aircraft:
        return
    base, later = tasks_of(args)
    fleet = Fleet()
    for row in flown(base, args.workers):
        fleet.learn(row)
    for number, row in enumerate(flown(later, args.workers), 1):
        fleet.take(row)
        if number % args.report == 0:
            print("\n".join([f"\n{row.kind} {row.number}:", *found_table(fleet)]), flush=True)
    sections = {
        "Found in one flight; share of actuator-flights": found_table(fleet),
        "Said to be changed": confusion_table(fleet),
    }
    for title, rows in sections.items():
        print(f"\n## {title}\n")
        print("\n".join(rows))
    print(f"\n({time.perf_counter() - start:.0f} s)", file=sys.stderr)


if __name__ == "__main__":
    main()
