"""Real actuators through the whole program: ``python benchmarks/real_actuators.py DIR [--only SECTION]``.

DIR holds ``*.parquet`` with ``*_meta.parquet`` (servos under a pendulum, bench) and ``cranfield/*.csv.gz``
(screw rig with seeded faults, bench). Every recording becomes a ``.tlog`` that ``analyse`` reads. The rules
were developed on the servo's flights of repetitions 0 and 1 (``--reps 0 1``); the others were looked at last.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

import mavhums
from benchmarks._real_logs import (
    CURRENTS,
    GEAR_RATIO,
    RUN_APART_S,
    SHEETS,
    Flight,
    Friction,
    Sheet,
    fitted,
    pendulum_runs,
    profile,
    register_rates,
    servo_flights,
    servos,
    with_current,
    write_log,
)
from mavhums.actuator.profile import Ema
from mavhums.actuator.servo_types import packaged_servo_types
from mavhums.app.identify import identify
from mavhums.core.errors import MavhumsError
from mavhums.health.decision.baseline import PastRecord
from mavhums.health.self_baseline.verdict import compare_with_own_flights
from mavhums.paper.real import rate
from mavhums.paper.rig import HEALTHY, read_rig
from mavhums.results.verdict import Indicator, Verdict

SECTIONS = ("sheet", "own", "identify", "screw", "weak")
RISES = (0.25, 0.5, 1.0)
LEARNING, DRAWS = 20, 4
WEAK = "dynamixel-xl330-m288"
WEAK_LIMITS = "[actuators.limits]\nnormal = 0.04\nemergency = 0.09\n"
FRICTIONS = {"none said": "", "0.3 ± 0.1": "load_friction = 0.3\nload_friction_uncertainty = 0.1\n"}
SCREW = 'name = "screw"\n[[actuators]]\nname = "servo"\nservo = 1\npwm_us = [1000, 1500, 2000]\n'
FRICTION_KEYS = "load_friction" in Ema.model_fields


def weak_table(folder: Path, data: Path) -> Iterator[str]:
    """Yield what is said of a healthy servo that cannot lift its pendulum, each run flown twice in a row."""
    airframe, runs = folder / "weak.toml", [*pendulum_runs(data)]
    airframe.write_text(
        f'{profile(None)}servo_type = "dynamixel-xl330-m288"\n{WEAK_LIMITS}', encoding="utf-8"
    )
    yield "\n| motion | largest load, N·m | share of the command reached | at the end | worst | why |"
    yield "|---|---|---|---|---|---|"
    for name, run in runs:
        flight = run.geared(packaged_servo_types()[WEAK]["ema"]["gear_ratio"])
        path = folder / f"weak-{flight.number}.tlog"
        time_s = np.concatenate([flight.time_s, flight.time_s + flight.time_s[-1] + RUN_APART_S])
        verdict = judged(write_log(path, flight.number, time_s, np.tile(flight.values, (2, 1))), airframe)
        reached = np.ptp(flight.values[:, 2]) / np.ptp(flight.values[:, 0])
        why = ", ".join(suspect.fault for suspect in verdict.suspects) or verdict.reason or ""
        load = np.abs(flight.true_load).max()
        yield f"| {name} | {load:.2f} | {reached:.0%} | {verdict.condition} | {verdict.worst} | {why} |"


def judged(path: Path, airframe: Path) -> Verdict:
    verdicts = mavhums.analyse(path, mavhums.Options(airframe=airframe)).verdicts
    return next(verdict for verdict in verdicts if verdict.subject == "actuator")


def _flown(flight: Flight, kind: str, sheet: Sheet, folder: Path, airframes: Sequence[Path]) -> list[Verdict]:
    path = folder / f"{kind.replace(', ', '-')}-{flight.number:02d}-{os.getpid()}.tlog"
    write_log(path, flight.number, flight.time_s, with_current(flight, kind, sheet))
    try:
        return [judged(path, airframe) for airframe in airframes]
    finally:
        path.unlink()


def sheet_table(
    flights: Sequence[Flight], sheet: Sheet, folder: Path, pool: ProcessPoolExecutor
) -> Iterator[str]:
    yield "\n| current | friction with load | at the end | an emergency at some time | friction, N·m | why |"
    yield "|---|---|---|---|---|---|"
    airframes = {}
    for name, keys in FRICTIONS.items():
        if not keys or FRICTION_KEYS:
            airframes[name] = folder / f"sheet-{name}.toml"
            airframes[name].write_text(profile(sheet, friction=keys), encoding="utf-8")
    for kind in CURRENTS:
        run = partial(_flown, kind=kind, sheet=sheet, folder=folder, airframes=[*airframes.values()])
        for name, verdicts in zip(airframes, zip(*pool.map(run, flights), strict=True), strict=True):
            yield _sheet_row(kind, name, verdicts)


def _sheet_row(kind: str, name: str, verdicts: Iterable[Verdict]) -> str:
    said, ever, values, why = Counter[str](), 0, list[float](), Counter[str]()
    for verdict in verdicts:
        faults = ",".join(suspect.fault for suspect in verdict.suspects)
        said[f"{verdict.condition}{f' ({faults})' if faults else ''}"] += 1
        ever += verdict.worst == "emergency"
        if verdict.condition == "undecided":
            why[str(verdict.reason)] += 1
        values += [one.value.estimate for one in verdict.indicators if one.fault == "friction"]
    span = f"{min(values):.2f}–{max(values):.2f}" if values else "–"
    reasons = "; ".join(f"{count} × {text}" for text, count in why.most_common(2))
    ends = ", ".join(f"{count} {text}" for text, count in said.most_common())
    return f"| {kind} | {name} | {ends} | {ever} | {span} | {reasons} |"


def worn(flight: Flight, rise: float, friction: Friction) -> Flight:
    """Return the flight with so much more of its friction in the voltage: V + r·sgn w·(F_c + m·|τ|)."""
    values = flight.values.copy()
    way = np.sign(np.nan_to_num(values[:, 6]))
    values[:, 3] += rise * way * (friction.constant_v + friction.by_load_v * np.abs(flight.true_load))
    return flight._replace(values=values)


def own_table(
    flights: Sequence[Flight], sheet: Sheet, folder: Path, pool: ProcessPoolExecutor
) -> Iterator[str]:
    friction = fitted(flights)
    blank = folder / "blank.toml"
    blank.write_text(profile(None), encoding="utf-8")
    cells = " | ".join(f"+{rise:.0%} found" for rise in RISES)
    yield f"\n| current | judged by | healthy | least rise (range) | {cells} | beyond the loads | why |"
    yield f"|---{'|---' * (6 + len(RISES))}|"
    for kind in CURRENTS:
        run = partial(_flown, kind=kind, sheet=sheet, folder=folder, airframes=[blank])
        levels = {
            r: [v for [v] in pool.map(run, [worn(f, r, friction) for f in flights])] for r in (0.0, *RISES)
        }
        yield _own_row(kind, flights, levels)


def history(verdicts: Iterable[Verdict]) -> list[PastRecord]:
    return [PastRecord(v.own, f"2025-01-{k:02d}", healthy=True) for k, v in enumerate(verdicts, 1)]


def _own_row(kind: str, flights: Sequence[Flight], levels: dict[float, list[Verdict]]) -> str:
    rng, count = np.random.default_rng(34), len(flights)
    least, why = list[float](), Counter[str]()
    said: dict[float, Counter[str]] = {r: Counter() for r in levels}
    faults: Counter[str] = Counter()
    learning = min(LEARNING, count - 2)
    for _ in range(DRAWS):
        order = rng.permutation(count)
        past = history(levels[0.0][k] for k in order[:learning])
        for r, verdicts in levels.items():
            for k in order[learning:]:
                found = compare_with_own_flights(verdicts[k], past)
                said[r][found.condition] += 1
                if r == 0.0:
                    why[str(found.reason).split("(")[0][:90]] += 1
                    rises = {
                        one.fault: one.least_rise for one in found.indicators if one.least_rise is not None
                    }
                    least += rises.values()
                    faults.update(rises)
    of = sum(said[0.0].values())
    spread = f"{np.median(least):.0%} ({min(least):.0%}–{max(least):.0%})" if least else "–"
    healthy = ", ".join(f"{n} {text}" for text, n in said[0.0].most_common())
    cells = " | ".join(rate(said[r]["changed"], of) for r in RISES)
    loads = np.array([np.abs(flight.true_load).max() for flight in flights])
    light = np.argsort(loads)[: count // 2]
    beyond = Counter(
        compare_with_own_flights(levels[0.0][k], history(levels[0.0][j] for j in light)).condition
        for k in range(count)
        if k not in set(light.tolist())
    )
    heavy = ", ".join(f"{n} {text}" for text, n in beyond.most_common())
    reason = "; ".join(f"{n} × {text}" for text, n in why.most_common(1))
    names = ", ".join(faults) or "–"
    return f"| {kind} | {names} | {healthy} | {spread} | {cells} | {heavy} | {reason} |"


def identified(flights: Sequence[Flight], sheet: Sheet, folder: Path) -> Iterator[str]:
    blank = folder / "blank.toml"
    blank.write_text(profile(None), encoding="utf-8")
    for kind in ("sensor", "register"):
        logs = [
            write_log(
                folder / f"identify-{k}.tlog", flight.number, flight.time_s, with_current(flight, kind, sheet)
            )
            for k, flight in enumerate(flights[:4])
        ]
        try:
            found = identify(logs, mavhums.Options(airframe=blank))["servo"].found
            constant = found.back_emf.estimate * sheet.gear_ratio
            text = f"R {found.resistance.estimate:.3g} Ω, k {constant:.3g} V·s/rad"
        except MavhumsError as error:
            text = str(error)
        yield f"\nidentify, {kind}: {text}"


def screw_table(folder: Path, data: Path) -> Iterator[str]:
    blank = folder / "screw.toml"
    blank.write_text(SCREW, encoding="utf-8")
    recorded, repeated = read_rig(data)
    runs: dict[tuple[str, float], list[Verdict]] = defaultdict(list)
    for number, run in enumerate(recorded):
        path = write_log(folder / "screw.tlog", number, *run.flown())
        runs[run.condition, run.load].append(judged(path, blank))
    normal = [(at, k) for at, own in runs.items() if at[0] == HEALTHY for k in range(len(own))]
    yield f"\nHistory: {len(normal)} healthy runs; each without itself. Left out: {repeated or 'none'}."
    yield "\n| condition | load | said | changed | change (least rise) |\n|---|---|---|---|---|"
    above: list[bool] = []
    for at, verdicts in sorted(runs.items()):
        said, faults = Counter[str](), Counter[str]()
        shown: dict[str, list[Indicator]] = defaultdict(list)
        for k, verdict in enumerate(verdicts):
            past = history(runs[other][j] for other, j in normal if (other, j) != (at, k))
            found = compare_with_own_flights(verdict, past)
            said[found.condition] += 1
            faults.update(suspect.fault for suspect in found.suspects)
            for one in found.indicators:
                if one.least_rise is not None and one.baseline is not None:
                    shown[one.fault].append(one)
        rises = {fault: _rise(several) for fault, several in shown.items()}
        if at[0] != HEALTHY and any(change > least for change, least in rises.values()):
            above += [True] * said["changed"] + [False] * (len(verdicts) - said["changed"])
        ends = ", ".join(f"{n} {text}" for text, n in said.most_common())
        which = ", ".join(f"{fault} {rate(n, len(verdicts))}" for fault, n in faults.items()) or "–"
        changes = ", ".join(f"{fault} {c:+.0%} ({least:.0%})" for fault, (c, least) in rises.items())
        yield f"| {at[0]} | {at[1]:g} | {ends} | {which} | {changes} |"
    found_of = rate(sum(above), len(above))
    yield f"\nConditions and loads whose mean change lies above the least rise: found {found_of}"


def _rise(several: Sequence[Indicator]) -> tuple[float, float]:
    """Return the mean change and the median least rise of an indicator over several runs."""
    changes = [one.value.estimate / one.baseline.estimate - 1.0 for one in several if one.baseline]
    return float(np.mean(changes)), float(np.median([one.least_rise or 0.0 for one in several]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", choices=SECTIONS, action="append")
    parser.add_argument("--reps", type=int, nargs="*", help="the servo's repetitions; all if omitted")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--kinds", nargs="*", help=f"currents, of {', '.join(CURRENTS)}")
    args = parser.parse_args()
    if args.kinds:
        globals()["CURRENTS"] = args.kinds
    sections = args.only or SECTIONS
    with tempfile.TemporaryDirectory() as name, ProcessPoolExecutor(args.workers) as pool:
        folder = Path(name)
        for servo, (rows, meta) in servos(args.data).items():
            whole = [
                flight
                for flight in servo_flights(rows, meta, GEAR_RATIO)
                if args.reps is None or flight.rep in args.reps
            ]
            found = fitted(whole)
            sheet = SHEETS.get(servo, found.sheet())
            flights = [flight.geared(sheet.gear_ratio) for flight in whole]
            print(f"\n## {servo}: {len(flights)} flights", flush=True)
            print(
                f"\nOf all flights: R/k {found.volts_per_nm:.3f} V/(N·m), k {found.back_emf:.3f} V·s/rad, "
                f"T_c {found.constant_v / found.volts_per_nm:.3f} N·m, "
                f"J {found.inertia_v / found.volts_per_nm:.4f} kg·m², "
                f"μ {found.by_load_v / found.volts_per_nm:.3f}; "
                f"{'data sheet' if servo in SHEETS else 'no data sheet: limits and V5 follow from these'}"
            )
            rates = ", ".join(f"{name} {hz:.3g}" for name, hz in register_rates(rows).items())
            print(f"Changes a second in motion: {rates}", flush=True)
            if "sheet" in sections:
                for line in sheet_table(flights, sheet, folder, pool):
                    print(line, flush=True)
            if "own" in sections:
                for line in own_table(flights, sheet, folder, pool):
                    print(line, flush=True)
            if "identify" in sections:
                for line in identified(flights, sheet, folder):
                    print(line, flush=True)
        if "screw" in sections and (args.data / "cranfield").is_dir():
            print("\n## Screw rig", flush=True)
            for line in screw_table(folder, args.data):
                print(line, flush=True)
        if "weak" in sections and (args.data / "xl330").is_dir():
            print("\n## A servo too weak for its load", flush=True)
            for line in weak_table(folder, args.data / "xl330"):
                print(line, flush=True)


if __name__ == "__main__":
    main()
