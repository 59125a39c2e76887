"""Detection relative to the actuator's own baseline: sections of ``benchmarks/health.py``."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks._fleet import (
    MODES,
    SURFACES,
    Judged,
    Known,
    Task,
    added,
    baselines_of,
    flight,
    fly_all,
    judge,
)
from mavhums.health.estimation.thresholds import REFERENCE_FLIGHTS
from mavhums_sim import FlightRecord
from mavhums_sim.conditions import Condition

Rows = Iterator[str]

CLEAR = {
    "friction": 0.05,
    "backlash": 0.15,
    "resistance": 0.15,
    "torque_constant": 0.07,
    "supply_sag": 4.0,
    "sensor_bias": 0.5,
    "jam": 10.0,
}
NAMES = {"resistance": "winding_resistance"}
UNITS = {
    "friction": "friction +{:g} N·m",
    "backlash": "backlash +{:g}°",
    "resistance": "winding resistance +{:.0%}",
    "torque_constant": "torque constant −{:.0%}",
    "supply_sag": "supply sag {:g} V at the motor",
    "sensor_bias": "sensor bias {:g}°",
    "jam": "jam {:g} N·m",
}
EARLY = (
    *((25.0, (mode,), 0.0) for mode in MODES),
    (25.0, MODES, 0.0),
    (25.0, MODES, 0.03),
    (100.0, MODES, 0.0),
)
RATES_HZ = (100.0, 25.0)
BY_TIER = ("instrumented", "esc-signed")


def reference(
    args: argparse.Namespace, aircraft: range, rate_hz: float, modes: tuple[str, ...], **given: float
) -> Known:
    tasks = [
        Task(f"{a}/{k}", flight(k, a, rate_hz=rate_hz, mode=modes[k % len(modes)], **given))
        for a in aircraft
        for k in range(REFERENCE_FLIGHTS)
    ]
    return baselines_of(list(fly_all(tasks, judge, args.workers)))


def _found(
    args: argparse.Namespace,
    baselines: Known | None,
    aircraft: range,
    rate_hz: float,
    modes: tuple[str, ...],
    each: int,
    severity: float,
    first: int,
    **given: float,
) -> tuple[int, int, int]:
    """Return the numbers of actuator-flights, of detected friction wear, and of other reported faults."""
    tasks = [
        Task(
            f"{a}/{k}",
            flight(
                first + k,
                a,
                rate_hz=rate_hz,
                mode=modes[k % len(modes)],
                conditions=added("friction", severity),
                **given,
            ),
        )
        for a in aircraft
        for k in range(each)
    ]
    total = found = other = 0
    for _, judged in fly_all(tasks, partial(judge, baselines=baselines), args.workers):
        for one in judged:
            faults = {suspect.fault for suspect in one.findings.suspects}
            total, found, other = (
                total + 1,
                found + ("friction" in faults),
                other + bool(faults - {"friction"}),
            )
    return total, found, other


def early(args: argparse.Namespace) -> Rows:
    yield f"Baseline of {REFERENCE_FLIGHTS} flights; share of actuator-flights in which friction is found."
    yield ""
    yield "| rate | modes | k_t drift | +0.02 N·m | +0.03 | +0.05 | of |"
    yield "|---|---|---|---|---|---|---|"
    aircraft = args.aircraft(0, 5)
    for rate_hz, modes, drift in EARLY:
        given = {"drift": drift} if drift else {}
        baselines = reference(args, aircraft, rate_hz, modes, **given)
        shares, total = [], 0
        for severity in (0.02, 0.03, 0.05):
            total, found, _ = _found(
                args, baselines, aircraft, rate_hz, modes, args.count(10), severity, 100, **given
            )
            shares.append(f"{found / total:.1%}")
        name = modes[0] if len(modes) == 1 else "all five"
        yield f"| {rate_hz:g} Hz | {name} | {drift:.0%} | {' | '.join(shares)} | {total} |"


def alarms(args: argparse.Namespace) -> Rows:
    """Count the false alarms in a healthy run whose flights are used for nothing else."""
    aircraft = args.aircraft(530, 12)
    baselines = reference(args, aircraft, 25.0, MODES)
    total, found, other = _found(args, baselines, aircraft, 25.0, MODES, 226, 0.0, 1000)
    hours = total * 100.0 / 3600.0
    yield f"Healthy, own baselines, 25 Hz, five modes: {total} actuator-flights, {hours:.0f} actuator-hours."
    yield f"False alarms: friction {found}, any other detector {other}."


def _delays(name: str, record: FlightRecord, *, baselines: Known | None, crossed_s: float) -> list[float]:
    delays = []
    for one in judge(name, record, baselines=baselines):
        alarms_s = [c.time_s for c in one.changes if c.after in ("degraded", "emergency")]
        if not alarms_s and one.findings.suspects:
            alarms_s = [one.findings.last_s]  # what the whole flight shows beside the earlier ones
        delay = (alarms_s[0] - crossed_s) * one.truth["moving"] if alarms_s else np.inf
        delays.append(float(delay))
    return delays


def growth(args: argparse.Namespace) -> Rows:
    yield "Friction growing by 0.2 N·m from 20 s to 100 s; delay after +0.05 N·m is crossed, in s of motion."
    yield ""
    yield "| rate | modes | actuator-flights | found | median delay | 90 % |"
    yield "|---|---|---|---|---|---|"
    aircraft = args.aircraft(600, 4)
    grows = dict.fromkeys(SURFACES, (Condition.growing("friction", 0.2, at_s=20.0),))
    for rate_hz in (25.0, 100.0):
        baselines = reference(args, aircraft, rate_hz, MODES)
        tasks = [
            Task(f"{a}/{k}", flight(100 + k, a, rate_hz=rate_hz, mode=MODES[k % 5], conditions=grows))
            for a in aircraft
            for k in range(10)
        ]
        consumer = partial(_delays, baselines=baselines, crossed_s=40.0)
        delays = np.array([d for _, several in fly_all(tasks, consumer, args.workers) for d in several])
        yield (
            f"| {rate_hz:g} Hz | all five | {delays.size} | {np.isfinite(delays).mean():.1%} | "
            f"{np.median(delays):.1f} s | {np.quantile(delays, 0.9):.1f} s |"
        )


def _named(one: Judged) -> str:
    suspects = one.findings.suspects
    return suspects[0].fault if suspects else "healthy"


def _named_in_tiers(name: str, record: FlightRecord, *, baselines: dict[str, Known]) -> dict[str, list[str]]:
    return {
        tier: [_named(one) for one in judge(name, record, tier=tier, baselines=known)]
        for tier, known in baselines.items()
    }


def _tier_baselines(name: str, record: FlightRecord) -> dict[str, list[Judged]]:
    return {tier: judge(name, record, tier=tier) for tier in BY_TIER}


def conditions(args: argparse.Namespace) -> Rows:
    """Yield the share of each condition named right, clear / half as severe, and what is named wrong."""
    named: dict[tuple[str, str], Counter[str]] = {}
    for rate_hz in RATES_HZ:
        named.update(_named_at(args, args.aircraft(700, 3), rate_hz))
    columns = [f"{tier} {rate_hz:g} Hz" for tier in BY_TIER for rate_hz in RATES_HZ]
    yield f"| condition, clear severity | {' | '.join(columns)} | of |"
    yield "|---" * (len(columns) + 2) + "|"
    for fault, severity in {"healthy": 0.0, **CLEAR}.items():
        name = NAMES.get(fault, fault)
        cells = []
        for column in columns:
            clear, mild = (named[column, f"{fault}{part}"] for part in ("", ", mild"))
            cells.append(f"{100 * clear[name] / clear.total():.0f} / {100 * mild[name] / mild.total():.0f} %")
        title = UNITS.get(fault, fault).format(severity)
        yield f"| {title} | {' | '.join(cells)} | {named[columns[0], fault].total()} |"
    yield ""
    for (column, fault), counts in named.items():
        right = fault.removesuffix(", mild")
        wrong = {
            name: count for name, count in counts.items() if name not in (NAMES.get(right, right), "healthy")
        }
        if wrong:
            yield f"{column}, {fault}: named {wrong} of {counts.total()}"


def _named_at(
    args: argparse.Namespace, aircraft: range, rate_hz: float
) -> dict[tuple[str, str], Counter[str]]:
    """Return the first suspects by tier and rate, and by condition, clear and mild."""
    tasks = [
        Task(f"{a}/{k}", flight(k, a, rate_hz=rate_hz, mode=MODES[k % 5]))
        for a in aircraft
        for k in range(REFERENCE_FLIGHTS)
    ]
    judged = list(fly_all(tasks, _tier_baselines, args.workers))
    baselines = {tier: baselines_of([(name, tiers[tier]) for name, tiers in judged]) for tier in BY_TIER}
    named: dict[tuple[str, str], Counter[str]] = {}
    for share, label in ((1.0, ""), (0.5, ", mild")):
        for fault, severity in {"healthy": 0.0, **CLEAR}.items():
            worn = added(fault, share * severity)
            tasks = [
                Task(f"{a}/{k}", flight(200 + k, a, rate_hz=rate_hz, mode=MODES[k % 5], conditions=worn))
                for a in aircraft
                for k in range(args.count(10))
            ]
            for _, tiers in fly_all(tasks, partial(_named_in_tiers, baselines=baselines), args.workers):
                for tier, names in tiers.items():
                    named.setdefault((f"{tier} {rate_hz:g} Hz", f"{fault}{label}"), Counter()).update(names)
    return named
