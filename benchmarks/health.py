"""How right, early and sure the verdicts are: ``python benchmarks/health.py [SECTION…] [--scale 1.0]``.

Sections: windows, flights, friction, early, alarms, growth, conditions, replay, cost; all if none is named.
Every flight is flown by two-mass individuals with dispersion, from seeds that training never used, at
100 s and five flight modes in turn, unless said otherwise. ``--scale`` changes the number of flights.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from _fleet import (
    ACTUATORS,
    MODES,
    SURFACES,
    Judged,
    Task,
    added,
    baselines_of,
    flight,
    fly_all,
    judge,
    quantities,
    replayed,
)
from numpy.typing import NDArray

from mavhums import analyse
from mavhums.health import Monitor
from mavhums_sim import FlightRecord, fly, write_tlog
from mavhums_sim.campaign import PAPER_FRICTION_NM
from mavhums_sim.conditions import Condition

Array = NDArray[np.float64]
Rows = Iterator[str]

MIDDLE = 0.625
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
REFERENCE_FLIGHTS = 15


def frictions(number: int, aircraft: int) -> dict[str, tuple[float, float]]:
    """Return one of the paper's eight frictions for each surface."""
    drawn = np.random.default_rng([number, aircraft, 5]).choice(PAPER_FRICTION_NM, len(SURFACES))
    return {surface: (float(f), float(f)) for surface, f in zip(SURFACES, drawn, strict=True)}


def at_all_frictions(count: int, rate_hz: float, cyclograms: tuple[object, ...] = MODES) -> list[Task]:
    tasks = []
    for k in range(count):
        cyclogram = cyclograms[k % len(cyclograms)]
        flown = flight(k, k, rate_hz=rate_hz, mode=cyclogram, friction_nm=frictions(k, k))  # type: ignore[arg-type]
        tasks.append(Task(f"{k}/{cyclogram if isinstance(cyclogram, str) else cyclogram.name}", flown))  # type: ignore[attr-defined]
    return tasks


# Windows ---------------------------------------------------------------------------------------------


def _windows(
    name: str, record: FlightRecord, window_s: float
) -> dict[str, list[tuple[float, float, float, float]]]:
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    for tier in ("instrumented", "esc-signed"):
        rows = found.setdefault(tier, [])
        for one in judge(name, record, tier=tier, window_s=window_s, keep_windows=True):
            for window in one.windows:
                interval = window.friction_nm
                shown = (interval.estimate, interval.low, interval.high) if interval else (np.nan,) * 3
                rows.append((one.truth["friction"], *shown))
    return found


def windows(args: argparse.Namespace, cyclograms: tuple[object, ...] = MODES) -> Rows:
    yield "| tier | window | rate | windows | decidable | right of decidable | wrong |"
    yield "|---|---|---|---|---|---|---|"
    for window_s, rate_hz in ((1.0, 50.0), (1.0, 100.0), (5.0, 25.0), (10.0, 10.0)):
        tasks = at_all_frictions(args.count(50), rate_hz, cyclograms)
        by_tier: dict[str, list[Array]] = {}
        for _, found in fly_all(tasks, partial(_windows, window_s=window_s), args.workers):
            for tier, rows in found.items():
                by_tier.setdefault(tier, []).append(np.array(rows))
        for tier, parts in by_tier.items():
            truth, estimate, low, high = np.concatenate(parts).T
            decidable = (low > MIDDLE) | (high < MIDDLE)
            right = (estimate > MIDDLE) == (truth > MIDDLE)
            wrong = int(np.count_nonzero(decidable & ~right))
            yield (
                f"| {tier} | {window_s:g} s | {rate_hz:g} Hz | {truth.size} | {decidable.mean():.1%} | "
                f"{1 - wrong / max(decidable.sum(), 1):.4%} | {wrong} |"
            )


# Whole flights through logs --------------------------------------------------------------------------


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
            Task(task.name, dataclasses.replace(task.flight, tiers=(tier, "pwm")))
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


# Friction estimate -----------------------------------------------------------------------------------


def _estimates(name: str, record: FlightRecord) -> list[tuple[str, float, float, float, float]]:
    rows = []
    for tier in ("instrumented", "without load", "esc-signed"):
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


def _oracle(surface: str, flown: object) -> list[float]:
    """T_c in 10 s windows by one who knows the load, the inertia, the drag and the torque constant."""
    times, values = quantities(flown, ACTUATORS[surface], "instrumented")  # type: ignore[arg-type]
    own = flown.individual  # type: ignore[attr-defined]
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
    yield "| mode | tier | windows | bias | sd, N·m | interval covers |"
    yield "|---|---|---|---|---|---|"
    rows: dict[tuple[str, str], list[tuple[float, float, float, float]]] = {}
    for name, found in fly_all(at_all_frictions(args.count(75), 25.0, cyclograms), _estimates, args.workers):
        for tier, *numbers in found:
            for mode in (name.split("/")[1], "all"):
                rows.setdefault((tier, mode), []).append(tuple(numbers))  # type: ignore[arg-type]
    for (tier, mode), several in sorted(rows.items()):
        truth, estimate, low, high = np.array(several).T
        error = estimate - truth
        covers = np.mean((low <= truth) & (truth <= high))
        shown = "—" if np.isnan(low).all() else f"{covers:.1%}"
        yield f"| {mode} | {tier} | {truth.size} | {error.mean():+.4f} | {error.std():.4f} | {shown} |"


# Against the own baseline ----------------------------------------------------------------------------


def reference(
    args: argparse.Namespace, aircraft: range, rate_hz: float, modes: tuple[str, ...], **given: float
) -> object:
    tasks = [
        Task(f"{a}/{k}", flight(k, a, rate_hz=rate_hz, mode=modes[k % len(modes)], **given))
        for a in aircraft
        for k in range(REFERENCE_FLIGHTS)
    ]
    return baselines_of(list(fly_all(tasks, judge, args.workers)))


def _found(
    args: argparse.Namespace,
    baselines: object,
    aircraft: range,
    rate_hz: float,
    modes: tuple[str, ...],
    each: int,
    severity: float,
    first: int,
    **given: float,
) -> tuple[int, int, int]:
    """Return actuator-flights, those found to be worn by friction, and those said to have anything else."""
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
    """Count the false alarms of a healthy run whose flights nothing else uses."""
    aircraft = range(530, 530 + args.count(12))
    baselines = reference(args, aircraft, 25.0, MODES)
    total, found, other = _found(args, baselines, aircraft, 25.0, MODES, 226, 0.0, 1000)
    hours = total * 100.0 / 3600.0
    yield f"Healthy, own baselines, 25 Hz, five modes: {total} actuator-flights, {hours:.0f} actuator-hours."
    yield f"False alarms: friction {found}, any other detector {other}."


def _delays(name: str, record: FlightRecord, *, baselines: object, crossed_s: float) -> list[float]:
    delays = []
    for one in judge(name, record, baselines=baselines):  # type: ignore[arg-type]
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


# Eight conditions ------------------------------------------------------------------------------------


def _named(one: Judged) -> str:
    suspects = one.findings.suspects
    return suspects[0].fault if suspects else "healthy"


def _named_in_tiers(name: str, record: FlightRecord, *, baselines: dict[str, object]) -> dict[str, list[str]]:
    return {
        tier: [_named(one) for one in judge(name, record, tier=tier, baselines=known)]  # type: ignore[arg-type]
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


# The rest --------------------------------------------------------------------------------------------


def replay(args: argparse.Namespace) -> Rows:
    cyclograms = tuple(replayed(args.logs))
    if not cyclograms:
        yield f"no real logs in {args.logs}"
        return
    yield from windows(args, cyclograms)
    yield ""
    yield from friction(args, cyclograms)


def cost(args: argparse.Namespace) -> Rows:
    yield "| flight | block | ms of processor time per actuator and flight-minute |"
    yield "|---|---|---|"
    actuator = ACTUATORS["elevator"]
    flown = fly(flight(0, 900, rate_hz=100.0, mode="gusts", duration_s=100.0)).actuators["elevator"]
    times, values = quantities(flown, actuator, "instrumented")
    for copies in (1, 10):
        long_t = np.concatenate([times + 100.0 * k for k in range(copies)])
        long_v = np.tile(values, (copies, 1))
        for block in (100, 1000):
            spent = min(_timed(actuator, long_t, long_v, block) for _ in range(3))
            yield f"| {100 * copies} s | {block / 100:g} s | {1000 * spent / (copies * 100 / 60):.2f} |"


def _timed(actuator: object, times: Array, values: Array, block: int) -> float:
    monitor = Monitor(1, actuator)  # type: ignore[arg-type]
    start = time.process_time()
    for k in range(0, times.size, block):
        list(monitor.feed(times[k : k + block], values[k : k + block]))
    list(monitor.finish())
    return time.process_time() - start


SECTIONS: dict[str, Callable[[argparse.Namespace], Rows]] = {
    "windows": windows,
    "flights": flights,
    "friction": friction,
    "early": early,
    "alarms": alarms,
    "growth": growth,
    "conditions": conditions,
    "replay": replay,
    "cost": cost,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "section", nargs="*", choices=[[], *SECTIONS], help="what to measure; everything if omitted"
    )
    parser.add_argument("--scale", type=float, default=1.0, help="of the number of flights")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--logs", type=Path, default=Path("../shared/logs"), help="folder of real logs")
    args = parser.parse_args()
    args.count = lambda number: max(round(number * args.scale), 1)
    args.say = lambda text: print(f"  {text}", flush=True)
    for name in args.section or SECTIONS:
        start = time.perf_counter()
        print(f"\n## {name}\n", flush=True)
        for line in SECTIONS[name](args):
            print(line, flush=True)
        print(f"\n({time.perf_counter() - start:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
