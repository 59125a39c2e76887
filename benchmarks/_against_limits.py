"""Accuracy of verdicts and friction estimates: sections of ``benchmarks/health.py``."""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks._fleet import (
    ACTUATORS,
    MODES,
    SURFACES,
    Task,
    at_all_frictions,
    flight,
    fly_all,
    judge,
    quantities,
)
from mavhums import analyse
from mavhums.core.arrays import Array
from mavhums_sim import ActuatorRecord, FlightRecord, write_tlog
from mavhums_sim.conditions import Condition
from mavhums_sim.rates import Rates

Rows = Iterator[str]

MIDDLE = 0.625
JAMS_S = (1.0, 1.5, 2.0, 3.0, 6.0)
WINDOWS_HZ = (10.0, 25.0, 50.0, 100.0)
BY_TIER = {"instrumented": "instrumented", "without load": "without V11", "esc-signed": "esc-signed"}


def _windows(name: str, record: FlightRecord) -> dict[str, list[tuple[float, float, float, float]]]:
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    for tier in ("instrumented", "esc-signed"):
        rows = found.setdefault(tier, [])
        for one in judge(name, record, tier=tier, keep_windows=True):
            for window in one.windows:
                interval = window.friction_nm
                shown = (interval.estimate, interval.low, interval.high) if interval else (np.nan,) * 3
                rows.append((one.truth["friction"], *shown))
    return found


def windows(args: argparse.Namespace, cyclograms: tuple[object, ...] = MODES) -> Rows:
    yield "| tier | rate | windows | decidable | right of decidable | wrong |"
    yield "|---|---|---|---|---|---|"
    for rate_hz in WINDOWS_HZ:
        tasks = at_all_frictions(args.count(50), rate_hz, cyclograms)
        by_tier: dict[str, list[Array]] = {}
        for _, found in fly_all(tasks, _windows, args.workers):
            for tier, rows in found.items():
                by_tier.setdefault(tier, []).append(np.array(rows))
        for tier, parts in by_tier.items():
            truth, estimate, low, high = np.concatenate(parts).T
            decidable = (low > MIDDLE) | (high < MIDDLE)
            right = (estimate > MIDDLE) == (truth > MIDDLE)
            wrong = int(np.count_nonzero(decidable & ~right))
            yield (
                f"| {tier} | {rate_hz:g} Hz | {truth.size} | {decidable.mean():.1%} | "
                f"{1 - wrong / max(decidable.sum(), 1):.2%} | {wrong} |"
            )


def _log_verdicts(name: str, record: FlightRecord) -> list[tuple[float, str]]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.tlog"
        write_tlog(record, path)
        verdicts = {v.actuator: v for v in analyse(path).verdicts}
    return [
        (float(flown.motion.friction[-1]), verdicts[surface].gravest)
        for surface, flown in record.actuators.items()
    ]


def flights(args: argparse.Namespace) -> Rows:
    yield "| tier | rate | actuator-flights | right | undecided | wrong |"
    yield "|---|---|---|---|---|---|"
    for tier, rate_hz in (
        ("instrumented", 25.0),
        ("esc-signed", 25.0),
        ("named", 10.0),
        ("esc-unsigned", 25.0),
    ):
        tasks = [
            Task(
                task.name,
                dataclasses.replace(task.flight, tiers=(tier, "pwm"), rates=Rates(esc=rate_hz)),
            )
            for task in at_all_frictions(args.count(125), rate_hz)
        ]
        counts: Counter[str] = Counter()
        for name, verdicts in fly_all(tasks, _log_verdicts, args.workers):
            for truth, condition in verdicts:
                expected = "normal" if truth < MIDDLE else "emergency"
                outcome = "right" if condition == expected else condition
                counts[outcome if outcome in ("right", "undecided") else "wrong"] += 1
                if outcome not in ("right", "undecided"):
                    args.say(f"{tier} {name}: {truth} N·m called {condition}")
        total = counts.total()
        cells = " | ".join(str(counts[outcome]) for outcome in ("right", "undecided", "wrong"))
        yield f"| {tier} | {rate_hz:g} Hz | {total} | {cells} |"


def _estimates(name: str, record: FlightRecord) -> list[tuple[str, float, float, float, float]]:
    rows = []
    for tier in BY_TIER:
        for one in judge(name, record, tier=tier, keep_windows=True):
            for window in one.windows[::10]:
                if window.friction_nm is not None:
                    i = window.friction_nm
                    rows.append((tier, one.truth["friction"], i.estimate, i.low, i.high))
    for surface, flown in record.actuators.items():
        rows += [
            ("all but T_c known", flown.motion.friction[-1], bound, np.nan, np.nan)
            for bound in _oracle(surface, flown)
        ]
    return rows


def _oracle(surface: str, flown: ActuatorRecord) -> list[float]:
    """Estimate T_c in 10 s windows with exactly known load, inertia, drag and torque constant."""
    times, values = quantities(flown, ACTUATORS[surface], "instrumented")
    own = flown.individual
    speed = values[:, 6] * ACTUATORS[surface].rad_s(1.0)
    inertia = ACTUATORS[surface].inertia_output * own.inertia + 0.004
    torque = values[:, 4] * 4.38235 * own.torque_constant - values[:, 10]
    rest = torque - inertia * np.gradient(speed, times) - own.viscous * speed
    way = np.sign(speed) * (np.abs(speed) > 0.02)
    steady = np.zeros(times.size, dtype=bool)
    steady[2:-2] = (way[2:-2] != 0) & (way[2:-2] == way[:-4]) & (way[2:-2] == way[4:])
    found = []
    for start in range(0, 100, 10):
        there = steady & (times >= start) & (times < start + 10)
        if np.count_nonzero(there) > 20:
            found.append(float(np.mean((rest * way)[there])))
    return found


def friction(args: argparse.Namespace, cyclograms: tuple[object, ...] = MODES) -> Rows:
    yield f"| mode | all but T_c known | {' | '.join(BY_TIER.values())} |"
    yield "|---" * (2 + len(BY_TIER)) + "|"
    rows: dict[tuple[str, str], list[tuple[float, float, float, float]]] = {}
    for name, found in fly_all(at_all_frictions(args.count(75), 25.0, cyclograms), _estimates, args.workers):
        for tier, *numbers in found:
            for mode in (name.split("/")[1], "all"):
                rows.setdefault((tier, mode), []).append(tuple(numbers))  # type: ignore[arg-type]
    for mode in dict.fromkeys(mode for _, mode in rows):
        truth, bound, *_ = np.array(rows["all but T_c known", mode]).T
        cells = [f"{(bound - truth).std():.3f}"]
        for tier in BY_TIER:
            truth, estimate, low, high = np.array(rows[tier, mode]).T
            error = estimate - truth
            covers = f"; {np.mean((low <= truth) & (truth <= high)):.1%}" * (mode == "all")
            cells.append(f"{error.mean():+.3f} ± {error.std():.3f}{covers}")
        yield f"| {mode} | {' | '.join(cells)} |"


def _jams(name: str, record: FlightRecord) -> Counter[tuple[str, str, str]]:
    return Counter(
        (tier, name, one.findings.worst)
        for tier in ("csrv", "esc-signed", "esc-unsigned")
        for one in judge(name, record, tier=tier)
    )


def jams(args: argparse.Namespace) -> Rows:
    """Yield what is said of jams of 10 N·m by their length; all four surfaces jam at the same time."""
    tasks = []
    for k in range(args.count(4) * len(MODES)):
        at_s = float(np.random.default_rng([k, 27]).uniform(15.0, 50.0))
        for lasts_s in JAMS_S:
            jam = dict.fromkeys(SURFACES, (Condition("jam", 10.0, 10.0, at_s, at_s + lasts_s),))
            mode, rate_hz = MODES[k % len(MODES)], (10.0, 25.0, 50.0)[k % 3]
            flown = flight(k, 880 + k, rate_hz=rate_hz, mode=mode, duration_s=60.0, conditions=jam)
            tasks.append(Task(f"{mode}/{lasts_s:g}", flown))
    said: Counter[tuple[str, str, str]] = Counter()
    for _, found in fly_all(tasks, _jams, args.workers):
        said += found
    yield f"| mode | tier | found of | {' | '.join(f'{lasts_s:g} s' for lasts_s in JAMS_S)} |"
    yield "|---" * (3 + len(JAMS_S)) + "|"
    for mode in MODES:
        for tier in ("csrv", "esc-signed", "esc-unsigned"):
            found_of = " | ".join(str(said[tier, f"{mode}/{lasts_s:g}", "emergency"]) for lasts_s in JAMS_S)
            yield f"| {mode} | {tier} | {args.count(4) * len(SURFACES)} | {found_of} |"
