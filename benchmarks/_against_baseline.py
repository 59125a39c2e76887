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
from mavhums.health.self_baseline.thresholds import REFERENCE_FLIGHTS
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
    aircraft = range(args.count(5))
    cases = [(25.0, (mode,), 0.0) for mode in MODES] + [
        (25.0, MODES, 0.0),
        (25.0, MODES, 0.03),
        (100.0, MODES, 0.0),
    ]
    for rate_hz, modes, drift in cases:
        given = {"drift": drift} if drift else {}
        baselines = reference(args, aircraft, rate_hz, modes, **given)
        shares, total = [], 0
        for severity in (0.02, 0.03, 0.05):
            total, found, _ = _found(args, baselines, aircraft, rate_hz, modes, 10, severity, 100, **given)
            shares.append(f"{found / total:.1%}")
        name = modes[0] if len(modes) == 1 else "all five"
        yield f"| {rate_hz:g} Hz | {name} | {drift:.0%} | {' | '.join(shares)} | {total} |"


def alarms(args: argparse.Namespace) -> Rows:
    """Count the false alarms in a healthy run whose flights are used for nothing else."""
    aircraft = range(530, 530 + args.count(12))
    baselines = reference(args, aircraft, 25.0, MODES)
    total, found, other = _found(args, baselines, aircraft, 25.0, MODES, 226, 0.0, 1000)
    hours = total * 100.0 / 3600.0
    yield f"Healthy, own baselines, 25 Hz, five modes: {total} actuator-flights, {hours:.0f} actuator-hours."
    yield f"False alarms: friction {found}, any other detector {other}."


def _delays(name: str, record: FlightRecord, *, baselines: Known | None, crossed_s: float) -> list[float]:
    delays = []
    for one in judge(name, record, baselines=baselines):
        alarms_s = [c.time_s for c in one.changes if c.after in ("degraded", "emergency")]
        delay = (alarms_s[0] - crossed_s) * one.truth["moving"] if alarms_s else np.inf
        delays.append(float(delay))
    return delays


def growth(args: argparse.Namespace) -> Rows:
    yield "Friction growing by 0.2 N·m from 20 s to 100 s; delay after +0.05 N·m is crossed, in s of motion."
    yield ""
    yield "| rate | modes | actuator-flights | found | median delay | 90 % |"
    yield "|---|---|---|---|---|---|"
    aircraft = range(600, 600 + args.count(4))
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
    return {tier: judge(name, record, tier=tier) for tier in ("instrumented", "esc-signed")}


def conditions(args: argparse.Namespace) -> Rows:
    yield "Actuator-flights with own baseline; mild is half of clear. Rows: truth; columns: first suspect."
    aircraft = range(700, 700 + args.count(3))
    for rate_hz in (100.0, 25.0):
        tasks = [
            Task(f"{a}/{k}", flight(k, a, rate_hz=rate_hz, mode=MODES[k % 5]))
            for a in aircraft
            for k in range(REFERENCE_FLIGHTS)
        ]
        judged = list(fly_all(tasks, _tier_baselines, args.workers))
        baselines = {
            tier: baselines_of([(name, tiers[tier]) for name, tiers in judged])
            for tier in ("instrumented", "esc-signed")
        }
        for share, label in ((1.0, "clear"), (0.5, "mild")):
            named: dict[tuple[str, str], Counter[str]] = {}
            for fault, severity in {"healthy": 0.0, **CLEAR}.items():
                tasks = [
                    Task(
                        f"{a}/{k}",
                        flight(
                            200 + k,
                            a,
                            rate_hz=rate_hz,
                            mode=MODES[k % 5],
                            conditions=added(fault, share * severity),
                        ),
                    )
                    for a in aircraft
                    for k in range(10)
                ]
                for _, tiers in fly_all(tasks, partial(_named_in_tiers, baselines=baselines), args.workers):
                    for tier, names in tiers.items():
                        named.setdefault((tier, NAMES.get(fault, fault)), Counter()).update(names)
            for tier in ("instrumented", "esc-signed"):
                yield from _confusion(f"{tier}, {rate_hz:g} Hz, {label}", named, tier)


def _confusion(title: str, named: dict[tuple[str, str], Counter[str]], tier: str) -> Rows:
    faults = [fault for known, fault in named if known == tier]
    yield ""
    yield f"{title}:"
    yield ""
    yield "| truth | right | " + " | ".join(faults) + " |"
    yield "|---" * (len(faults) + 2) + "|"
    for fault in faults:
        counts = named[tier, fault]
        cells = " | ".join(str(counts[name]) for name in faults)
        yield f"| {fault} | {counts[fault] / counts.total():.1%} | {cells} |"
